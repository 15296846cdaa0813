// The form of a job of any kind, made of the schema that the service has of it.
import { ApiProblem, getAll, getJson, getWhole, pathOf, send } from "../../api";
import { element, fill } from "../../dom";
import { hrefOf, type Route } from "../../router";
import { control, FieldProblem, unitOf } from "./fields";
import type { Control, Output, Store } from "./filechoice";
import { kindsOf, OF_NEW, OPEN, TITLES, uploadKind, type Kind, type Schema } from "./kinds";
import { uploadsOf } from "./sending";
import { newKey, problem } from "./submission";
import type { Job } from "./values";

/** Show the kinds that have a form. */
export async function showKinds(root: HTMLElement, { workspace }: Route, signal: AbortSignal): Promise<void> {
  const kinds = new Map((await kindsOf(signal)).map((one) => [one.kind, one]));
  const shown = Object.entries(TITLES).filter(([kind]) => kinds.has(kind));
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(workspace, "jobs") }, "All jobs")),
    element("h1", {}, "Other jobs"),
    element(
      "dl",
      { class: "kinds run-only" },
      ...shown.flatMap(([kind, title]) => [
        element("dt", {}, element("a", { href: hrefOf(workspace, "jobs", ["new", kind]) }, title)),
        element("dd", {}, plain(kinds.get(kind)!.parameters.description), " ", element("code", { class: "quiet" }, `spcola ${kinds.get(kind)!.command}`)),
      ]),
    ),
  );
}

/** Show the form of a kind; the query has values of parameters (`uploads=all`: those of its kind), or an earlier job's id as `again`. */
export async function showForm(root: HTMLElement, route: Route, name: string, signal: AbortSignal): Promise<void> {
  const { workspace, query } = route;
  const kind = (await kindsOf(signal)).find((one) => one.kind === name && name in TITLES);
  if (!kind) throw new ApiProblem(404, { detail: `there is no form for ${name}` });
  const [store, solutions] = await Promise.all([
    storeOf(workspace, signal),
    getWhole<{ solutions: { name: string }[] }>(pathOf(workspace, "solutions"), "solutions", { signal }),
  ]);
  const given = await startOf(name, query, store);
  const names = solutions.solutions.map((one) => one.name);
  const controls = new Map<string, Control>();
  const required = new Set(kind.parameters.required ?? []);
  const answer = element("div", { "aria-live": "polite" });
  const button = element("button", { type: "submit", class: "main" }, "Submit");
  // The same key again gives the first job: a second click submits nothing.
  let key = newKey();
  const panels = Map.groupBy(
    Object.entries(kind.parameters.properties).filter(([parameter]) => name !== "init" || !OF_NEW.has(parameter)),
    ([, schema]) => schema["x-panel"] ?? "",
  );

  const row = ([parameter, schema]: [string, Schema]): HTMLElement => {
    const made = control(name, parameter, schema, given[parameter], store, choicesOf(name, parameter, names));
    controls.set(parameter, made);
    const unit = unitOf(parameter);
    const described = `${parameter}-help`;
    const target = made.element.id === parameter ? made.element : (made.element.querySelector(`[id="${parameter}"]`) ?? made.element);
    target.setAttribute("aria-describedby", described);
    if (required.has(parameter) && target.matches("input, select")) target.setAttribute("required", "");
    return element(
      "div",
      { class: "field parameter" },
      element("label", { for: parameter }, parameter === "uploads" ? "files" : parameter.replace(/_/g, " "), unit && element("span", { class: "quiet" }, ` (${unit})`), required.has(parameter) && element("span", { class: "quiet" }, " – needed")),
      element("div", {}, made.element, element("p", { id: described, class: "help" }, plain(schema.description))),
    );
  };
  const panel = ([title, entries]: [string, [string, Schema][]]): HTMLElement => {
    if (!title) return element("div", {}, ...entries.map(row));
    const open = OPEN.has(title) || entries.some(([parameter]) => parameter in given);
    return element("details", { class: "panel", open }, element("summary", {}, title), ...entries.map(row));
  };
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(workspace, "jobs", ["new", "others"]) }, "Other jobs")),
    element("h1", {}, TITLES[name]!),
    element("p", {}, plain(kind.parameters.description), " As ", element("code", {}, `spcola ${kind.command}`), "."),
    element("form", { class: "form run-only", onsubmit: (event: Event) => void submit(event), oninput: () => (key = newKey()) }, ...[...panels].map(panel), element("div", { class: "row" }, button)),
    answer,
  );

  async function submit(event: Event): Promise<void> {
    event.preventDefault();
    fill(answer);
    root.querySelectorAll("[aria-invalid]").forEach((one) => one.removeAttribute("aria-invalid"));
    button.disabled = true;
    try {
      const body = { kind: name, parameters: parametersOf(kind!, controls) };
      const job = await send<Job>("POST", pathOf(workspace, "jobs"), body, { signal, headers: { "Idempotency-Key": key } });
      location.hash = hrefOf(workspace, "jobs", [job.id]);
    } catch (error) {
      if (signal.aborted) return;
      fill(answer, error instanceof FieldProblem ? element("p", { class: "problem", role: "alert" }, error.message) : problem(error));
      mark(root, error);
    } finally {
      button.disabled = false;
    }
  }
}

