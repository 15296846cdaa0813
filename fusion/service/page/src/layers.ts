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

const NAMES: Record<string, ColormapName> = {
  viridis: "viridis",
  cividis: "cividis",
  gray: "grey",
  RdBu_r: "diverging",
};

/** Return whether the values of a layer are codes of sources. */
export function isSource(layer: LayerAbout): boolean {
  return layer.colours === "source";
}

/** Return the colour map in which a layer is drawn unless the user chooses another one. */
export function colormapOf(layer: LayerAbout): ColormapName {
  return NAMES[layer.colours] ?? "viridis";
}

/** Return the 256 colours of a layer; those of sources fill a fifth each. */
export function tableOf(layer: LayerAbout, chosen: ColormapName): Rgb[] {
  if (!isSource(layer)) return colours(chosen);
  return Array.from({ length: 256 }, (_, k) => SOURCES[Math.round((k / 255) * (SOURCES.length - 1))]![1]);
}

/** Return the legend of a layer between two limits. */
export function layerLegend(layer: LayerAbout, chosen: ColormapName, range: [number, number]): HTMLElement {
  const unit = layer.unit ? ` (${layer.unit})` : "";
  if (isSource(layer)) return sourceLegend();
  return legend(chosen, number(range[0], 3), number(range[1], 3), `${layer.name}${unit}`);
}

/** Return the word for a value of a layer, or the number with its unit. */
export function worded(layer: LayerAbout, value: number | null | undefined, digits = 4): string {
  if (isSource(layer) && typeof value === "number") return SOURCES[Math.round(value)]?.[0] ?? "unknown";
  if (typeof value !== "number" || !Number.isFinite(value)) return number(value);
  const text = layer.name === "count" && Number.isInteger(value) ? String(value) : number(value, digits);
  return layer.unit === "°" ? `${text}°` : `${text} ${layer.unit}`.trim();
}

function sourceLegend(): HTMLElement {
  const items = SOURCES.map(([title, colour]) => {
    const swatch = element("span", { class: "swatch" });
    swatch.style.backgroundColor = css(colour);
    return element("li", {}, swatch, title);
  });
  return element("ul", { class: "sources", "aria-label": "Colours of the sources" }, ...items);
}
