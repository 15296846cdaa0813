// Maplets solved from images: goodness of fit of each maplet and image, and each maplet by itself.
import { getJson, getWhole, pathOf } from "../../api";
import { element, fill, type Child } from "../../dom";
import { count, fixed, metres, number } from "../../format";
import { labelled } from "../../look";
import { hrefOf, type Route, type View } from "../../router";
import { state } from "../../stages";
import { facts, table, type Column } from "../../table";
import { mapletView } from "./maplet";
import type { Goodness, GoodnessOfMaplet, Outliers, SolvedIndex } from "./values";

interface Tree {
  in_use: string;
  solutions: { name: string; facts: Record<string, unknown> }[];
}

export const photoclinometry: View = {
  title: "Photoclinometry",
  async open(root, route, signal) {
    const tree = await getWhole<Tree>(pathOf(route.workspace, "solutions"), "solutions", { signal });
    const names = tree.solutions.filter((one) => "lithos" in one.facts || "albedo" in one.facts).map((one) => one.name);
    const solution = route.query.get("solution") ?? (names.includes(tree.in_use) ? tree.in_use : names.at(-1));
    if (solution === undefined) {
      fill(root, element("h1", {}, "Photoclinometry"), nothing(route.workspace));
    } else if (route.path[0]) {
      await mapletView(root, route.workspace, route.path[0], { solution, inUse: solution === tree.in_use }, signal);
    } else {
      const path = `${pathOf(route.workspace, "photoclinometry")}?solution=${encodeURIComponent(solution)}`;
      const found = await getJson<SolvedIndex>(path, { signal });
      fill(root, element("h1", {}, "Photoclinometry"), choice(route.workspace, names, found.solution), ...index(found, route));
    }
    root.dataset.ready = "true";
  },
};

/** Say what makes maplets from images. */
function nothing(workspace: string): HTMLElement {
  return element(
    "p",
    { class: "quiet" },
    "No solution has maplets from images yet: spcola spc lithos makes one, or ",
    element("a", { href: hrefOf(workspace, "jobs", ["new", "spc-lithos"]) }, "a job"),
    ".",
  );
}

function choice(workspace: string, names: string[], chosen: string): HTMLElement {
  const select = element(
    "select",
    { onchange: () => (location.hash = hrefOf(workspace, "photoclinometry", [], { solution: select.value })) },
    ...[...new Set([...names, chosen])].map((name) => element("option", { value: name, selected: name === chosen }, name)),
  );
  return element("div", { class: "row" }, labelled("Solution", select));
}

function index(found: SolvedIndex, route: Route): HTMLElement[] {
  const maplets = new Set(found.maplets.map((one) => one.name));
  const link = (name: string): Child => (maplets.has(name) ? mapletLink(route.workspace, name, found.solution) : name);
  const worst = <T extends Goodness>(rows: T[]): T[] => [...rows].sort((a, b) => (b.residual ?? 0) - (a.residual ?? 0));
  const mapletColumns: Column<GoodnessOfMaplet>[] = [
    { title: "Maplet", cell: ({ name }) => link(name), by: ({ name }) => name },
    { title: "Outcome", cell: ({ outcome }) => state(outcome), by: ({ outcome }) => outcome },
    ...fitColumns(found.maplets),
    { title: "Sigma", cell: ({ sigma_m }) => metres(sigma_m), by: ({ sigma_m }) => sigma_m, number: true },
    // Heights are kept where only the albedo was solved.
    ...(found.maplets.some(({ height_m }) => height_m !== null) ? [lastChange] : []),
    codesColumn(),
  ];
  return [
    facts([
      ["maplets", count(found.maplets.length)],
      ...Object.entries(found.outcomes).map(([outcome, n]): [string, Child] => [outcome, count(n)]),
      ["residual of brightness", `${percent(found.residual_start)} → ${percent(found.residual)}`],
      ["images shifted by (rms)", metres(found.shift_m)],
      ["photometric function", found.options.photometry],
      ...likelyFunctions(found),
      ...otherFunctions(found),
    ]),
    findingList(found.findings, link),
    element("h2", {}, "Goodness of fit of maplets"),
    element(
      "p",
      { class: "quiet" },
      "Residual: robust standard deviation of an image about what is expected, relative, and over its noise: 1 fits as well as it can. Shift: how far an image lies from where its state puts it. Medians of a maplet over its images, of an image over its maplets; of shifts the root mean square.",
    ),
    table("Goodness of fit of maplets", mapletColumns, worst(found.maplets)),
    element("h2", {}, "Goodness of fit of images"),
    table(
      "Goodness of fit of images",
      [{ title: "Image", cell: ({ name }) => name, by: ({ name }) => name }, ...fitColumns(found.images), codesColumn()],
      worst(found.images),
    ),
  ];
}

