// The solutions of a workspace as a tree, and how two of them differ.
import { getJson, getWhole, pathOf } from "../api";
import { element, fill, type Child } from "../dom";
import { count, degrees, metres, moment, number, partsPerMillion } from "../format";
import { hrefOf, type Route, type View } from "../router";
import { state } from "../stages";
import { facts, table } from "../table";

interface Solution {
  name: string;
  parent: string;
  made_by: string;
  made: string;
  version: string;
  facts: Record<string, unknown>;
  constants: Record<string, unknown>;
}
interface Tree {
  in_use: string;
  solutions: Solution[];
  problems: string[];
}
type Percentiles = { p50: number | null; p95: number | null; p100: number | null } | null;
interface Difference {
  first: string;
  second: string;
  images: number;
  maplets: number;
  heights_compared: number;
  only_first: string[];
  only_second: string[];
  common_scale: number | null;
  common_shift_m: number[] | null;
  common_rotation_deg: number[] | null;
  shape_radius_ratio: number | null;
  constants: Record<string, unknown>;
  [key: string]: unknown;
}

const ROWS: [key: string, title: string, show: (value: number | null) => string][] = [
  ["centers_moved_m", "Centres of maplets moved", (v) => metres(v)],
  ["centers_outward_m", "of that outward", (v) => metres(v)],
  ["centers_left_over_m", "left after the common transform", (v) => metres(v)],
  ["heights_changed_m", "Heights of maplets changed", (v) => metres(v)],
  ["positions_moved_m", "Positions of the spacecraft moved", (v) => metres(v)],
  ["pointing_turned_deg", "Pointing turned", (v) => angle(v)],
  ["cameras_changed_px", "Projection of the cameras changed", (v) => (v === null ? "unknown" : `${number(v, 3)} px`)],
];

export const solutions: View = {
  title: "Solutions",
  async open(root, route, signal) {
    const tree = await getWhole<Tree>(pathOf(route.workspace, "solutions"), "solutions", { signal });
    const place = element("section", { "aria-labelledby": "difference", "aria-live": "polite" });
    fill(
      root,
      element("h1", {}, "Solutions"),
      ...tree.problems.map((text) => element("p", { class: "problem" }, text)),
      branches(tree, "", route.workspace),
      tree.solutions.length > 1 && comparison(tree, route),
      place,
    );
    const [first, second] = route.path;
    if (!first || !second) return;
    fill(place, element("p", { class: "quiet" }, "Comparing …"));
    const path = pathOf(route.workspace, "solutions", first, "diff", second);
    fill(place, differenceOf(await getJson<Difference>(path, { signal })));
  },
};

/** Return the solutions made from one, each with those made from it. */
function branches(tree: Tree, parent: string, workspace: string): HTMLElement | null {
  const known = new Set(tree.solutions.map((one) => one.name));
  // Of a solution whose parent was removed nothing else shows the place.
  const children = tree.solutions.filter((one) => one.parent === parent || (!parent && !known.has(one.parent)));
  if (!children.length) return null;
  return element(
    "ul",
    { class: "tree" },
    ...children.map((one) => element("li", {}, described(one, tree, workspace), branches(tree, one.name, workspace))),
  );
}

function described(one: Solution, tree: Tree, workspace: string): HTMLElement {
  const own = Object.entries(one.facts).filter(([key]) => !key.endsWith("_sigma"));
  return element(
    "div",
    { class: "node" },
    element("div", {}, element("strong", {}, one.name), " ", one.name === tree.in_use && state("in use"), " ", actions(one, tree, workspace)),
    facts([
      ["made by", one.made_by],
      ...(one.made ? [["made", moment(one.made)] as [string, Child]] : []),
      ...own.map(([key, value]): [string, Child] => [key.replace(/_/g, " "), factText(key, value, one.facts)]),
      ...("lithos" in one.facts || "albedo" in one.facts
        ? [["maplets and images", element("a", { href: hrefOf(workspace, "photoclinometry", [], { solution: one.name }) }, "goodness of fit")] as [string, Child]]
        : []),
      ...(one.parent
        ? [
            [
              "differs from its parent",
              element("a", { href: hrefOf(workspace, "solutions", [one.parent, one.name]) }, `${one.parent} → ${one.name}`),
            ] as [string, Child],
          ]
        : []),
    ]),
  );
}

