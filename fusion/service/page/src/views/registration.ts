// Residuals of the registration: where, how large, and which matches were rejected.
import { ApiProblem, getJson } from "../api";
import { element, fill } from "../dom";
import { degrees, metres, number } from "../format";
import { labelled } from "../look";
import { histogram, pointsPlot, type Points } from "../plots";
import { hrefOf, keepInAddress, type Route, type View } from "../router";
import { table, type Column } from "../table";
import { pathOfResiduals, pathOfScanTable } from "./ahead";

interface Match {
  name: string;
  used: boolean;
  cause: string | null;
  reason: string;
  longitude_deg: number;
  latitude_deg: number;
  size_m: number | null;
  residual_east_m: number | null;
  residual_north_m: number | null;
  residual_up_m: number | null;
  correlation?: number | null;
  coverage?: number | null;
}

interface Residuals {
  model: string;
  verdict: string | null;
  n_used: number;
  n_rejected: number;
  matches: Match[];
}

interface ScanTable {
  columns: Record<string, (number | string | null)[]>;
}

type Key = keyof Match;

const MEASURES: [key: Key, title: string][] = [
  ["residual_up_m", "up"], ["residual_east_m", "east"], ["residual_north_m", "north"], ["size_m", "size"],
];
const ACROSS: [key: Key, title: string][] = [["longitude_deg", "longitude (° E)"], ["latitude_deg", "latitude (°)"]];
const COLUMNS: Column<Match>[] = [
  { title: "State", cell: (match) => (match.used ? "used" : element("span", { class: "rejected" }, "✕ rejected")), by: (match) => Number(match.used) },
  angle("Longitude", "longitude_deg"),
  angle("Latitude", "latitude_deg"),
  length("East", "residual_east_m"),
  length("North", "residual_north_m"),
  length("Up", "residual_up_m"),
  length("Size", "size_m"),
  { title: "Correlation", cell: (match) => number(match.correlation, 4), by: (match) => match.correlation, number: true },
  { title: "Coverage", cell: (match) => number(match.coverage, 2), by: (match) => match.coverage, number: true },
  { title: "Cause", cell: (match) => match.reason || match.cause || "", by: (match) => match.cause },
];

export const registration: View = {
  title: "Registration",
  async open(root, route, signal) {
    const [found, scans] = await Promise.all([
      getJson<Residuals>(pathOfResiduals(route.workspace), { signal }),
      scanTable(route.workspace, signal),
    ]);
    fill(root, element("h1", {}, "Registration"), summary(found), element("div", { class: "plots" }), element("h2", {}, "Matches"), matchTable(found.matches, route));
    const plots = root.querySelector<HTMLElement>(".plots")!;
    drawPlots(plots, found.matches, route, signal);
    if (scans) drawScans(plots, scans, signal);
    root.dataset.ready = "true";
  },
};

async function scanTable(workspace: string, signal: AbortSignal): Promise<ScanTable | null> {
  try {
    return await getJson<ScanTable>(pathOfScanTable(workspace), { signal });
  } catch (error) {
    // A registration by hand may have none.
    if (error instanceof ApiProblem && error.status === 404) return null;
    throw error;
  }
}

function summary({ model, verdict, n_used: used, n_rejected: rejected, matches }: Residuals): HTMLElement {
  // Those that were never matched have no residual: the plots cannot show them.
  const without = matches.filter((match) => !match.used && typeof match.size_m !== "number");
  const causes = new Map<string, number>();
  for (const { cause } of without) causes.set(cause ?? "other", (causes.get(cause ?? "other") ?? 0) + 1);
  const listed = [...causes].map(([cause, count]) => `${count} ${cause}`).join(", ");
  const missing = listed ? `, of which without a residual: ${listed}` : "";
  const text = `Model ${model}: ${used} matches used, ${rejected} rejected${missing}${verdict ? `; ${verdict}` : ""}.`;
  return element("p", {}, text, " Residuals are those of the mapolas against the maplets.");
}

/** Return the used and the rejected matches as groups of points. */
function groupsOf(matches: Match[], x: Key, y: Key): [Points[], Match[][]] {
  const known = matches.filter((match) => typeof match[x] === "number" && typeof match[y] === "number");
  const groups: Points[] = [];
  const members: Match[][] = [];
  for (const used of [true, false]) {
    const some = known.filter((match) => match.used === used);
    if (!some.length) continue;
    members.push(some);
    groups.push({
      label: used ? "used" : "rejected",
      x: some.map((match) => match[x] as number),
      y: some.map((match) => match[y] as number),
      colour: used ? "--used" : "--rejected",
      shape: used ? "circle" : "cross",
      titles: some.map((match) => match.name),
    });
  }
  return [groups, members];
}

