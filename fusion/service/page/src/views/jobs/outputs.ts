// Files that jobs have written for their users: downloads, and removal.
import { getAll, pathOf, send } from "../../api";
import { element, fill } from "../../dom";
import { downloadLink } from "../../download";
import { bytes, count } from "../../format";
import { hrefOf, type Route } from "../../router";
import { table } from "../../table";
import type { Output } from "./filechoice";
import { problem } from "./submission";

/** Show the outputs of a workspace: files, and folders with what is in them. */
export async function showOutputs(root: HTMLElement, { workspace }: Route, signal: AbortSignal): Promise<void> {
  const place = element("section");
  const answer = element("div", { role: "status" });
  fill(
    root,
    element("p", {}, element("a", { href: hrefOf(workspace, "jobs") }, "All jobs")),
    element("h1", {}, "Outputs"),
    element("p", { class: "quiet" }, "Kernels, cameras, exported solutions and pages that jobs have written. Forms of other jobs take them as files."),
    answer,
    place,
  );
  await refresh();

  async function refresh(): Promise<void> {
    const outputs = await getAll<Output>(pathOf(workspace, "outputs"), "outputs", { signal });
    const whole = Map.groupBy(outputs, (one) => one.name.split("/")[0]!);
    fill(place, whole.size ? listed([...whole]) : element("p", { class: "quiet" }, "No outputs yet."));
  }

  function listed(whole: [string, Output[]][]): HTMLElement {
    const sizeOf = (own: Output[]): number => own.reduce((sum, one) => sum + one.bytes, 0);
    return table<[string, Output[]]>(
      "Outputs",
      [
        { title: "Output", by: ([name]) => name, cell: ([name, own]) => (isFile(name, own) ? link(own[0]!) : folder(name, own)) },
        { title: "Size", number: true, by: ([, own]) => sizeOf(own), cell: ([, own]) => bytes(sizeOf(own)) },
        {
          title: "Remove",
          cell: ([name]) => element("button", { type: "button", class: "small run-only", "aria-label": `Remove ${name}`, onclick: () => void remove(name) }, "Remove"),
        },
      ],
      whole,
    );
  }

  function folder(name: string, own: Output[]): HTMLElement {
    return element("details", {}, element("summary", {}, `${name}/ (${count(own.length)} files)`), element("ul", { class: "steps" }, ...own.map((one) => element("li", {}, link(one), ` ${bytes(one.bytes)}`))));
  }

  function link({ name }: Output): HTMLElement {
    const path = `${pathOf(workspace, "outputs")}/${name.split("/").map(encodeURIComponent).join("/")}`;
    return downloadLink(path, name.split("/").at(-1)!, name);
  }

  async function remove(name: string): Promise<void> {
    try {
      await send("DELETE", pathOf(workspace, "outputs", name), undefined, { signal });
      fill(answer, `${name} is removed.`);
      await refresh();
    } catch (error) {
      if (!signal.aborted) fill(answer, problem(error));
    }
  }
}

function isFile(name: string, own: Output[]): boolean {
  return own.length === 1 && own[0]!.name === name;
}
