// Gets the mesh of the body, made ready in a worker.
import { getBytes } from "../../api";
import { pathOfMesh } from "../ahead";
import type { BodyMesh } from "./mesh";

declare const WORKER_MESH: string;

/** Return the mesh of a workspace, with the milliseconds of each step. */
export async function loadMesh(
  workspace: string,
  facets: number,
  signal: AbortSignal,
): Promise<{ mesh: BodyMesh; fetched: number; prepared: number }> {
  const begin = performance.now();
  // The worker starts while the bytes come.
  const worker = new Worker(WORKER_MESH, { type: "module" });
  try {
    const bytes = await getBytes(pathOfMesh(workspace, facets), { signal });
    const middle = performance.now();
    const mesh = await prepared(worker, bytes, signal);
    return { mesh, fetched: middle - begin, prepared: performance.now() - middle };
  } finally {
    worker.terminate();
  }
}

function prepared(worker: Worker, bytes: ArrayBuffer, signal: AbortSignal): Promise<BodyMesh> {
  return new Promise<BodyMesh>((resolve, reject) => {
    worker.onmessage = (event: MessageEvent<BodyMesh>) => resolve(event.data);
    worker.onerror = (event) => reject(new Error(`the mesh cannot be read: ${event.message}`));
    signal.addEventListener("abort", () => reject(signal.reason as Error));
    worker.postMessage(bytes, [bytes]);
  });
}
