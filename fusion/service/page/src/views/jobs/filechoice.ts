// A choice among the files of a workspace: uploads, outputs of jobs, or files sent on the spot.
import { element, fill } from "../../dom";
import { bytes, count } from "../../format";
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
  let others = false;
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

  interface Entry {
    key: string;
    name: FileName;
    text: string;
    /** Whether it is of the kind that is usually taken. */
    usual: boolean;
  }

  function entries(): Entry[] {
    const complete = store.uploads.filter((one) => one.state === "complete");
    // The order of arrival is that of loading.
    return [
      ...complete.map((one) => ({ name: one.id, text: `${one.name} (${one.kind}, ${bytes(one.size)})`, usual: [kind, "other"].includes(one.kind) })),
      ...store.outputs.map((one) => ({ name: { output: one.name }, text: `${one.name} (output, ${bytes(one.bytes)})`, usual: !one.name.includes("/") })),
    ].map((one) => ({ ...one, key: keyOf(one.name) }));
  }

  function choose(key: string, on: boolean): void {
    if (!several) chosen.clear();
    if (on) chosen.add(key);
    else chosen.delete(key);
  }

  function draw(): void {
    const all = entries();
    const shown = all.filter((one) => others || one.usual || chosen.has(one.key));
    const hidden = all.length - shown.length;
    const more = hidden > 0 && element("button", { type: "button", class: "small", onclick: () => ((others = true), draw()) }, `Show ${count(hidden)} of other kinds`);
    const none = all.length ? "none" : "none sent yet";
    if (!several) {
      const select = element(
        "select",
        { id, onchange: () => choose(select.value, select.value !== "") },
        element("option", { value: "" }, none),
        ...shown.map(({ key, text }) => element("option", { value: key, selected: chosen.has(key) }, text)),
      );
      fill(list, select, more);
      return;
    }
    const boxes = shown.map(({ key, text }) => {
      const box = element("input", { type: "checkbox", checked: chosen.has(key), onchange: () => choose(key, box.checked) });
      return { key, box, line: element("label", {}, box, text) };
    });
    const every = (on: boolean): void => boxes.forEach(({ key, box }) => choose(key, (box.checked = on)));
    fill(
      list,
      boxes.length
        ? element("div", { class: "boxes", role: "group", id, "aria-label": id, tabindex: 0 }, ...boxes.map((one) => one.line))
        : element("p", { class: "help", id, tabindex: -1 }, none),
      element("span", { class: "links" },
        boxes.length > 2 && element("button", { type: "button", class: "small", onclick: () => every(true) }, "All"),
        boxes.length > 2 && element("button", { type: "button", class: "small", onclick: () => every(false) }, "None"),
        more,
      ),
    );
  }

  draw();
  return {
    element: element("div", {}, list, element("details", { class: "inline" }, element("summary", {}, "Send from this computer"), sending, steps)),
    read: () => {
      const names = entries().filter(({ key }) => chosen.has(key)).map(({ name }) => name);
      return several ? (names.length ? names : undefined) : names[0];
    },
  };
}
