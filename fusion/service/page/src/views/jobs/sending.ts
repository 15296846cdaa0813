// A file sent in parts; it goes on where it was after a broken connection or a new visit.
import { ApiProblem, ask, getAll, pathOf, send } from "../../api";
import { digestOf } from "./digest";

export interface Upload {
  id: string;
  name: string;
  kind: string;
  size: number;
  sha256: string;
  offset: number;
  state: "open" | "complete";
  user: string;
  created: number;
}

/** Where files are sent to, and what is there already. */
export interface Target {
  workspace: string;
  uploads: Upload[];
  signal: AbortSignal;
}

const PART = 8 << 20;
const TRIES = 5;
const WAIT_MS = 2000;

/** Return the uploads of a workspace, among which files are that were sent before. */
export function uploadsOf(workspace: string, signal: AbortSignal): Promise<Upload[]> {
  return getAll<Upload>(pathOf(workspace, "uploads"), "uploads", { signal });
}

/** Send a file that is not among the uploads; `onStep` gets what is being done and how far, 0 … 1. */
export async function sendFile(
  { workspace, uploads, signal }: Target,
  file: File,
  kind: string,
  onStep: (step: string, share: number) => void,
): Promise<Upload> {
  const sha256 = await digestOf(file, signal, (share) => onStep("checksum", share));
  const path = pathOf(workspace, "uploads");
  const same = uploads.find((one) => one.sha256 === sha256 && one.size === file.size && one.kind === kind);
  if (same?.state === "complete") return same;
  const upload = same ?? (await send<Upload>("POST", path, { name: file.name, size: file.size, sha256, kind }, { signal }));
  const own = pathOf(workspace, "uploads", upload.id);
  await sendParts(own, file, upload.offset, signal, (share) => onStep("sending", share));
  return send<Upload>("POST", `${own}/complete`, undefined, { signal });
}

async function sendParts(path: string, file: File, from: number, signal: AbortSignal, onShare: (share: number) => void): Promise<void> {
  let offset = from;
  let failures = 0;
  while (offset < file.size) {
    onShare(offset / file.size);
    try {
      const answer = await ask(path, {
        method: "PATCH",
        body: file.slice(offset, offset + PART),
        headers: { "Content-Type": "application/offset+octet-stream", "Upload-Offset": String(offset) },
        signal,
      });
      offset = Number(answer.headers.get("Upload-Offset"));
      failures = 0;
    } catch (error) {
      // A broken connection, a busy service, or bytes that arrived although the answer did not.
      const passing = error instanceof ApiProblem && [0, 409, 429, 503].includes(error.status);
      if (!passing || signal.aborted || ++failures > TRIES) throw error;
      await new Promise((resolve) => setTimeout(resolve, WAIT_MS * failures));
      offset = await arrived(path, offset, signal);
    }
  }
  onShare(1);
}

/** Return how many bytes the service has; the last known number if it does not answer. */
async function arrived(path: string, known: number, signal: AbortSignal): Promise<number> {
  try {
    return Number((await ask(path, { method: "HEAD", signal })).headers.get("Upload-Offset"));
  } catch (error) {
    if (error instanceof ApiProblem && error.status === 0) return known;
    throw error;
  }
}
