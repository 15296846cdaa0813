// Files from this computer to the workspace: sent in parts, then imported by a job.
import { pathOf, send } from "../../api";
import { element, fill } from "../../dom";
import { bytes, count, moment } from "../../format";
import { hrefOf, type Route } from "../../router";
import { state } from "../../stages";
import { table } from "../../table";
import { TITLES, UPLOADS } from "./kinds";
import { uploadsOf, type Upload } from "./sending";
import { problem } from "./submission";
import { transfer } from "./transfer";

/** Which job takes uploads of a kind as its files. */
const TAKEN: Record<string, string> = { scan: "import", image: "images", spc: "init" };

/** Show the uploads of a workspace, and send further files. */
export async function showUploads(root: HTMLElement, route: Route, signal: AbortSignal): Promise<void> {
  const { workspace } = route;
  const kind = element("select", { id: "kind" }, ...Object.entries(UPLOADS).map(([name, title]) => element("option", { value: name }, title)));
  const files = element("input", { id: "files", type: "file", multiple: true, required: true });
  const steps = element("ul", { class: "steps", "aria-live": "off" });
  const place = element("section", { "aria-labelledby": "there" });
  const answer = element("div", { role: "status" });
  const button = element("button", { type: "submit", class: "main" }, "Send");
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(workspace, "jobs") }, "All jobs")),
    element("h1", {}, "Uploads"),
    element(
      "form",
      { class: "row run-only", onsubmit: (event: Event) => void start(event) },
      element("label", { for: "kind" }, "What"),
      kind,
      element("label", { for: "files" }, "Files"),
      files,
      button,
    ),
    element("p", { class: "quiet run-only" }, "A transfer that broke off goes on where it was when the same file is chosen again."),
    steps,
    answer,
    place,
  );
  await refresh();

  async function start(event: Event): Promise<void> {
    event.preventDefault();
    button.disabled = true;
    const target = { workspace, uploads: await uploadsOf(workspace, signal), signal };
    for (const file of files.files ?? []) await transfer(target, file, kind.value, steps);
    button.disabled = false;
    files.value = "";
    if (!signal.aborted) await refresh();
  }

  async function refresh(): Promise<void> {
    const uploads = await uploadsOf(workspace, signal);
    fill(
      place,
      element("h2", { id: "there" }, "Arrived"),
      uploads.length ? listed(uploads) : element("p", { class: "quiet" }, "No uploads wait."),
      element(
        "div",
        { class: "row" },
        ...Object.entries(TAKEN).map(([of, job]) => {
          const ready = uploads.filter((one) => one.kind === of && one.state === "complete");
          const query = { uploads: "all" };
          return ready.length > 0 && element("a", { class: "button main run-only", href: hrefOf(workspace, "jobs", ["new", job], query) }, `${TITLES[job]!} (${ready.length}) …`);
        }),
        uploads.some((one) => one.state === "complete") && element("button", { type: "button", class: "run-only", onclick: () => void removeImported() }, "Remove all imported"),
      ),
    );
  }

  function listed(uploads: Upload[]): HTMLElement {
    return table<Upload>(
      "Uploads",
      [
        { title: "File", by: (one) => one.name, cell: (one) => one.name },
        { title: "What", by: (one) => one.kind, cell: (one) => UPLOADS[one.kind] ?? one.kind },
        { title: "Arrived", number: true, by: (one) => one.offset, cell: (one) => `${bytes(one.offset)} of ${bytes(one.size)}` },
        { title: "State", cell: (one) => state(one.state) },
        { title: "Begun", by: (one) => one.created, cell: (one) => element("span", { class: "number" }, moment(one.created)) },
        { title: "User", cell: (one) => one.user },
        {
          title: "Remove",
          cell: (one) => element("button", { type: "button", class: "small run-only", "aria-label": `Remove ${one.name}`, onclick: () => void remove(one) }, "Remove"),
        },
      ],
      uploads,
    );
  }

  async function removeImported(): Promise<void> {
    try {
      const done = await send<{ removed: number; bytes: number }>("DELETE", pathOf(workspace, "uploads"), undefined, { signal });
      const { removed } = done;
      fill(answer, removed ? `${count(removed)} ${removed === 1 ? "upload is" : "uploads are"} removed (${bytes(done.bytes)}).` : "No upload is imported yet.");
      await refresh();
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    }
  }

  async function remove(upload: Upload): Promise<void> {
    try {
      await send("DELETE", pathOf(workspace, "uploads", upload.id), undefined, { signal });
      await refresh();
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    }
  }
}
