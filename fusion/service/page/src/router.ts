// The state of a view is in the address after "#": a link to it shows the same to a colleague.

export interface Route {
  /** Name of the workspace; empty in the list of workspaces. */
  workspace: string;
  /** Name of the view, a key of `VIEWS`. */
  view: string;
  /** What follows the view: ["fused", "AA0001"] in "#/bennu/map/fused/AA0001". */
  path: string[];
  query: URLSearchParams;
}

export interface View {
  /** Heading and title of the window. */
  title: string;
  /** Fill `root`; listeners, streams and drawing end when `signal` aborts. */
  open(root: HTMLElement, route: Route, signal: AbortSignal): Promise<void>;
}

/** Where views of the whole service have the name of a workspace; none can be called so. */
const ALL = "-";

/** Return the route of an address such as "#/bennu/map/fused/AA0001?layer=sigma". */
export function routeOf(hash: string): Route {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?", 2);
  const [first = "", view = "", ...rest] = path.split("/").filter(Boolean).map(decoded);
  const workspace = first === ALL ? "" : first;
  return { workspace, view: view || (workspace ? "overview" : "workspaces"), path: rest, query: new URLSearchParams(query) };
}

/** Return the address of a route. */
export function hrefOf(
  workspace: string,
  view = "",
  path: string[] = [],
  query: URLSearchParams | Record<string, string> = {},
): string {
  const parts = [workspace || (view && ALL), view, ...path].filter(Boolean).map(encodeURIComponent);
  const asked = new URLSearchParams(query).toString();
  return `#/${parts.join("/")}${asked ? `?${asked}` : ""}`;
}

/** Write state of the open view into the address, without opening it again; "" removes a key. */
export function keepInAddress(entries: Record<string, string>): void {
  const route = routeOf(location.hash);
  for (const [key, value] of Object.entries(entries)) {
    if (value) route.query.set(key, value);
    else route.query.delete(key);
  }
  const href = hrefOf(route.workspace, route.view, route.path, route.query);
  history.replaceState(history.state, "", href);
}

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