/** Return links to the forms of what can be done with a solution. */
function actions({ name }: Solution, tree: Tree, workspace: string): HTMLElement {
  const inUse = name === tree.in_use;
  const link = (title: string, kind: string): HTMLElement => element("a", { class: "run-only", href: hrefOf(workspace, "jobs", ["new", kind], { name }), "aria-label": `${title} ${name}` }, title);
  return element("span", { class: "links" }, !inUse && link("Use", "solution-use"), link("Export", "solution-export"), !inUse && name !== tree.solutions[0]!.name && link("Remove", "solution-remove"));
}

function factText(key: string, value: unknown, all: Record<string, unknown>): string {
  if (key === "epsilon") return partsPerMillion(value as number, all.epsilon_sigma as number);
  if (typeof value === "number") return number(value);
  if (Array.isArray(value)) return value.length ? value.join(", ") : "none";
  return typeof value === "string" ? value : JSON.stringify(value);
}

function comparison(tree: Tree, route: Route): HTMLElement {
  const options = (chosen: string | undefined): HTMLElement[] =>
    tree.solutions.map(({ name }) => element("option", { value: name, selected: name === chosen }, name));
  const first = element("select", { id: "first" }, ...options(route.path[0] ?? tree.solutions[0]!.name));
  const second = element("select", { id: "second" }, ...options(route.path[1] ?? tree.solutions.at(-1)!.name));
  const compare = (event: Event): void => {
    event.preventDefault();
    location.hash = hrefOf(route.workspace, "solutions", [first.value, second.value]);
  };
  return element(
    "form",
    { class: "row", onsubmit: compare },
    element("label", { for: "first" }, "From"),
    first,
    element("label", { for: "second" }, "to"),
    second,
    element("button", { type: "submit" }, "Compare"),
  );
}

function differenceOf(found: Difference): HTMLElement {
  const ratio = (value: number | null): string => (value === null ? "unknown" : `1 ${value < 1 ? "−" : "+"} ${partsPerMillion(Math.abs(value - 1))}`);
  return element(
    "div",
    {},
    element("h2", { id: "difference" }, `How far ${found.second} moved from ${found.first}`),
    facts([
      ["maplets in both", count(found.maplets)],
      ["images in both", count(found.images)],
      ["heights compared", count(found.heights_compared)],
      ["only in the first", found.only_first.length ? found.only_first.join(", ") : "none"],
      ["only in the second", found.only_second.length ? found.only_second.join(", ") : "none"],
      ["common scale", ratio(found.common_scale)],
      ["common shift x, y, z", vector(found.common_shift_m, (v) => metres(v))],
      ["common rotation x, y, z", vector(found.common_rotation_deg, angle)],
      ["radius of the shape", ratio(found.shape_radius_ratio)],
    ]),
    table(
      "Differences",
      [
        { title: "Difference", cell: (row: (typeof ROWS)[number]) => row[1] },
        ...(["p50", "p95", "p100"] as const).map((part) => ({
          title: { p50: "Median", p95: "95 %", p100: "Largest" }[part],
          number: true,
          cell: ([key, , show]: (typeof ROWS)[number]) => show((found[key] as Percentiles)?.[part] ?? null),
        })),
      ],
      ROWS,
    ),
    Object.keys(found.constants).length > 0 && element("pre", { tabindex: 0 }, JSON.stringify(found.constants, null, 2)),
  );
}

/** Return a small angle in degrees, arc seconds where it is small. */
function angle(value: number | null): string {
  if (value === null) return "unknown";
  const size = Math.abs(value);
  if (size >= 0.1) return degrees(value, 3);
  // Below lies the rounding of the files.
  return size * 3600 < 1e-6 ? "below 0.000001″" : `${number(value * 3600, 3)}″`;
}

function vector(values: number[] | null, show: (value: number | null) => string): string {
  return values === null ? "unknown" : values.map(show).join(", ");
}
