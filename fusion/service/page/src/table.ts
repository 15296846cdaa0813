// Tables: one row for each thing, numbers to the right, columns that sort.
import { element, fill, type Child } from "./dom";
import { count } from "./format";

export interface Column<T> {
  title: string;
  /** Content of a cell. */
  cell: (row: T) => Child;
  /** Whether it is a number: aligned to the right. */
  number?: boolean;
  /** What the column sorts by; without it, it does not. */
  by?: (row: T) => number | string | null | undefined;
}

// Rows that are made at first: browsers lay out some ten thousand cells a second.
const ROWS = 250;

/** Return a table with a caption that names it for those who do not see it. */
export function table<T>(caption: string, columns: Column<T>[], rows: T[]): HTMLElement {
  const body = element("tbody");
  let shown = rows;
  let all = rows.length <= ROWS;
  const more = element("button", { type: "button", class: "more", onclick: () => showAll() }, `Show all ${count(rows.length)} rows`);
  const heads = columns.map((column) => {
    const style = column.number ? "number" : undefined;
    if (!column.by) return element("th", { scope: "col", class: style }, column.title);
    const head = element(
      "th",
      { scope: "col", class: style },
      element("button", { type: "button", class: "sort", onclick: () => sort(column, head) }, column.title),
    );
    return head;
  });

  function sort(column: Column<T>, head: HTMLElement): void {
    const down = head.getAttribute("aria-sort") === "ascending";
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    shown = [...rows].sort((a, b) => compare(column.by!(a), column.by!(b)) * (down ? -1 : 1));
    show();
  }

  function showAll(): void {
    all = true;
    more.remove();
    show();
  }

  function show(): void {
    fill(
      body,
      ...(all ? shown : shown.slice(0, ROWS)).map((row) =>
        element(
          "tr",
          {},
          ...columns.map(({ cell, number }) => element("td", { class: number ? "number" : undefined }, cell(row))),
        ),
      ),
    );
  }

  show();
  return element(
    "div",
    { class: "scroll", role: "region", "aria-label": caption, tabindex: 0 },
    element("table", {}, element("caption", { class: "hidden" }, caption), element("thead", {}, element("tr", {}, ...heads)), body),
    all ? null : more,
  );
}

/** Return names with their values; unknown ones too, so that nobody looks for them in vain. */
export function facts(entries: [name: string, value: Child][]): HTMLElement {
  return element(
    "dl",
    { class: "facts" },
    ...entries.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))),
  );
}

function compare(a: number | string | null | undefined, b: number | string | null | undefined): number {
  if (a === b) return 0;
  if (a === null || a === undefined) return 1;
  if (b === null || b === undefined) return -1;
  return a < b ? -1 : 1;
}
