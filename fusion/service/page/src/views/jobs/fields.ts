// A control for each parameter of a job, made of its schema.
import { element } from "../../dom";
import { bare, uploadKind, type Schema } from "./kinds";
import { fileChoice, type Control, type FileName, type Store } from "./filechoice";

const UNITS: [ending: string, unit: string][] = [
  ["_mrad", "mrad"], ["_mm", "mm"], ["_px", "px"], ["_deg", "°"], ["_km", "km"], ["_m", "m"], ["_s", "s"], ["_c", "°C"],
];

/** A value that the form cannot understand, and which parameter has it. */
export class FieldProblem extends Error {
  constructor(
    readonly parameter: string,
    text: string,
  ) {
    super(`${parameter}: ${text}`);
  }
}

/** Return the unit of a parameter, which its name has; "" if it has none. */
export function unitOf(parameter: string): string {
  return UNITS.find(([ending]) => parameter.endsWith(ending))?.[1] ?? "";
}

/** Return the control of a parameter; `given` is its value to begin with. */
export function control(kind: string, parameter: string, described: Schema, given: unknown, store: Store, choices: string[] | null): Control {
  const { schema, optional } = bare(described);
  const id = parameter;
  const value = given ?? described.default ?? undefined;
  const takes = described["x-takes"];
  if (takes === "file" || takes === "folder") {
    const several = schema.type === "array";
    const names = (value === undefined || value === null ? [] : several ? value : [value]) as FileName[];
    return fileChoice(id, uploadKind(kind, parameter), store, several, names);
  }
  if (choices) return selection(id, choices, value, optional || schema.type === "string");
  if (takes === "columns") return pairs(id, value as Record<string, string> | undefined, described["x-form"]);
  if (schema.enum) return selection(id, schema.enum, value, optional);
  if (schema.type === "boolean") return box(id, value === true || value === "true");
  if (schema.prefixItems) return numbers(id, schema, value as number[] | undefined);
  if (schema.type === "integer" || schema.type === "number") return oneNumber(id, schema, value as number | undefined);
  if (schema.type === "array") return texts(id, value as string[] | undefined);
  if (schema.type === "object") return json(id, value);
  const form = described["x-form"] ?? "";
  const words = form.includes("|") && !/[A-Z]/.test(form) ? form.split("|") : null;
  if (words) return selection(id, words, value || undefined, true);
  return text(id, String(value ?? ""), schema.pattern);
}

function text(id: string, value: string, pattern?: string): Control {
  const input = element("input", {
    id, value, pattern: pattern?.replace(/^\^|\$$/g, "").replace(/-\]/g, "\\-]"), title: pattern && "letters, digits and . _ + -, a letter or digit first",
    size: 36, autocomplete: "off", spellcheck: "false",
  });
  return { element: input, read: () => input.value.trim() || undefined };
}

function box(id: string, checked: boolean): Control {
  const input = element("input", { id, type: "checkbox", checked });
  return { element: input, read: () => input.checked };
}

function selection(id: string, all: (string | number)[], value: unknown, optional: boolean): Control {
  const select = element(
    "select",
    { id },
    optional && element("option", { value: "" }, "not given"),
    ...all.map((one, k) => element("option", { value: k, selected: one === value }, one)),
  );
  return { element: select, read: () => (select.value === "" ? undefined : all[Number(select.value)]) };
}

function numberInput(id: string, schema: Schema, value: number | undefined, label?: string): HTMLInputElement {
  const whole = schema.type === "integer";
  return element("input", {
    id, type: "number", step: whole ? 1 : "any", value, min: schema.minimum, max: schema.maximum,
    "aria-label": label, class: label ? "part" : undefined,
  });
}

function oneNumber(id: string, schema: Schema, value: number | undefined): Control {
  const input = numberInput(id, schema, value);
  return { element: input, read: () => (input.value === "" ? undefined : Number(input.value)) };
}

function numbers(id: string, schema: Schema, value: number[] | undefined): Control {
  const names = (schema["x-form"] ?? "").toLowerCase().split(" ");
  const inputs = schema.prefixItems!.map((one, k) => numberInput(k ? `${id}-${k}` : id, one, value?.[k], `${id} ${names[k] ?? k + 1}`));
  return {
    element: element("span", { class: "links", role: "group", "aria-label": id }, ...inputs),
    read: () => {
      const filled = inputs.filter((one) => one.value !== "");
      if (!filled.length) return undefined;
      if (filled.length < inputs.length) throw new FieldProblem(id, `all of ${names.join(", ")} are needed`);
      return inputs.map((one) => Number(one.value));
    },
  };
}

function texts(id: string, value: string[] | undefined): Control {
  const input = element("input", { id, value: (value ?? []).join(", "), size: 36, placeholder: "several with commas", autocomplete: "off" });
  return {
    element: input,
    read: () => {
      const all = input.value.split(",").map((one) => one.trim()).filter(Boolean);
      return all.length ? all : undefined;
    },
  };
}

function pairs(id: string, value: Record<string, string> | undefined, form = "NAME=COLUMN"): Control {
  const lines = Object.entries(value ?? {}).map((pair) => pair.join("="));
  const area = element("textarea", { id, rows: 4, cols: 36, spellcheck: "false", placeholder: `${form}, one a line` }, lines.join("\n"));
  return {
    element: area,
    read: () => {
      const given = area.value.split("\n").map((line) => line.trim()).filter(Boolean);
      if (!given.length) return undefined;
      return Object.fromEntries(
        given.map((line) => {
          const at = line.indexOf("=");
          if (at < 1 || at === line.length - 1) throw new FieldProblem(id, `${line} is not ${form}`);
          return [line.slice(0, at).trim(), line.slice(at + 1).trim()];
        }),
      );
    },
  };
}

function json(id: string, value: unknown): Control {
  const empty = !value || !Object.keys(value).length;
  const area = element("textarea", { id, rows: 3, cols: 48, spellcheck: "false", placeholder: '{"scale": {"method": "pairs"}}' }, empty ? "" : JSON.stringify(value));
  return {
    element: area,
    read: () => {
      if (!area.value.trim()) return undefined;
      try {
        return JSON.parse(area.value) as unknown;
      } catch (error) {
        throw new FieldProblem(id, `is no JSON: ${(error as Error).message}`);
      }
    },
  };
}
