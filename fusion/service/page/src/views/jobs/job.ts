// One job: its state, progress, log and result as they come.
import { ApiProblem, events, getJson, send, type JobEvent } from "../../api";
import { element, fill } from "../../dom";
import { bytes, count, duration, moment } from "../../format";
import { hrefOf, type Route } from "../../router";
import { inOrder, state } from "../../stages";
import { facts, table } from "../../table";
import { TITLES } from "./kinds";
import { progressBar, spent } from "./progress";
import { ended, type Job, type Progress, type StageForecast } from "./values";

/** Parameters that name what a job writes for its user. */
const WRITING = ["out", "folder", "report"];

interface StageResult {
  stage: string;
  state: string;
  seconds: number | null;
  reason?: string;
}

/** Show a job; the stream of its events brings the log from its beginning. */
export async function showJob(root: HTMLElement, route: Route, id: string, signal: AbortSignal): Promise<void> {
  const path = `/jobs/${encodeURIComponent(id)}`;
  let job = await getJson<Job>(path, { signal });
  const head = element("div");
  const log = element("ol", { class: "log", role: "log", "aria-label": "Log of the job", tabindex: 0 });
  const result = element("section", { "aria-labelledby": "result" });
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(route.workspace, "jobs") }, "All jobs")),
    element("h1", {}, `Job ${id}`),
    head,
    element("h2", {}, "Log"),
    log,
    result,
  );
  draw();
  const stop = new AbortController();
  const both = AbortSignal.any([signal, stop.signal]);
  const ticking = setInterval(() => !ended(job) && drawHead(), 1000);
  signal.addEventListener("abort", () => clearInterval(ticking));
  void events(`/events?job=${encodeURIComponent(id)}`, (event) => void follow(event), both);

  async function follow({ kind, content }: JobEvent): Promise<void> {
    if (kind === "note") addLine(content.time, String(content.text));
    else if (kind === "progress" && !ended(job)) job.progress = content as unknown as Progress;
    else if (kind === "state") {
      addLine(content.time, stateLine(content));
      job = await getJson<Job>(path, { signal });
      draw();
      if (ended(job) && content.state === job.state) stop.abort();
      return;
    }
    drawHead();
  }

  function addLine(time: number, text: string): void {
    const atEnd = log.scrollTop + log.clientHeight >= log.scrollHeight - 8;
    log.append(element("li", {}, element("time", {}, moment(time).slice(11, 19)), " ", text));
    if (atEnd) log.scrollTop = log.scrollHeight;
  }

  function draw(): void {
    drawHead();
    fill(result, resultOf(job));
  }

  function drawHead(): void {
    const focused = head.contains(document.activeElement);
    const button = !ended(job) && element("button", { type: "button", class: "run-only", disabled: job.cancelling, onclick: () => void cancel() }, "Cancel");
    fill(
      head,
      facts([
        ["state", state(job.cancelling && !ended(job) ? "cancelling" : job.state)],
        ["kind", job.kind],
        ["user", job.user],
        ["submitted", moment(job.submitted)],
        ["begun", job.begun === null ? "not yet" : moment(job.begun)],
        ["time", spent(job)],
        ["tries", job.tries],
        ["priority", job.priority],
        ...(job.after.length ? [["after", job.after.join(", ")] as [string, string]] : []),
      ]),
      element("p", {}, "Parameters: ", element("code", {}, JSON.stringify(job.parameters))),
      job.state === "running" && progressBar(job.progress, "Progress of the job"),
      job.error &&
        element(
          "p",
          { class: "problem", role: "alert" },
          `${job.error.item ? `Item ${job.error.item}: ` : ""}${job.error.text} (${job.error.code})`,
        ),
      button && element("p", {}, button),
      ended(job) && job.kind in TITLES && element("p", { class: "run-only" }, element("a", { href: hrefOf(route.workspace, "jobs", ["new", job.kind], { again: job.id }) }, "Again, with changes")),
      job.state === "finished" && WRITING.some((name) => typeof job.parameters[name] === "string") && element("p", {}, element("a", { href: hrefOf(route.workspace, "jobs", ["outputs"]) }, "Outputs of jobs")),
    );
    if (focused && button) button.focus();
  }

  async function cancel(): Promise<void> {
    try {
      job = await send<Job>("POST", `${path}/cancel`, undefined, { signal });
      draw();
    } catch (error) {
      fill(head, element("p", { class: "problem", role: "alert" }, error instanceof ApiProblem ? error.line : String(error)));
    }
  }
}

function stateLine(content: JobEvent["content"]): string {
  const tries = Number(content.tries ?? 0);
  return `${String(content.state)}${tries > 1 ? `, try ${tries}` : ""}`;
}

function resultOf(job: Job): HTMLElement | null {
  const { forecast, stages } = job.result as { forecast?: Record<string, StageForecast>; stages?: unknown };
  if (forecast) return element("div", {}, element("h2", { id: "result" }, "Forecast"), forecastTable(forecast));
  if (!Object.keys(job.result).length) return null;
  return element(
    "div",
    {},
    element("h2", { id: "result" }, "Result"),
    // The description of a new workspace has states of stages by their names.
    Array.isArray(stages) &&
      table<StageResult>(
        "Stages of the run",
        [
          { title: "Stage", cell: (one) => one.stage },
          { title: "State", cell: (one) => one.state },
          { title: "Time", number: true, cell: (one) => duration(one.seconds) },
          { title: "Reason", cell: (one) => one.reason },
        ],
        stages as StageResult[],
      ),
    element("details", {}, element("summary", {}, "As JSON"), element("pre", { tabindex: 0 }, JSON.stringify(job.result, null, 2))),
  );
}

/** Return what each stage of a run will take, and all together. */
export function forecastTable(forecast: Record<string, StageForecast>): HTMLElement {
  const names = inOrder(Object.keys(forecast));
  const megabytes = (value: number | null): string => bytes(value === null ? null : value * 1e6);
  const all = Object.values(forecast);
  const sum = (key: "seconds" | "disk_mb"): number | null =>
    all.some((one) => one[key] === null) ? null : all.reduce((total, one) => total + one[key]!, 0);
  return element(
    "div",
    {},
    table<string>(
      "Forecast of the run",
      [
        { title: "Stage", cell: (name) => name },
        { title: "Items", number: true, cell: (name) => count(forecast[name]!.items) },
        { title: "Kept", number: true, cell: (name) => count(forecast[name]!.kept) },
        { title: "Time", number: true, cell: (name) => duration(forecast[name]!.seconds) },
        { title: "Memory", number: true, cell: (name) => megabytes(forecast[name]!.memory_mb) },
        { title: "Disk", number: true, cell: (name) => megabytes(forecast[name]!.disk_mb) },
        { title: "Known from", cell: (name) => [forecast[name]!.basis, forecast[name]!.reason].filter(Boolean).join(": ") },
      ],
      names,
    ),
    element(
      "p",
      {},
      `In all ${duration(sum("seconds"))}, ${megabytes(sum("disk_mb"))} of disk, at most ${megabytes(Math.max(...all.map((one) => one.memory_mb ?? 0)))} of memory.`,
    ),
  );
}