/** Return what there is to choose from in a workspace. */
async function storeOf(workspace: string, signal: AbortSignal): Promise<Store> {
  const [uploads, outputs] = await Promise.all([
    uploadsOf(workspace, signal),
    getAll<Output>(pathOf(workspace, "outputs"), "outputs", { signal }),
  ]);
  return { workspace, uploads, outputs, signal };
}

/** Return the values that a form begins with: those of the query, or of an earlier job. */
async function startOf(kind: string, query: URLSearchParams, { uploads, signal }: Store): Promise<Record<string, unknown>> {
  const again = query.get("again");
  if (again) return (await getJson<Job>(`/jobs/${encodeURIComponent(again)}`, { signal })).parameters;
  const given: Record<string, unknown> = Object.fromEntries(query);
  const all = uploads.filter((one) => one.kind === uploadKind(kind, "uploads") && one.state === "complete");
  if (query.has("uploads")) given.uploads = query.get("uploads") === "all" ? all.map((one) => one.id) : query.get("uploads")!.split(",");
  return given;
}

/** Return the solutions where a parameter is the name of one; null where it is not. */
function choicesOf(kind: string, parameter: string, names: string[]): string[] | null {
  if (parameter === "name" && kind.startsWith("solution-")) return names;
  if (parameter !== "solution") return null;
  return kind === "truth-assess" ? [...names, "all"] : names;
}

/** Return what is given and not the default. */
function parametersOf(kind: Kind, controls: Map<string, Control>): Record<string, unknown> {
  const found: Record<string, unknown> = {};
  for (const [parameter, made] of controls) {
    const value = made.read();
    const { default: standard } = kind.parameters.properties[parameter]!;
    if (value !== undefined && JSON.stringify(value) !== JSON.stringify(standard)) found[parameter] = value;
  }
  return found;
}

/** Show which parameter a problem is about: the first word of its place that is one. */
function mark(root: HTMLElement, error: unknown): void {
  const where = error instanceof FieldProblem ? error.parameter : error instanceof ApiProblem ? (error.problem.where ?? "") : "";
  for (const word of where.split(/[^a-z_]+/i)) {
    const found = word && root.querySelector<HTMLElement>(`form [id="${word}"]`);
    if (!found) continue;
    found.setAttribute("aria-invalid", "true");
    found.closest("details.panel")?.setAttribute("open", "");
    found.focus();
    return;
  }
}

/** Return a help text without marks of its source. */
function plain(text = ""): string {
  return text.replace(/`/g, "");
}