function drawPlots(root: HTMLElement, matches: Match[], route: Route, signal: AbortSignal): void {
  const measure = choice("Residual", MEASURES, route.query.get("residual"));
  const across = choice("Against", ACROSS, route.query.get("against"));
  const where = element("div", { class: "plot" });
  const plane = element("div", { class: "plot" });
  const spread = element("div", { class: "plot" });
  const open = (members: Match[][]) => (series: number, index: number) => {
    location.hash = hrefOf(route.workspace, "map", ["mapola", members[series]![index]!.name]);
  };
  let drawn = new AbortController();
  signal.addEventListener("abort", () => drawn.abort());
  const draw = (): void => {
    drawn.abort();
    drawn = new AbortController();
    fill(where);
    fill(spread);
    const [key, title] = MEASURES.find(([each]) => each === measure.value)!;
    const [x, name] = ACROSS.find(([each]) => each === across.value)!;
    const [groups, members] = groupsOf(matches, x, key);
    const span: [number, number] = x === "longitude_deg" ? [0, 360] : [-90, 90];
    pointsPlot(where, groups, { x: name, y: `${title} (m)` }, { levels: [zero()], spanX: span, stepX: span[1] === 360 ? 60 : 30, onPick: open(members) }, drawn.signal);
    const used = matches.filter((match) => match.used).map((match) => match[key] as number | null).filter((each) => each !== null);
    if (used.length) histogram(spread, used, `${title} of used matches (m)`, "--used", drawn.signal);
    keepInAddress({ residual: key === MEASURES[0]![0] ? "" : key, against: x === ACROSS[0]![0] ? "" : x });
  };
  measure.onchange = draw;
  across.onchange = draw;
  fill(
    root,
    figure("Residuals over the body", where, element("div", { class: "row" }, labelled("Residual", measure), labelled("Against", across))),
    figure("Histogram", spread),
    figure("Horizontal residuals", plane),
  );
  draw();
  const [groups, members] = groupsOf(matches, "residual_east_m", "residual_north_m");
  pointsPlot(plane, groups, { x: "east (m)", y: "north (m)" }, { levels: [zero()], onPick: open(members) }, signal);
}

/** Draw how far each scan was moved, if scans have corrections of their own. */
function drawScans(root: HTMLElement, { columns }: ScanTable, signal: AbortSignal): void {
  const names = (columns.name ?? columns.scan ?? []).map(String);
  const x = names.map((_, k) => k);
  const known = (key: string): number[] => (columns[key] ?? []).map((each) => (typeof each === "number" ? each : Number.NaN));
  const axes: [key: string, shape: Points["shape"], colour: string][] = [["x", "circle", "--spc"], ["y", "square", "--lidar"], ["z", "cross", "--fused"]];
  const groups = axes.map(([axis, shape, colour]) => ({
    label: axis, x, y: known(`offset_m_${axis}`), sigma: known(`offset_sigma_m_${axis}`), colour, shape, titles: names,
  }));
  if (!names.length || !groups.every((each) => each.y.some(Number.isFinite))) return;
  const place = element("div", { class: "plot" });
  root.append(figure("Offsets of scans", place));
  const few = names.length <= 12 ? names : undefined;
  pointsPlot(place, groups, { x: few ? "" : "scan", y: "offset (m)" }, { levels: [zero()], names: few, spanX: [-0.5, names.length - 0.5] }, signal);
}

function matchTable(matches: Match[], route: Route): HTMLElement {
  const largest = [...matches].sort((one, two) => (two.size_m ?? Infinity) - (one.size_m ?? Infinity));
  const name: Column<Match> = {
    title: "Mapola",
    cell: (match) => element("a", { href: hrefOf(route.workspace, "map", ["mapola", match.name]) }, match.name),
    by: (match) => match.name,
  };
  return table("Matches", [name, ...COLUMNS], largest);
}

function angle(title: string, key: "longitude_deg" | "latitude_deg"): Column<Match> {
  return { title, cell: (match) => degrees(match[key]), by: (match) => match[key], number: true };
}

function length(title: string, key: "residual_east_m" | "residual_north_m" | "residual_up_m" | "size_m"): Column<Match> {
  return { title, cell: (match) => metres(match[key]), by: (match) => match[key], number: true };
}

function choice(label: string, options: [Key, string][], chosen: string | null): HTMLSelectElement {
  return element("select", { "aria-label": label }, ...options.map(([key, title]) => element("option", { value: key, selected: key === chosen }, title)));
}

function zero() {
  return { y: 0, sigma: 0, colour: "--quiet" };
}

function figure(title: string, plot: HTMLElement, ...more: HTMLElement[]): HTMLElement {
  return element("section", { class: "card" }, element("h2", {}, title), ...more, plot);
}
