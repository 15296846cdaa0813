// How far a job is.
import { element } from "../../dom";
import { count, duration } from "../../format";
import type { Job, Progress } from "./values";

/** Return a bar with its text; null if nothing is known. */
export function progressBar({ stage, task, done, total, remaining_s }: Progress, label: string): HTMLElement | null {
  if (!stage && !task) return null;
  const left = remaining_s === null ? "" : `, ${duration(remaining_s)} left`;
  const text = total ? `${count(done)} of ${count(total)}${left}` : "";
  const bar = total
    ? element("progress", { max: total, value: done, "aria-label": label })
    : element("progress", { "aria-label": label });
  return element("span", { class: "progress" }, bar, element("span", { class: "number" }, [[stage, task].filter(Boolean).join(": "), text].filter(Boolean).join(" – ")));
}

/** Return how long a job has run, or waited. */
export function spent(job: Job, now = Date.now() / 1000): string {
  if (job.begun === null) return job.ended === null ? `waiting for ${duration(Math.max(0, now - job.submitted))}` : "";
  return duration(Math.max(0, (job.ended ?? now) - job.begun));
}
