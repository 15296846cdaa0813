// The start: all workspaces that may be read, each with its state.
import { ApiProblem, getAll, getJson, pathOf } from "../api";
import { element, fill } from "../dom";
import { count, partsPerMillion } from "../format";
import { hrefOf, type View } from "../router";
import { inOrder, state } from "../stages";
import { table } from "../table";
import { newWorkspace } from "./beginning";
import type { Overview } from "./overview/values";

interface Row {
  name: string;
  overview: Overview | null;
  problem: string;
}

// Overviews read settings and file names of a workspace: not of hundreds at once.
const DESCRIBED = 30;

export const workspaces: View = {
  title: "Workspaces",
  async open(root, _route, signal) {
    const names = (await getAll<{ name: string }>("/workspaces", "workspaces", { signal })).map((one) => one.name);
    const place = element("div");
    fill(root, element("h1", {}, "Workspaces"), place, newWorkspace(signal));
    if (!names.length) {
      fill(place, element("p", { class: "quiet" }, "There is no workspace yet, or the token may read none."));
      return;
    }
    const rows: Row[] = names.map((name) => ({ name, overview: null, problem: "" }));
    fill(place, listed(rows));
    await Promise.all(
      rows.slice(0, DESCRIBED).map(async (row) => {
        try {
          row.overview = await getJson<Overview>(pathOf(row.name), { signal });
        } catch (error) {
          if (!(error instanceof ApiProblem)) throw error;
          row.problem = error.line;
        }
      }),
    );
    fill(place, listed(rows));
  },
};

function listed(rows: Row[]): HTMLElement {
  return table<Row>(
    "Workspaces",
    [
      { title: "Name", by: (row) => row.name, cell: (row) => element("a", { href: hrefOf(row.name, "overview") }, row.name) },
      { title: "Body", by: (row) => row.overview?.body, cell: (row) => row.overview?.body },
      ...(["scans", "images", "maplets", "mapolas", "fused"] as const).map((key) => ({
        title: key[0]!.toUpperCase() + key.slice(1),
        number: true,
        by: (row: Row) => row.overview?.[key],
        cell: (row: Row) => row.overview && count(row.overview[key]),
      })),
      {
        title: "ε",
        number: true,
        cell: ({ overview }) =>
          overview?.results.scale && partsPerMillion(overview.results.scale.epsilon, overview.results.scale.epsilon_sigma),
      },
      { title: "State", cell: stateOf },
    ],
    rows,
  );
}

/** Return what is to be known about the stages in one word or two. */
function stateOf(row: Row): Node | string | null {
  if (row.problem) return element("span", { class: "problem" }, row.problem);
  if (!row.overview) return null;
  const { stages, problems } = row.overview;
  if (problems.length) return state(`${problems.length} problem${problems.length > 1 ? "s" : ""}`);
  const next = inOrder(Object.keys(stages)).find((name) => stages[name] !== "up to date");
  return next ? element("span", { class: "quiet" }, `next: ${next}`) : state("up to date");
}
