// A choice among the files of a workspace: uploads, outputs of jobs, or files sent on the spot.
import { element, fill } from "../../dom";
import { bytes } from "../../format";
import type { Target } from "./sending";
import { transfer } from "./transfer";

/** A file as a job takes it: the id of an upload, or an output. */
export type FileName = string | { output: string };
export interface Output {
  name: string;
  bytes: number;
}
/** What there is to choose from; files that are sent are added. */
export interface Store extends Target {
  outputs: Output[];
}
export interface Control {
  element: HTMLElement;
  /** Return the value; undefined if nothing is given. */
  read(): unknown;
}

const keyOf = (name: FileName): string => (typeof name === "string" ? `upload ${name}` : `output ${name.output}`);

/** Return a choice of files of a kind; `several`: any number of them, else one. */
export function fileChoice(id: string, kind: string, store: Store, several: boolean, given: FileName[]): Control {
  const chosen = new Set(given.map(keyOf));
  const list = element("div", { class: "files" });
  const steps = element("ul", { class: "steps" });
  const sending = element("input", { type: "file", multiple: several, "aria-label": `Send files for ${id}`, onchange: () => void send() });

  async function send(): Promise<void> {
    sending.disabled = true;
    for (const file of sending.files ?? []) {
      const upload = await transfer(store, file, kind, steps);
      if (!upload) continue;
      if (!store.uploads.some((one) => one.id === upload.id)) store.uploads.push(upload);
      if (!several) chosen.clear();
      chosen.add(keyOf(upload.id));
    }
    sending.disabled = false;
    sending.value = "";
    draw();
  }

  function entries(): { name: FileName; text: string }[] {
    const complete = store.uploads.filter((one) => one.state === "complete");
    // Those of the expected kind first; the order of arrival is that of loading.
    const sorted = [...complete.filter((one) => one.kind === kind), ...complete.filter((one) => one.kind !== kind)];
    return [
      ...sorted.map((one) => ({ name: one.id, text: `${one.name} (${one.kind}, ${bytes(one.size)})` })),
      ...store.outputs.map((one) => ({ name: { output: one.name }, text: `${one.name} (output, ${bytes(one.bytes)})` })),
    ];
  }

  function choose(key: string, on: boolean): void {
    if (!several) chosen.clear();
    if (on) chosen.add(key);
    else chosen.delete(key);
  }

  function draw(): void {
    const all = entries();
    if (!several) {
      const select = element(
        "select",
        { id, onchange: () => choose(select.value, select.value !== "") },
        element("option", { value: "" }, all.length ? "none" : "none sent yet"),
        ...all.map(({ name, text }) => element("option", { value: keyOf(name), selected: chosen.has(keyOf(name)) }, text)),
      );
      fill(list, select);
      return;
    }
    const boxes = all.map(({ name, text }) => {
      const key = keyOf(name);
      const box = element("input", { type: "checkbox", checked: chosen.has(key), onchange: () => choose(key, box.checked) });
      return { key, box, line: element("label", {}, box, text) };
    });
    const every = (on: boolean): void => boxes.forEach(({ key, box }) => choose(key, (box.checked = on)));
    fill(
      list,
      element("div", { class: "boxes", role: "group", id, "aria-label": id, tabindex: boxes.length > 6 ? 0 : undefined }, ...(boxes.length ? boxes.map((one) => one.line) : ["none sent yet"])),
      boxes.length > 2 && element("span", { class: "links" },
        element("button", { type: "button", class: "small", onclick: () => every(true) }, "All"),
        element("button", { type: "button", class: "small", onclick: () => every(false) }, "None"),
      ),
    );
  }

  draw();
  return {
    element: element("div", {}, list, element("details", { class: "inline" }, element("summary", {}, "Send from this computer"), sending, steps)),
    read: () => {
      const names = entries().filter(({ name }) => chosen.has(keyOf(name))).map(({ name }) => name);
      return several ? (names.length ? names : undefined) : names[0];
    },
  };
}
