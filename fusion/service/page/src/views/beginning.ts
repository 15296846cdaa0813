// A new workspace: empty, with a shape, or of the files of an SPC working folder.
import { pathOf, send } from "../api";
import { element, fill } from "../dom";
import { count } from "../format";
import { hrefOf } from "../router";
import { newKey, problem } from "./jobs/submission";
import { uploadsOf } from "./jobs/sending";
import { transfer } from "./jobs/transfer";
import type { Job } from "./jobs/values";

const LISTS = ["PICTLIST.TXT", "LMRKLIST.TXT", "MAPLIST.TXT"];
const FOLDERS = ["MAPFILES", "LMKFILES", "SUMFILES", "IMAGEFILES", "NOMINALS"];
const RECORD = "solution.json";
const AT_ONCE = 4;

/** The files of an SPC working folder that a job takes, its shape, and whether it has several. */
export interface SpcFolder {
  files: File[];
  shape: File | null;
  problem: string;
}

/** Sort the files of a chosen folder: the same ones as `spcola init --spc` takes of it. */
export function spcFolder(chosen: File[]): SpcFolder {
  const files: File[] = [];
  const shapes: File[] = [];
  for (const file of chosen) {
    // The first part is the name of the folder itself.
    const [, ...inside] = file.webkitRelativePath.split("/");
    const [folder = "", name = ""] = inside;
    if (inside.length === 1 && [...LISTS, RECORD].includes(folder)) files.push(file);
    if (inside.length !== 2 || name.startsWith(".")) continue;
    if (FOLDERS.includes(folder)) files.push(file);
    else if (folder === "SHAPEFILES") shapes.push(file);
  }
  const named = shapes.find((one) => one.name === "SHAPE.TXT");
  const several = shapes.length > 1 && !named;
  const none = !files.length && !shapes.length;
  const why = none ? `is no SPC working folder: it has none of ${[...FOLDERS, "SHAPEFILES"].join(", ")}` : "";
  const which = several ? `has several shapes (${shapes.map((one) => one.name).join(", ")}): leave one, or name it SHAPE.TXT` : "";
  return { files, shape: named ?? shapes[0] ?? null, problem: why || which };
}

/** Return the form of a new workspace. */
export function newWorkspace(signal: AbortSignal): HTMLElement {
  const name = element("input", { id: "new-name", required: true, pattern: "[A-Za-z0-9][A-Za-z0-9_.\\-]*", maxlength: 64, autocomplete: "off" });
  const body = element("input", { id: "new-body", required: true, maxlength: 100, autocomplete: "off" });
  const folder = element("input", { id: "new-spc", type: "file", webkitdirectory: true, multiple: true });
  const shape = element("input", { id: "new-shape", type: "file" });
  const unit = element("select", { id: "new-unit" }, element("option", {}, "km"), element("option", {}, "m"));
  const button = element("button", { type: "submit", class: "main" }, "Make");
  const answer = element("div", { role: "status" });
  const steps = element("div");

  async function make(event: Event): Promise<void> {
    event.preventDefault();
    fill(steps);
    button.disabled = true;
    try {
      const spc = folder.files?.length ? spcFolder([...folder.files]) : null;
      if (spc?.problem) throw new Error(`The folder ${spc.problem}.`);
      await submit(spc?.files ?? [], shape.files?.[0] ?? spc?.shape ?? null);
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    } finally {
      button.disabled = false;
    }
  }

  async function submit(files: File[], given: File | null): Promise<void> {
    const all = [...files.map((file) => ({ file, kind: "spc" })), ...(given ? [{ file: given, kind: "shape" }] : [])];
    const target = { workspace: name.value, uploads: await uploadsOf(name.value, signal), signal };
    const ids: string[] = [];
    let done = 0;
    // Small files wait for answers, not for the line: some at a time.
    const rest = all.entries();
    const sender = async (): Promise<void> => {
      for (const [k, { file, kind }] of rest) {
        const own = element("ul", { class: "steps" });
        steps.append(own);
        const sent = await transfer(target, file, kind, own);
        if (!sent) throw new Error("A file was not sent: choose Make again; the others need not be sent again.");
        own.remove();
        ids[k] = sent.id;
        fill(answer, element("p", { class: "quiet" }, `${count(++done)} of ${count(all.length)} files are sent.`));
      }
    };
    await Promise.all(Array.from({ length: AT_ONCE }, sender));
    const parameters = {
      body: body.value, shape_unit: unit.value,
      uploads: ids.slice(0, files.length), shape: given ? ids.at(-1)! : null,
    };
    const job = await send<Job>("POST", pathOf(name.value, "jobs"), { kind: "init", parameters }, { signal, headers: { "Idempotency-Key": newKey() } });
    fill(answer, "The workspace is being made: ", element("a", { href: hrefOf(name.value, "jobs", [job.id]) }, "its job"));
  }

  const line = (title: string, ...inputs: HTMLElement[]): HTMLElement => element("div", { class: "field" }, element("label", { for: inputs[0]!.id }, title), element("span", {}, ...inputs));
  return element(
    "details",
    { class: "below admin-only" },
    element("summary", {}, "New workspace"),
    element(
      "form",
      { class: "form", onsubmit: (event: Event) => void make(event) },
      line("Name", name),
      line("Body", body),
      line("SPC working folder, if there is one", folder),
      line("Shape model, if not in that folder", shape),
      line("Unit of a shape that states none", unit),
      element("div", { class: "row" }, button),
    ),
    steps,
    answer,
  );
}
