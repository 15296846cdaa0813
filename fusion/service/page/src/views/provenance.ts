// What a file was made from, back to what was imported.
import { getJson } from "../api";
import { element, fill } from "../dom";
import { count, moment } from "../format";
import { hrefOf, type Route } from "../router";

interface Node {
  id: string;
  type: "file" | "group" | "run";
  digest?: string;
  made?: boolean;
  files?: Record<string, string>;
  finished?: string;
  version?: string;
}
interface Provenance {
  nodes: Node[];
  edges: [string, string][];
  solutions: { name: string; made_by: string; made: string }[];
}

/** Show a file, the run that made it, its inputs, and so on; each run once. */
export async function showProvenance(root: HTMLElement, route: Route, signal: AbortSignal): Promise<void> {
  const { workspace } = route;
  const product = route.query.get("product") ?? "";
  const field = element("input", { id: "product", size: 60, value: product, required: true, placeholder: "release/manifest.json" });
  const ask = (event: Event): void => {
    event.preventDefault();
    location.hash = hrefOf(workspace, "runs", ["provenance"], { product: field.value.trim() });
  };
  const place = element("div");
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(workspace, "runs") }, "All runs")),
    element("h1", {}, "Provenance"),
    element("form", { class: "row", onsubmit: ask }, element("label", { for: "product" }, "File"), field, element("button", { type: "submit" }, "Show")),
    place,
  );
  if (!product) return;
  const path = `/workspaces/${encodeURIComponent(workspace)}/provenance?product=${encodeURIComponent(product)}`;
  const found = await getJson<Provenance>(path, { signal });
  fill(
    place,
    element("ul", { class: "tree" }, branch(found, product, workspace, new Set())),
    element("h2", {}, "Solutions behind it"),
    element("ul", {}, ...found.solutions.map((one) => element("li", {}, `${one.name}: ${one.made_by}${one.made ? `, ${moment(one.made)}` : ""}`))),
  );
}

function branch(found: Provenance, id: string, workspace: string, seen: Set<string>): HTMLElement {
  const node = found.nodes.find((one) => one.id === id)!;
  const again = seen.has(id);
  seen.add(id);
  const sources = again ? [] : found.edges.filter(([made]) => made === id).map(([, source]) => source);
  // Files that were imported are many and have nothing behind them: they stand in one line.
  const kind = (one: string): Node => found.nodes.find((each) => each.id === one)!;
  const leaves = sources.filter((one) => kind(one).type !== "run" && !kind(one).made);
  const others = sources.filter((one) => !leaves.includes(one));
  // Behind all outputs of one run lies the same run.
  const groups = Map.groupBy(others, (one) => (kind(one).type === "run" ? one : makersOf(found, one)));
  const inner = [...groups].map(([maker, members]) =>
    members.length === 1 ? branch(found, members[0]!, workspace, seen) : gathered(found, members, maker, workspace, seen),
  );
  return element(
    "li",
    {},
    described(node, workspace, again && node.type === "run"),
    (inner.length > 0 || leaves.length > 0) &&
      element("ul", {}, ...inner, leaves.length > 0 && element("li", {}, gatheredText(leaves), " ", element("span", { class: "quiet" }, "imported"))),
  );
}

function gathered(found: Provenance, members: string[], maker: string, workspace: string, seen: Set<string>): HTMLElement {
  members.forEach((one) => seen.add(one));
  return element("li", {}, gatheredText(members), element("ul", {}, ...maker.split("\n").filter(Boolean).map((run) => branch(found, run, workspace, seen))));
}

function gatheredText(members: string[]): HTMLElement {
  if (members.length <= 3) return element("span", {}, members.join(", "));
  return element(
    "details",
    { class: "inline" },
    element("summary", {}, `${members[0]!} and ${count(members.length - 1)} more`),
    element("ul", {}, ...members.map((one) => element("li", {}, one))),
  );
}

function makersOf(found: Provenance, id: string): string {
  return found.edges
    .filter(([made]) => made === id)
    .map(([, source]) => source)
    .join("\n");
}

function described(node: Node, workspace: string, again: boolean): HTMLElement {
  if (node.type !== "run") return element("span", {}, node.id, node.digest && element("span", { class: "mono quiet", title: node.digest }, ` ${node.digest.slice(0, 12)}`));
  return element(
    "span",
    {},
    "made by ",
    element("a", { href: hrefOf(workspace, "runs", [node.id]) }, node.id),
    element("span", { class: "quiet" }, again ? " (see above)" : `, ${moment(node.finished)}, version ${node.version}`),
  );
}
