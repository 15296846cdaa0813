// Values on the vertices of the body, and their ranges.
import { getFloats, getJson } from "../../api";
import type { LayerAbout } from "../../layers";
import { pathOfLayer, pathOfLayers } from "../ahead";
import type { BodyMesh } from "./mesh";

const SHADE: LayerAbout = { name: "hillshade", text: "shape alone, lit", unit: "", colours: "gray" };
const RADIUS: LayerAbout = {
  name: "radius", text: "distance of the shape from the body's origin", unit: "m", colours: "viridis",
};
const SAMPLED = 50_000;

/** Return the layers that a body has: those of the shape, and those on it. */
export async function bodyLayers(workspace: string, signal: AbortSignal): Promise<LayerAbout[]> {
  const { layers } = await getJson<{ layers: LayerAbout[] }>(pathOfLayers(workspace), { signal });
  return [SHADE, ...layers, RADIUS];
}

/** Ask for the values of a layer that the service has; null if the page makes them itself. */
export function asked(
  workspace: string,
  layer: LayerAbout | undefined,
  facets: number,
  signal: AbortSignal,
): Promise<Float32Array> | null {
  if (!layer || layer === SHADE || layer === RADIUS) return null;
  return getFloats(pathOfLayer(workspace, layer.name, facets), { signal });
}

/** Return the values (V,) of a layer; null if it has none. */
export async function valuesOf(
  workspace: string,
  layer: LayerAbout,
  mesh: BodyMesh,
  facets: number,
  signal: AbortSignal,
): Promise<Float32Array | null> {
  return layer === RADIUS ? radiusOf(mesh) : asked(workspace, layer, facets, signal);
}

/** Return the range of colours for values, by the rules of the maps; [0, 1] if none is known. */
export function rangeOf(layer: LayerAbout, values: Float32Array | null): [number, number] {
  if (layer.colours === "source") return [0, 4];
  const step = Math.max(1, Math.floor((values?.length ?? 0) / SAMPLED));
  const known = (values ?? new Float32Array()).filter((value, k) => k % step === 0 && Number.isFinite(value));
  if (!known.length) return [0, 1];
  const symmetric = layer.name === "difference";
  const sorted = (symmetric ? known.map(Math.abs) : known).sort();
  const at = (share: number): number => sorted[Math.round(share * (sorted.length - 1))]!;
  if (symmetric) return [-at(0.98) || -1e-12, at(0.98) || 1e-12];
  const high = at(0.995);
  if (layer.name === "sigma" || layer.name === "count") return [0, Math.max(high, 1e-12)];
  const low = at(0.005);
  return high > low ? [low, high] : [low - 0.5, low + 0.5];
}

function radiusOf(mesh: BodyMesh): Float32Array {
  const { positions, center } = mesh;
  const found = new Float32Array(positions.length / 3);
  for (let k = 0; k < found.length; k++) {
    const x = positions[3 * k]! + center[0];
    const y = positions[3 * k + 1]! + center[1];
    const z = positions[3 * k + 2]! + center[2];
    found[k] = Math.sqrt(x * x + y * y + z * z);
  }
  return found;
}
