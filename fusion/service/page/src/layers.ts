// What the service has to say about a layer, and the colours in which it is drawn.
import { colours, css, legend, type ColormapName, type Rgb } from "./colormaps";
import { element } from "./dom";
import { number } from "./format";

/** A layer of a surface or of the body. */
export interface LayerAbout {
  name: string;
  text: string;
  unit: string;
  colours: string;
  range?: [number, number] | null;
}

/** Colour maps between which a user chooses. */
export const CHOICES: ColormapName[] = ["viridis", "cividis", "grey", "diverging"];

/** Sources of a height by their code, with colours that stay distinct for colour-blind people. */
export const SOURCES: [title: string, colour: Rgb][] = [
  ["none", [255, 255, 255]],
  ["image", [0, 114, 178]],
  ["lidar", [230, 159, 0]],
  ["both", [0, 158, 115]],
  ["filled", [187, 187, 187]],
];

/** In how many directions images determine a slope. */
const DIRECTIONS: [title: string, colour: Rgb][] = [
  ["none", [187, 187, 187]],
  ["one", [230, 159, 0]],
  ["two", [0, 114, 178]],
];

const CODED: Record<string, { codes: [title: string, colour: Rgb][]; label: string }> = {
  source: { codes: SOURCES, label: "Colours of the sources" },
  directions: { codes: DIRECTIONS, label: "Directions in which images determine the slope" },
};

const NAMES: Record<string, ColormapName> = {
  viridis: "viridis",
  cividis: "cividis",
  gray: "grey",
  RdBu_r: "diverging",
};

/** Return the words and colours of the values 0, 1, … of a layer; null where they are no codes. */
export function codesOf(layer: LayerAbout): [title: string, colour: Rgb][] | null {
  return CODED[layer.colours]?.codes ?? null;
}

/** Return whether the values of a layer are codes of sources. */
export function isSource(layer: LayerAbout): boolean {
  return layer.colours === "source";
}

/** Return the colour map in which a layer is drawn unless the user chooses another one. */
export function colormapOf(layer: LayerAbout): ColormapName {
  return NAMES[layer.colours] ?? "viridis";
}

/** Return the 256 colours of a layer; those of codes fill the part around their own. */
export function tableOf(layer: LayerAbout, chosen: ColormapName): Rgb[] {
  const codes = codesOf(layer);
  if (!codes) return colours(chosen);
  return Array.from({ length: 256 }, (_, k) => codes[Math.round((k / 255) * (codes.length - 1))]![1]);
}

/** Return the legend of a layer between two limits. */
export function layerLegend(layer: LayerAbout, chosen: ColormapName, range: [number, number]): HTMLElement {
  const unit = layer.unit ? ` (${layer.unit})` : "";
  if (codesOf(layer)) return codeLegend(CODED[layer.colours]!);
  return legend(chosen, number(range[0], 3), number(range[1], 3), `${layer.name}${unit}`);
}

/** Return the word for a value of a layer, or the number with its unit. */
export function worded(layer: LayerAbout, value: number | null | undefined, digits = 4): string {
  const codes = codesOf(layer);
  if (codes && typeof value === "number") return codes[Math.round(value)]?.[0] ?? "unknown";
  if (typeof value !== "number" || !Number.isFinite(value)) return number(value);
  const text = layer.name === "count" && Number.isInteger(value) ? String(value) : number(value, digits);
  return layer.unit === "°" ? `${text}°` : `${text} ${layer.unit}`.trim();
}

function codeLegend({ codes, label }: (typeof CODED)[string]): HTMLElement {
  const items = codes.map(([title, colour]) => {
    const swatch = element("span", { class: "swatch" });
    swatch.style.backgroundColor = css(colour);
    return element("li", {}, swatch, title);
  });
  return element("ul", { class: "sources", "aria-label": label }, ...items);
}
