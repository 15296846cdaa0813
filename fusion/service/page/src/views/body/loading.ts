// Gets the mesh of the body, made ready in a worker.
import { getBytes, pathOf } from "../../api";
import type { BodyMesh } from "./mesh";

declare const WORKER_MESH: string;

/** Facets that are asked for at most; the service makes them fewer. */
export const MOST_FACETS = 1_000_000;

/** Return the mesh of a workspace, with the milliseconds of each step. */
export async function loadMesh(
  workspace: string,
  facets: number,
  signal: AbortSignal,
): Promise<{ mesh: BodyMesh; fetched: number; prepared: number }> {
  const begin = performance.now();
  const bytes = await getBytes(`${pathOf(workspace, "shape")}?facets=${facets}`, { signal });
  const middle = performance.now();
  const mesh = await prepared(bytes, signal);
  return { mesh, fetched: middle - begin, prepared: performance.now() - middle };
}

function prepared(bytes: ArrayBuffer, signal: AbortSignal): Promise<BodyMesh> {
  const worker = new Worker(WORKER_MESH, { type: "module" });
  return new Promise<BodyMesh>((resolve, reject) => {
    worker.onmessage = (event: MessageEvent<BodyMesh>) => resolve(event.data);
    worker.onerror = (event) => reject(new Error(`the mesh cannot be read: ${event.message}`));
    signal.addEventListener("abort", () => reject(signal.reason as Error));
    worker.postMessage(bytes, [bytes]);
  }).finally(() => worker.terminate());
}
