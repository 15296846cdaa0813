// What views ask for first: it is asked for while their files are on their way.
import { pathOf } from "../api";
import type { Route } from "../router";

/** Facets that are asked for at most; the service makes them fewer. */
export const MOST_FACETS = 1_000_000;
/** Kinds of surfaces that have outlines on the body. */
export const OUTLINED = ["maplet", "mapola", "fused", "bigmap"];
/** Layers of the body that the page makes itself. */
const OWN_LAYERS = ["hillshade", "radius"];

/** Return the paths in the interface that a view asks for as soon as it opens. */
export function firstPaths(route: Route): string[] {
  return PATHS[route.view]?.(route) ?? [];
}

const PATHS: Record<string, (route: Route) => string[]> = {
  body: (route) => {
    const { workspace, query } = route;
    const [facets, layer] = [facetsOf(route), query.get("layer")];
    return [
      pathOfMesh(workspace, facets),
      pathOfLayers(workspace),
      ...(layer && !OWN_LAYERS.includes(layer) ? [pathOfLayer(workspace, layer, facets)] : []),
      ...outlinedOf(route).map((kind) => pathOfOutlines(workspace, kind)),
    ];
  },
  map: ({ workspace, path: [kind, name] }) =>
    kind && name ? [pathOfNames(workspace, kind), pathOfSurface(workspace, { kind, name })] : [],
  registration: ({ workspace }) => [pathOfResiduals(workspace), pathOfScanTable(workspace)],
};

/** Return how many facets of the body the address asks for at most. */
export function facetsOf(route: Route): number {
  const wanted = Number(route.query.get("facets"));
  return wanted >= 100 ? Math.min(wanted, 1 << 24) : MOST_FACETS;
}

/** Return the kinds of outlines that the address names. */
export function outlinedOf(route: Route): string[] {
  const chosen = (route.query.get("outlines") ?? "maplet").split(",");
  return OUTLINED.filter((kind) => chosen.includes(kind));
}

/** Where the mesh of the body lies in the interface. */
export function pathOfMesh(workspace: string, facets: number): string {
  return `${pathOf(workspace, "shape")}?facets=${facets}`;
}

/** Where the layers of the body are listed. */
export function pathOfLayers(workspace: string): string {
  return pathOf(workspace, "shape", "layers");
}

/** Where the values of a layer of the body lie. */
export function pathOfLayer(workspace: string, layer: string, facets: number): string {
  return `${pathOf(workspace, "shape", "layers", layer)}?facets=${facets}`;
}

/** Where the outlines of a kind of surfaces lie. */
export function pathOfOutlines(workspace: string, kind: string): string {
  return `${pathOf(workspace, "outlines")}?kind=${kind}`;
}

/** Where the names of all surfaces of a kind are listed. */
export function pathOfNames(workspace: string, kind: string): string {
  return `${pathOf(workspace, "surfaces")}?kind=${encodeURIComponent(kind)}&limit=10000`;
}

/** Where a surface lies in the interface. */
export function pathOfSurface(workspace: string, place: { kind: string; name: string }): string {
  return pathOf(workspace, "surfaces", place.kind, place.name);
}

/** Where the residuals of the registration lie. */
export function pathOfResiduals(workspace: string): string {
  return pathOf(workspace, "registration", "residuals");
}

/** Where the table of the corrections of scans lies. */
export function pathOfScanTable(workspace: string): string {
  return pathOf(workspace, "tables", "registration-scans");
}
