// Runs of stages: the last ones, one with its settings and files, two compared; where a file comes from.
import { getAll, getJson, pathOf } from "../api";
import { element, fill, type Child } from "../dom";
import { count, moment } from "../format";
import { hrefOf, type Route, type View } from "../router";
import { state } from "../stages";
import { facts, table } from "../table";
import { showProvenance } from "./provenance";

interface Run {
  id: string;
  solution: string;
  stage: string;
  finished: string;
  version: string;
  key: string;
  settings_digest: string;
  verdict: string | null;
  inputs: number;
  outputs: number;
}
interface Recorded extends Omit<Run, "inputs" | "outputs" | "verdict"> {
  settings: unknown;
  summary: Record<string, unknown>;
  inputs: Record<string, string>;
  outputs: Record<string, string>;
}
type Pairs = Record<string, [unknown, unknown]>;
interface Difference {
  first: string;
  second: string;
  same: boolean;
  settings: Pairs;
  results: Pairs;
  inputs: Pairs;
  outputs: Pairs;
}

export const runs: View = {
  title: "Runs",
  async open(root, route, signal) {
    const [first, second] = route.path;
    if (first === "provenance") await showProvenance(root, route, signal);
    else if (first && second) await showDifference(root, route, first, second, signal);
    else if (first) await showRun(root, route, first, signal);
    else await showRuns(root, route, signal);
  },
};

async function showRuns(root: HTMLElement, { workspace }: Route, signal: AbortSignal): Promise<void> {
  const found = await getAll<Run>(pathOf(workspace, "runs"), "runs", { signal });
  const options = (chosen: number): HTMLElement[] => found.map(({ id }, k) => element("option", { value: id, selected: k === chosen }, id));
  const first = element("select", { id: "first" }, ...options(0));
  const second = element("select", { id: "second" }, ...options(1));
  const compare = (event: Event): void => {
    event.preventDefault();
    location.hash = hrefOf(workspace, "runs", [first.value, second.value]);
  };
  fill(
    root,
    element("h1", {}, "Runs"),
    element("p", { class: "quiet" }, "The last run of each stage in each solution. Equal keys mean equal inputs, settings and version."),
    table<Run>(
      "Runs",
      [
        { title: "Run", by: (run) => run.id, cell: (run) => element("a", { href: hrefOf(workspace, "runs", [run.id]) }, run.id) },
        { title: "Finished", by: (run) => run.finished, cell: (run) => element("span", { class: "number" }, moment(run.finished)) },
        { title: "Verdict", by: (run) => run.verdict, cell: (run) => run.verdict && state(run.verdict) },
        { title: "Inputs", number: true, by: (run) => run.inputs, cell: (run) => count(run.inputs) },
        { title: "Outputs", number: true, by: (run) => run.outputs, cell: (run) => count(run.outputs) },
        { title: "Version", cell: (run) => element("span", { class: "mono" }, run.version) },
        { title: "Settings", cell: (run) => digest(run.settings_digest) },
        { title: "Key", cell: (run) => digest(run.key) },
      ],
      found,
    ),
    found.length > 1 &&
      element(
        "form",
        { class: "row", onsubmit: compare },
        element("label", { for: "first" }, "Compare"),
        first,
        element("label", { for: "second" }, "with"),
        second,
        element("button", { type: "submit" }, "Compare"),
      ),
  );
}

async function showRun(root: HTMLElement, { workspace }: Route, id: string, signal: AbortSignal): Promise<void> {
  const run = await getJson<Recorded>(pathOf(workspace, "runs", id), { signal });
  fill(
    root,
    back(workspace),
    element("h1", {}, `Run ${run.id}`),
    facts([
      ["stage", run.stage],
      ["solution", run.solution],
      ["finished", moment(run.finished)],
      ["version", run.version],
      ["settings", digest(run.settings_digest)],
      ["key", digest(run.key)],
    ]),
    part("Summary", json(run.summary), true),
    part("Settings", json(run.settings)),
    part(`Inputs (${count(Object.keys(run.inputs).length)})`, files(run.inputs, workspace)),
    part(`Outputs (${count(Object.keys(run.outputs).length)})`, files(run.outputs, workspace, true)),
  );
}

async function showDifference(root: HTMLElement, { workspace }: Route, first: string, second: string, signal: AbortSignal): Promise<void> {
  const found = await getJson<Difference>(pathOf(workspace, "runs", first, "diff", second), { signal });
  const shown = ["settings", "results", "inputs", "outputs"] as const;
  fill(
    root,
    back(workspace),
    element("h1", {}, `${first} and ${second}`),
    element("p", {}, found.same ? "Equal results are to be expected." : "They are runs of different stages, or their inputs, settings or version differ."),
    ...shown.map((name) => {
      const rows = Object.entries(found[name]);
      const title = `${name[0]!.toUpperCase()}${name.slice(1)} that differ (${count(rows.length)})`;
      return rows.length
        ? part(
            title,
            table<[string, [unknown, unknown]]>(
              title,
              [
                { title: "Name", by: ([key]) => key, cell: ([key]) => element("code", {}, key) },
                { title: first, cell: ([, pair]) => value(pair[0]) },
                { title: second, cell: ([, pair]) => value(pair[1]) },
              ],
              rows,
            ),
            name === "settings" || name === "results",
          )
        : element("p", {}, `${name[0]!.toUpperCase()}${name.slice(1)}: no difference.`);
    }),
  );
}

function back(workspace: string): HTMLElement {
  return element("p", {}, element("a", { href: hrefOf(workspace, "runs") }, "All runs"));
}

function part(title: string, content: HTMLElement, open = false): HTMLElement {
  return element("details", { open, class: "below" }, element("summary", {}, title), content);
}

function files(found: Record<string, string>, workspace: string, made = false): HTMLElement {
  return table<[string, string]>(
    made ? "Outputs" : "Inputs",
    [
      { title: "File", cell: ([name]) => (made ? element("a", { href: hrefOf(workspace, "runs", ["provenance"], { product: name }) }, name) : name) },
      { title: "SHA-256", cell: ([, sum]) => element("span", { class: "mono" }, sum) },
    ],
    Object.entries(found),
  );
}

function json(content: unknown): HTMLElement {
  return element("pre", { tabindex: 0 }, JSON.stringify(content, null, 2));
}

function digest(text: string): Child {
  return element("span", { class: "mono", title: text }, text.slice(0, 12));
}

function value(of: unknown): Child {
  if (of === null) return element("span", { class: "quiet" }, "none");
  const text = typeof of === "string" ? of : JSON.stringify(of);
  return element("span", { class: "mono" }, /^[0-9a-f]{64}$/.test(text) ? text.slice(0, 12) : text);
}
