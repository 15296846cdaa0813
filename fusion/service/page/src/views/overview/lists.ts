// What the workspace contains, list by list and page by page.
import { ask, nextOf, pathOf } from "../../api";
import { element, fill } from "../../dom";
import { count, fixed } from "../../format";
import { hrefOf, keepInAddress, type Route } from "../../router";
import { table, type Column } from "../../table";
import type { Overview } from "./values";

type Item = Record<string, unknown> & { name: string; problem?: string };
interface Answer {
  items: Item[];
  total: number;
  next: string | null;
}

const PAGE = 50;
const KINDS = ["scans", "images", "maplets", "mapolas", "fused", "bigmaps", "pairs"] as const;
type Kind = (typeof KINDS)[number];

/** Show the lists of a workspace; which one is open is in the address. */
export async function showLists(root: HTMLElement, route: Route, found: Overview, signal: AbortSignal): Promise<void> {
  const place = element("div", { id: "list-panel", role: "tabpanel", tabindex: 0 });
  const tabs = KINDS.map((kind) =>
    element(
      "button",
      { type: "button", role: "tab", id: `tab-${kind}`, "aria-controls": "list-panel", onclick: () => void show(kind) },
      `${kind[0]!.toUpperCase()}${kind.slice(1)} `,
      element("span", { class: "quiet" }, count(found[kind])),
    ),
  );
  const bar = element("div", { role: "tablist", "aria-labelledby": "lists", onkeydown: (event: Event) => move(event as KeyboardEvent) }, ...tabs);
  fill(root, element("h2", { id: "lists" }, "Lists"), bar, place);
  const asked = route.query.get("list") as Kind | null;
  await show(asked && KINDS.includes(asked) ? asked : "scans", false);

  async function show(kind: Kind, keep = true): Promise<void> {
    tabs.forEach((tab, k) => {
      const chosen = KINDS[k] === kind;
      tab.setAttribute("aria-selected", String(chosen));
      tab.tabIndex = chosen ? 0 : -1;
    });
    place.setAttribute("aria-labelledby", `tab-${kind}`);
    if (keep) keepInAddress({ list: kind });
    await showPage(kind, `${pathOf(route.workspace, kind)}?limit=${PAGE}`);
  }

  async function showPage(kind: Kind, path: string, before: Item[] = []): Promise<void> {
    const page = await pageOf(kind, path, signal);
    const items = [...before, ...page.items];
    const next = page.next;
    fill(
      place,
      items.length ? table<Item>(`List of ${kind}`, columnsOf(kind, route.workspace), items) : element("p", { class: "quiet" }, `No ${kind}.`),
      next &&
        element(
          "button",
          { type: "button", onclick: () => void showPage(kind, next, items) },
          `Show more (${count(items.length)} of ${count(page.total)})`,
        ),
    );
  }

  function move(event: KeyboardEvent): void {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = tabs.findIndex((tab) => tab === document.activeElement);
    const next = (at + step + tabs.length) % tabs.length;
    tabs[next]!.focus();
    void show(KINDS[next]!);
  }
}

async function pageOf(kind: Kind, path: string, signal: AbortSignal): Promise<Answer> {
  const answer = await ask(path, { signal });
  const content = (await answer.json()) as Record<string, unknown>;
  return { items: content[kind] as Item[], total: content.total as number, next: nextOf(answer) };
}

const value = (item: Item, key: string): number | null => (typeof item[key] === "number" ? (item[key] as number) : null);
const text = (item: Item, key: string): string => (typeof item[key] === "string" ? (item[key] as string) : "");

function numeric(title: string, key: string, show: (value: number | null) => string): Column<Item> {
  return { title, number: true, by: (item) => value(item, key), cell: (item) => (item.problem ? "" : show(value(item, key))) };
}

/** Return a column of numbers in one unit, which its title has. */
function inUnit(title: string, key: string, decimals: number, factor = 1): Column<Item> {
  return numeric(title, key, (v) => fixed(v === null ? v : v * factor, decimals));
}

const PLACE: Column<Item>[] = [inUnit("East longitude (°)", "longitude_deg", 2), inUnit("Latitude (°)", "latitude_deg", 2)];
const GRID: Column<Item>[] = [...PLACE, inUnit("Radius (m)", "radius_m", 2), inUnit("Side (m)", "side_m", 2), inUnit("GSD (m)", "gsd_m", 3)];

/** Return the columns of a list; names of surfaces lead to their maps. */
function columnsOf(kind: Kind, workspace: string): Column<Item>[] {
  const surface = { maplets: "maplet", mapolas: "mapola", fused: "fused" }[kind as string];
  const name: Column<Item> = {
    title: "Name",
    by: (item) => item.name,
    cell: (item) => {
      if (item.problem) return element("span", { class: "problem" }, `${item.name}: ${item.problem}`);
      return surface ? element("a", { href: hrefOf(workspace, "map", [surface, item.name]) }, item.name) : item.name;
    },
  };
  const surfaces: Column<Item> = {
    title: "Maps",
    cell: (item) =>
      element("span", {}, ...((item.surfaces as string[] | undefined) ?? []).flatMap((one) => [
        element("a", { href: hrefOf(workspace, "map", [kind === "pairs" ? "pair" : "bigmap", one]) }, one.split(":").pop()!),
        " ",
      ])),
  };
  return [name, ...(kind === "bigmaps" || kind === "pairs" ? [surfaces] : []), ...COLUMNS[kind]];
}

const COLUMNS: Record<Kind, Column<Item>[]> = {
  scans: [
    { title: "First shot (UTC)", by: (item) => value(item, "first_et_s"), cell: (item) => text(item, "first_utc") },
    { title: "Last shot (UTC)", by: (item) => value(item, "last_et_s"), cell: (item) => text(item, "last_utc") },
    numeric("Returns", "returns", count),
    {
      title: "Rejected on import",
      cell: (item) =>
        Object.entries((item.rejected as Record<string, number> | undefined) ?? {})
          .map(([why, n]) => `${count(n)} ${why}`)
          .join(", "),
    },
    { title: "Trajectory", by: (item) => text(item, "trajectory"), cell: (item) => text(item, "trajectory") },
  ],
  images: [
    { title: "Time (UTC)", by: (item) => text(item, "utc"), cell: (item) => text(item, "utc") },
    { title: "Size", cell: (item) => (item.pixels ? `${String(item.pixels)} × ${String(item.lines)}` : "") },
    numeric("Landmarks", "landmarks", count),
    inUnit("Distance (m)", "distance_m", 1),
    ...PLACE,
    { title: "Pixels", by: (item) => String(item.has_pixels), cell: (item) => (item.has_pixels ? "there" : "none") },
  ],
  maplets: GRID,
  mapolas: [...GRID, inUnit("Coverage (%)", "coverage", 1, 100), numeric("Returns", "returns", count)],
  fused: GRID,
  bigmaps: GRID,
  pairs: [
    inUnit("ε (ppm)", "epsilon", 1, 1e6),
    inUnit("Range (m)", "range_m", 1),
    inUnit("dx (m)", "dx_m", 3),
    inUnit("dy (m)", "dy_m", 3),
    inUnit("Correlation", "correlation", 3),
    { title: "Used", by: (item) => String(item.used), cell: (item) => (item.used === undefined ? "" : item.used ? "yes" : "rejected") },
  ],
};
