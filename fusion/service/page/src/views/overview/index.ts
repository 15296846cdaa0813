// A workspace at a glance: what it contains, where that lies, what has run, and what is wrong.
import { getJson, pathOf } from "../../api";
import { element, fill } from "../../dom";
import { count, metres, moment, partsPerMillion, withSigma } from "../../format";
import { hrefOf, type View } from "../../router";
import { inOrder, state } from "../../stages";
import { facts, table } from "../../table";
import { showCoverage } from "./coverage";
import { showLists } from "./lists";
import type { Coverage, Overview } from "./values";

export const overview: View = {
  title: "Overview",
  async open(root, route, signal) {
    const coverage = getJson<Coverage>(`${pathOf(route.workspace, "coverage")}?step_deg=5`, { signal });
    // Whoever awaits it below gets the problem; until then it is nobody's.
    coverage.catch(() => undefined);
    const found = await getJson<Overview>(pathOf(route.workspace), { signal });
    const map = element("section", { class: "coverage", "aria-labelledby": "coverage" });
    const lists = element("section", { class: "lists", "aria-labelledby": "lists" });
    fill(
      root,
      element("h1", {}, found.name),
      contents(found),
      problems(found),
      element(
        "div",
        { class: "columns" },
        element("div", { class: "side" }, results(found, route.workspace), stages(found, route.workspace)),
        map,
      ),
      lists,
    );
    await Promise.all([showCoverage(map, route, coverage, signal), showLists(lists, route, found, signal)]);
  },
};

function contents(found: Overview): HTMLElement {
  const numbers = ["scans", "returns", "images", "landmarks", "maplets", "mapolas", "fused", "bigmaps", "pairs", "released"] as const;
  const names: Record<string, string> = { fused: "fused maplets", released: "released DTMs" };
  return element(
    "div",
    { class: "strip" },
    facts([
      ["body", found.body],
      ["solution in use", found.solution],
      ["shape", found.shape ?? "none"],
      ...numbers.map((key): [string, string] => [names[key] ?? key, count(found[key])]),
    ]),
  );
}

function problems(found: Overview): HTMLElement | null {
  const unused = Object.keys(found.images_not_used).length;
  const lines = [
    ...found.problems.map((text) => element("li", { class: "problem" }, text)),
    ...found.findings.map((one) =>
      element("li", {}, state(one.severity), " ", element("strong", {}, one.stage), ` ${one.text} `, element("code", {}, one.code)),
    ),
    ...(unused ? [element("li", {}, `${count(unused)} images of the catalogue are not used`)] : []),
  ];
  if (!lines.length) return null;
  return element(
    "section",
    { class: "findings", "aria-labelledby": "findings" },
    element("h2", { id: "findings" }, found.problems.length ? "Problems and findings" : "Findings"),
    element("ul", {}, ...lines),
  );
}

function results({ results: { registration, scale } }: Overview, workspace: string): HTMLElement {
  return element(
    "section",
    { "aria-labelledby": "results" },
    element("h2", { id: "results" }, "Results"),
    registration &&
      facts([
        [
          "registration",
          element(
            "span",
            {},
            element("a", { href: hrefOf(workspace, "registration") }, registration.model),
            " ",
            registration.verdict && state(registration.verdict),
          ),
        ],
        ["scale of the lidar frame", withSigma(registration.scale, registration.scale_sigma)],
        ["mapolas used, rejected", `${count(registration.n_used)}, ${count(registration.n_rejected)}`],
      ]),
    scale &&
      facts([
        [
          "ε (SPC lengths × 1 + ε)",
          element(
            "span",
            {},
            element("a", { href: hrefOf(workspace, "scale") }, partsPerMillion(scale.epsilon, scale.epsilon_sigma)),
            " ",
            scale.verdict && state(scale.verdict),
          ),
        ],
        ["size correction", sizeText(scale.size_correction_m, scale.size_correction_sigma_m)],
        ["values used, rejected", `${count(scale.n_used)}, ${count(scale.n_rejected)}`],
      ]),
    !registration && !scale && element("p", { class: "quiet" }, "No registration and no scale yet."),
  );
}

function sizeText(value: number | null, sigma: number | null): string {
  const small = value !== null && Math.abs(value) < 0.1;
  return small ? withSigma(value * 1000, sigma && sigma * 1000, "mm") : sigma ? withSigma(value, sigma, "m") : metres(value);
}

function stages(found: Overview, workspace: string): HTMLElement {
  const names = inOrder(Object.keys(found.stages));
  return element(
    "section",
    { "aria-labelledby": "stages" },
    element("h2", { id: "stages" }, "Stages"),
    table<string>(
      "Stages",
      [
        { title: "Stage", cell: (name) => element("a", { href: hrefOf(workspace, "runs", [`${found.solution}:${name}`]) }, name) },
        { title: "State", cell: (name) => state(found.stages[name]!) },
        { title: "Verdict", cell: (name) => found.verdicts[name] && state(found.verdicts[name]) },
        { title: "Finished", cell: (name) => found.finished[name] && element("span", { class: "number" }, moment(found.finished[name])) },
      ],
      names,
    ),
    element("p", { class: "run-only" }, element("a", { href: hrefOf(workspace, "jobs", ["new"]) }, "Run stages")),
  );
}

