// The list of jobs, as it changes.
import { ApiProblem, ask, events, getJson, nextOf, pathOf, send, type JobEvent } from "../../api";
import { element, fill } from "../../dom";
import { moment } from "../../format";
import { hrefOf, keepInAddress, type Route } from "../../router";
import { state } from "../../stages";
import { table } from "../../table";
import { progressBar, spent } from "./progress";
import { ended, type Job, type Progress } from "./values";

const STATES = ["waiting", "running", "finished", "failed", "cancelled"];
const PAGE = 50;
const TICK_MS = 1000;

/** Show the jobs of a workspace; their states and progress change as they happen. */
export async function showJobs(root: HTMLElement, route: Route, signal: AbortSignal): Promise<void> {
  const { workspace } = route;
  const asked = route.query.get("state") ?? "";
  const found = new Map<string, Job>();
  const place = element("div");
  const live = element("span", { class: "quiet", role: "status" });
  const more = element("button", { type: "button", hidden: true, onclick: () => void showMore() }, "Show more");
  let next: string | null = `${pathOf(workspace, "jobs")}?limit=${PAGE}${asked ? `&state=${asked}` : ""}`;

  fill(
    root,
    element("h1", {}, "Jobs"),
    element(
      "div",
      { class: "row" },
      element("a", { class: "button main run-only", href: hrefOf(workspace, "jobs", ["new"]) }, "New run"),
      element("a", { class: "button run-only", href: hrefOf(workspace, "jobs", ["new", "others"]) }, "Other jobs"),
      element("a", { class: "button", href: hrefOf(workspace, "jobs", ["uploads"]) }, "Uploads"),
      element("a", { class: "button", href: hrefOf(workspace, "jobs", ["outputs"]) }, "Outputs"),
      element("label", { for: "state" }, "State"),
      choice(asked),
      element("span", { class: "spacer" }),
      live,
    ),
    place,
    more,
  );
  await showMore();
  const ticking = setInterval(() => [...found.values()].some((job) => !ended(job)) && draw(), TICK_MS);
  signal.addEventListener("abort", () => clearInterval(ticking));
  void events(`/events?workspace=${encodeURIComponent(workspace)}`, (event) => void follow(event), signal, (connected) => {
    fill(live, connected ? "live" : "not connected, trying again");
    // What happened while the stream was broken, or before it began, is asked for.
    if (connected) void refresh();
  });

  async function showMore(): Promise<void> {
    if (!next) return;
    const answer = await ask(next, { signal });
    for (const job of ((await answer.json()) as { jobs: Job[] }).jobs) found.set(job.id, job);
    next = nextOf(answer);
    more.hidden = next === null;
    draw();
  }

  async function refresh(): Promise<void> {
    const path = `${pathOf(workspace, "jobs")}?limit=${PAGE}${asked ? `&state=${asked}` : ""}`;
    const { jobs } = await getJson<{ jobs: Job[] }>(path, { signal });
    for (const job of jobs) found.set(job.id, job);
    draw();
  }

  async function follow({ kind, content }: JobEvent): Promise<void> {
    const known = found.get(content.job);
    if (kind === "progress" && known) {
      known.progress = content as unknown as Progress;
      draw();
    } else if (kind === "state") {
      const job = await getJson<Job>(`/jobs/${encodeURIComponent(content.job)}`, { signal });
      if (!asked || asked === job.state) found.set(job.id, job);
      else found.delete(job.id);
      draw();
    }
  }

  async function cancel(job: Job): Promise<void> {
    try {
      found.set(job.id, await send<Job>("POST", `/jobs/${encodeURIComponent(job.id)}/cancel`, undefined, { signal }));
      draw();
    } catch (error) {
      fill(live, element("span", { class: "problem" }, error instanceof ApiProblem ? error.line : String(error)));
    }
  }

  function draw(): void {
    // A button that has the focus keeps it while the list changes around it.
    const focused = (document.activeElement as HTMLElement | null)?.dataset.job;
    const jobs = [...found.values()].sort((a, b) => (a.id < b.id ? 1 : -1));
    if (!jobs.length) fill(place, element("p", { class: "quiet" }, asked ? `No job is ${asked}.` : "No jobs yet."));
    else fill(place, listed(jobs, workspace, (job) => void cancel(job)));
    if (focused) place.querySelector<HTMLElement>(`[data-job="${focused}"]`)?.focus();
  }
}

function listed(jobs: Job[], workspace: string, cancel: (job: Job) => void): HTMLElement {
  return table<Job>(
    "Jobs",
    [
      { title: "Job", cell: (job) => element("a", { class: "mono", href: hrefOf(workspace, "jobs", [job.id]), "data-job": `link-${job.id}` }, job.id) },
      { title: "Kind", cell: (job) => whatOf(job) },
      { title: "State", cell: (job) => state(job.cancelling && !ended(job) ? "cancelling" : job.state) },
      {
        title: "Progress",
        cell: (job) => {
          if (job.error) return element("span", { class: "problem" }, `${job.error.item ? `${job.error.item}: ` : ""}${job.error.text}`);
          return job.state === "running" ? progressBar(job.progress, `Progress of ${job.id}`) : null;
        },
      },
      { title: "Time", number: true, cell: (job) => spent(job) },
      { title: "Submitted", cell: (job) => element("span", { class: "number" }, moment(job.submitted)) },
      { title: "User", cell: (job) => job.user },
      {
        title: "Cancel",
        cell: (job) =>
          !ended(job) &&
          element(
            "button",
            { type: "button", class: "small run-only", disabled: job.cancelling, "data-job": `cancel-${job.id}`, "aria-label": `Cancel ${job.id}`, onclick: () => cancel(job) },
            "Cancel",
          ),
      },
    ],
    jobs,
  );
}

/** Return the kind of a job, with the stages of a run. */
function whatOf(job: Job): string {
  const stages = (job.parameters.stages as string[] | undefined) ?? [];
  return stages.length ? `${job.kind}: ${stages.join(", ")}` : job.kind;
}

function choice(asked: string): HTMLElement {
  const select = element(
    "select",
    {
      id: "state",
      onchange: () => {
        keepInAddress({ state: select.value });
        window.dispatchEvent(new HashChangeEvent("hashchange"));
      },
    },
    element("option", { value: "" }, "all"),
    ...STATES.map((one) => element("option", { value: one, selected: one === asked }, one)),
  );
  return select;
}
