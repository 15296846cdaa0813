// Jobs as the service describes them.

export interface Progress {
  stage: string;
  task: string;
  done: number;
  total: number;
  remaining_s: number | null;
}

export interface Job {
  id: string;
  kind: string;
  workspace: string;
  user: string;
  parameters: Record<string, unknown>;
  priority: number;
  after: string[];
  state: "waiting" | "running" | "finished" | "failed" | "cancelled";
  tries: number;
  submitted: number;
  begun: number | null;
  ended: number | null;
  progress: Progress;
  result: Record<string, unknown>;
  error: { code: string; text: string; item: string } | null;
  cancelling: boolean;
}

export interface StageForecast {
  items: number;
  kept: number;
  seconds: number | null;
  memory_mb: number | null;
  memory_per_worker_mb: number | null;
  disk_mb: number | null;
  basis: string;
  reason: string;
}

/** Return whether nothing more will happen to a job. */
export function ended(job: Job): boolean {
  return ["finished", "failed", "cancelled"].includes(job.state);
}
