// A new run: choose, see what it will take, submit.
import { ApiProblem, events, getJson, getWhole, pathOf, send } from "../../api";
import { element, fill } from "../../dom";
import { hrefOf, type Route } from "../../router";
import { inOrder, state } from "../../stages";
import type { Overview } from "../overview/values";
import { forecastTable } from "./job";
import { ended, type Job, type StageForecast } from "./values";

/** Show the form of a run. */
export async function showSubmission(root: HTMLElement, route: Route, signal: AbortSignal): Promise<void> {
  const { workspace } = route;
  const [found, tree] = await Promise.all([
    getJson<Overview>(pathOf(workspace), { signal }),
    getWhole<{ solutions: { name: string }[]; in_use: string }>(pathOf(workspace, "solutions"), "solutions", { signal }),
  ]);
  const boxes = inOrder(Object.keys(found.stages)).map((name) => ({ name, box: element("input", { type: "checkbox", value: name }) }));
  const solution = element(
    "select",
    { id: "solution" },
    ...tree.solutions.map(({ name }) => element("option", { value: name, selected: name === tree.in_use }, name === tree.in_use ? `${name} (in use)` : name)),
  );
  const only = element("input", { id: "only", size: 40, placeholder: "TR0001, TR0002", autocomplete: "off" });
  const within = element("input", { id: "within", size: 24, placeholder: "-85,120,30", autocomplete: "off" });
  const accept = element("input", { id: "accept", size: 40, autocomplete: "off" });
  const force = element("input", { id: "force", type: "checkbox" });
  const priority = element("input", { id: "priority", type: "number", min: -100, max: 100, value: 0, step: 1 });
  const settings = element("textarea", { id: "settings", rows: 4, cols: 60, spellcheck: "false", placeholder: '{"fuse": {"loss": "huber"}}' });
  const answer = element("section", { "aria-live": "polite" });
  // The same key again gives the first job: a second click submits nothing.
  let key = newKey();

  const form = element(
    "form",
    { class: "form run-only", onsubmit: (event: Event) => void forecast(event), oninput: () => fill(answer) },
    element(
      "fieldset",
      {},
      element("legend", {}, "Stages (none: all that are not up to date)"),
      ...boxes.map(({ name, box }) => element("label", { class: "stage" }, box, ` ${name} `, state(found.stages[name]!))),
    ),
    field("Solution", solution),
    field("Only these items (one stage)", only),
    field("Only within latitude, east longitude, metres", within),
    field("Accept findings with these codes", accept),
    field("Settings of this run (JSON, tables as in spcola.toml)", settings),
    field("Priority", priority),
    element("label", {}, force, " Also what is up to date"),
    element("div", { class: "row" }, element("button", { type: "submit", class: "main" }, "Forecast")),
  );
  fill(root, element("p", {}, element("a", { href: hrefOf(workspace, "jobs") }, "All jobs")), element("h1", {}, "New run"), form, answer);

  function parameters(): Record<string, unknown> {
    const given: Record<string, unknown> = { solution: solution.value, force: force.checked };
    const stages = boxes.filter(({ box }) => box.checked).map(({ name }) => name);
    if (stages.length) given.stages = stages;
    if (only.value.trim()) given.only = listOf(only.value);
    if (within.value.trim()) given.within = within.value.trim();
    if (accept.value.trim()) given.accept = listOf(accept.value);
    if (settings.value.trim()) given.settings = JSON.parse(settings.value);
    return given;
  }

  async function forecast(event: Event): Promise<void> {
    event.preventDefault();
    try {
      const given = parameters();
      const job = await send<Job>("POST", pathOf(workspace, "forecast"), { parameters: given }, { signal });
      fill(answer, element("p", { class: "quiet" }, "Forecast: the job waits for a worker …"));
      const done = await ending(job, signal);
      if (done.error) throw new ApiProblem(0, { detail: done.error.text, where: done.error.item });
      const { forecast: found } = done.result as { forecast: Record<string, StageForecast> };
      key = newKey();
      const submit = element("button", { type: "button", class: "main", onclick: () => void run(given) }, "Submit the run");
      fill(answer, element("h2", {}, "Forecast"), forecastTable(found), submit);
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    }
  }

  async function run(given: Record<string, unknown>): Promise<void> {
    try {
      const body = { kind: "run", parameters: given, priority: Number(priority.value) };
      const job = await send<Job>("POST", pathOf(workspace, "jobs"), body, { signal, headers: { "Idempotency-Key": key } });
      location.hash = hrefOf(workspace, "jobs", [job.id]);
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    }
  }
}

/** Return a job when nothing more happens to it. */
export async function ending(job: Job, signal: AbortSignal): Promise<Job> {
  const stop = new AbortController();
  let last = job;
  await events(
    `/events?job=${encodeURIComponent(job.id)}`,
    async ({ kind, content }) => {
      if (kind !== "state" || !["finished", "failed", "cancelled"].includes(String(content.state))) return;
      stop.abort();
    },
    AbortSignal.any([signal, stop.signal]),
  );
  signal.throwIfAborted();
  last = await getJson<Job>(`/jobs/${encodeURIComponent(job.id)}`, { signal });
  return ended(last) ? last : ending(last, signal);
}

/** Return a new idempotency key. */
export function newKey(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export function problem(error: unknown): HTMLElement {
  const line = error instanceof ApiProblem ? error.line : error instanceof SyntaxError ? `Settings are no JSON: ${error.message}` : error instanceof Error ? error.message : String(error);
  return element("p", { class: "problem", role: "alert" }, line);
}

function field(title: string, input: HTMLElement): HTMLElement {
  return element("div", { class: "field" }, element("label", { for: input.id }, title), input);
}

function listOf(text: string): string[] {
  return text.split(/[\s,]+/).filter(Boolean);
}