const lastChange: Column<GoodnessOfMaplet> = {
  title: "Last change",
  cell: ({ height_m }) => metres(height_m),
  by: ({ height_m }) => height_m,
  number: true,
};

/** Functions that images do not distinguish from the one in use; what they change is in the sigmas. */
function likelyFunctions({ options: { other_photometry: others } }: SolvedIndex): [string, Child][] {
  return others ? [["in sigmas also", Object.keys(others).join(", ") || "no other is as good"]] : [];
}

/** How images fit with other photometric functions, where they were compared. */
function otherFunctions({ photometry_ratios: ratios }: SolvedIndex): [string, Child][] {
  const shown = Object.entries(ratios ?? {}).map(([name, ratio]) => `${name} ${fixed(ratio, 2)}`);
  return shown.length ? [["residual with others, coarse grid (below 0.95 another fits better)", shown.sort().join(", ")]] : [];
}

/** Return the columns that maplets and images share; those that are rarely needed if anything is in them. */
function fitColumns<T extends Goodness>(rows: T[]): Column<T>[] {
  const counted = (title: string, key: "used" | "contradicts" | "sun_reversed" | "not_seen"): Column<T> => ({
    title,
    cell: (row) => (key !== "used" && row[key] ? element("strong", {}, count(row[key])) : count(row[key])),
    by: (row) => row[key],
    number: true,
  });
  const rare = [counted("Contradicts", "contradicts"), counted("Sun reversed", "sun_reversed"), counted("Not seen", "not_seen")];
  return [
    { title: "Residual", cell: (row) => percent(row.residual), by: (row) => row.residual, number: true },
    { title: "÷ noise", cell: (row) => fixed(row.noise_ratio, 2), by: (row) => row.noise_ratio, number: true },
    { title: "Correlation", cell: (row) => fixed(row.correlation, 3), by: (row) => row.correlation, number: true },
    { title: "Shift, px", cell: (row) => fixed(row.shift_px, 2), by: (row) => row.shift_px, number: true },
    { title: "Shift", cell: (row) => metres(row.shift_m), by: (row) => row.shift_m, number: true },
    counted("Used", "used"),
    ...rare.filter(({ by }) => rows.some((row) => by!(row))),
  ];
}

function codesColumn<T extends Goodness>(): Column<T> {
  return { title: "Findings", cell: ({ codes }) => codes.join(", "), by: ({ codes }) => (codes.length ? codes.join(" ") : null) };
}

/** Return outliers by their codes, and what to do with them. */
export function findingList(findings: Outliers[], link: (name: string) => Child): HTMLElement {
  if (!findings.length) return element("p", {}, "No outliers.");
  const named = (names: string[]): Child[] => names.flatMap((name, k) => (k ? [", ", link(name)] : [link(name)]));
  return element(
    "ul",
    { class: "codes", "aria-label": "Findings" },
    ...findings.map((one) => element("li", {}, element("code", {}, one.code), " ", ...named(one.names.slice(0, 30)), one.names.length > 30 ? ` and ${one.names.length - 30} more` : "", `: ${one.do}`)),
  );
}

export function mapletLink(workspace: string, name: string, solution: string): HTMLElement {
  return element("a", { href: hrefOf(workspace, "photoclinometry", [name], { solution }) }, name);
}

export function percent(value: number | null): string {
  return value === null ? number(value) : `${fixed(100 * value, 1)} %`;
}
