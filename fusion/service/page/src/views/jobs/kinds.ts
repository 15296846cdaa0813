// Kinds of jobs as the service describes them: a JSON schema each, which forms are made of.
import { getAll } from "../../api";

/** The schema of a parameter; the keys with "x-" are what a form needs in addition to its type. */
export interface Schema {
  type?: "string" | "integer" | "number" | "boolean" | "array" | "object" | "null";
  anyOf?: Schema[];
  enum?: (string | number)[];
  items?: Schema;
  prefixItems?: Schema[];
  pattern?: string;
  minimum?: number;
  maximum?: number;
  default?: unknown;
  description?: string;
  "x-panel"?: string;
  "x-form"?: string;
  "x-takes"?: "file" | "folder" | "output" | "columns";
}
export interface Kind {
  kind: string;
  command: string;
  parameters: { description?: string; required?: string[]; properties: Record<string, Schema> };
}

/** Titles of the kinds that have a form made of their schema, in the order of the list. */
export const TITLES: Record<string, string> = {
  import: "Import lidar scans",
  images: "Import images",
  init: "Add SPC files",
  sumfiles: "Make states of images",
  kernels: "Write SPICE kernels",
  "camera-convert": "Convert a camera",
  "camera-calibrate": "Calibrate a camera",
  "scale-apply": "Apply the scale",
  "photometry-fit": "Fit photometric functions",
  "spc-tile": "Tile with finer maplets",
  "spc-register": "Fit states of images",
  "spc-lithos": "Solve maplets from images",
  "fuse-images": "Fuse images and lidar",
  "spc-albedo": "Solve albedo on known topography",
  "solution-use": "Use a solution",
  "solution-export": "Export a solution",
  "solution-remove": "Remove a solution",
  "truth-assess": "Assess against the truth",
};

/** What uploads are called, by their kinds. */
export const UPLOADS: Record<string, string> = {
  scan: "Lidar scans",
  image: "Images",
  kernel: "SPICE kernels",
  camera: "Camera files",
  table: "Tables (poses, times, stars)",
  spc: "SPC files (maplets, SUMFILES, …)",
  shape: "Shape model",
  other: "Others",
};

/** Parameters that only a new workspace takes. */
export const OF_NEW = new Set(["body", "shape", "shape_unit", "faces_from"]);
/** Headings whose parameters most jobs of a kind need. */
export const OPEN = new Set(["States and cameras", "New .SUM files"]);

const SENT: Record<string, string> = {
  kernel: "kernel", pck: "kernel", camera: "camera", dark: "image", flat: "image", image: "image", companions: "image",
  poses: "table", times: "table", table: "table", catalogue: "table", attitudes: "table", stars: "table",
};
const COMMAND_FILES: Record<string, string> = { import: "scan", images: "image", init: "spc", "camera-convert": "kernel" };

/** Return the kind of upload that a parameter usually takes. */
export function uploadKind(kind: string, parameter: string): string {
  return (parameter === "uploads" ? COMMAND_FILES[kind] : SENT[parameter]) ?? "other";
}

/** Return all kinds. */
export function kindsOf(signal: AbortSignal): Promise<Kind[]> {
  return getAll<Kind>("/job-kinds", "kinds", { signal });
}

/** Return a schema without null, and whether null is allowed. */
export function bare(schema: Schema): { schema: Schema; optional: boolean } {
  const parts = schema.anyOf?.filter((one) => one.type !== "null");
  if (!parts || parts.length === schema.anyOf!.length) return { schema, optional: false };
  // An id or an output is still a choice of two.
  return { schema: parts.length === 1 ? { ...schema, ...parts[0] } : { ...schema, anyOf: parts }, optional: true };
}
