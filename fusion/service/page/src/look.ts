// Choice of a layer, its range and its colours: the same in the map and on the body.
import type { ColormapName } from "./colormaps";
import { element, fill } from "./dom";
import { number } from "./format";
import { CHOICES, codesOf, colormapOf, layerLegend, type LayerAbout } from "./layers";

export interface Look {
  layer: LayerAbout;
  range: [number, number];
  colours: ColormapName;
  /** Share of the hill-shade, 0 … 1. */
  shading: number;
}

const TITLES: Record<string, string> = {
  height: "Height", sigma: "Sigma", hillshade: "Hill-shade", albedo: "Albedo", count: "Counts", source: "Source",
  difference: "Height difference", slope: "Slope", directions: "Directions of slopes", radius: "Radius",
};

/** Return the heading of a layer. */
export function titleOf(name: string): string {
  return TITLES[name] ?? name;
}

export class LookControls {
  readonly root = element("div", { class: "look" });
  private chosen: LayerAbout;
  private range: [number, number] | null;
  private colours: ColormapName | null;
  private shading: number;
  private readonly low = field("low");
  private readonly high = field("high");
  private readonly problem = element("p", { class: "problem", role: "alert" });

  /**
   * @param layers what there is
   * @param rangeOf range of the values of a layer
   * @param onChange called with the new state, and whether the layer is another one
   */
  constructor(
    private readonly layers: LayerAbout[],
    query: URLSearchParams,
    private readonly rangeOf: (layer: LayerAbout) => [number, number],
    private readonly onChange: (look: Look, layerChanged: boolean) => void,
  ) {
    this.chosen = layers.find((each) => each.name === query.get("layer")) ?? layers[0]!;
    this.range = rangeFrom(query.get("range"));
    this.colours = CHOICES.find((each) => each === query.get("colours")) ?? null;
    const shading = Number(query.get("shade") ?? Number.NaN);
    this.shading = shading >= 0 && shading <= 100 ? shading / 100 : 0.7;
    this.render();
  }

  /** How the layer is to be drawn. */
  get look(): Look {
    return {
      layer: this.chosen,
      range: this.range ?? this.rangeOf(this.chosen),
      colours: this.colours ?? colormapOf(this.chosen),
      shading: this.shading,
    };
  }

  /** What of it differs from the defaults, for the address. */
  get entries(): Record<string, string> {
    return {
      layer: this.chosen.name,
      range: this.range ? this.range.join(",") : "",
      colours: this.colours ?? "",
      shade: this.shading === 0.7 ? "" : String(Math.round(100 * this.shading)),
    };
  }

  /** Show range and legend again, as when values have come. */
  render(): void {
    const { layer, range, colours } = this.look;
    this.low.value = number(range[0], 4).replace("−", "-");
    this.high.value = number(range[1], 4).replace("−", "-");
    const plain = layer.name === "hillshade";
    const fixed = plain || codesOf(layer) !== null;
    fill(
      this.root,
      labelled("Layer", this.layerChoice()),
      element("p", { class: "quiet" }, layer.text),
      plain ? null : layerLegend(layer, colours, range),
      fixed ? null : this.rangeRow(layer),
      fixed ? null : labelled("Colours", this.colourChoice(colours)),
      plain ? null : labelled("Hill-shade", this.shadeSlider()),
      this.problem,
    );
  }

  private layerChoice(): HTMLSelectElement {
    const options = this.layers.map((each) =>
      element("option", { value: each.name, selected: each === this.chosen }, titleOf(each.name)),
    );
    const select = element("select", {
      name: "layer",
      onchange: () => {
        this.chosen = this.layers.find((each) => each.name === select.value)!;
        [this.range, this.colours] = [null, null];
        this.changed(true);
        this.root.querySelector("select")?.focus();
      },
    }, ...options);
    return select;
  }

  private colourChoice(shown: ColormapName): HTMLSelectElement {
    const options = CHOICES.map((each) => element("option", { value: each, selected: each === shown }, each));
    const select = element("select", {
      name: "colours",
      onchange: () => {
        this.colours = select.value as ColormapName;
        this.changed(false);
        this.root.querySelector<HTMLElement>("select[name=colours]")?.focus();
      },
    }, ...options);
    return select;
  }

  private rangeRow(layer: LayerAbout): HTMLElement {
    const entered = (): void => {
      const range: [number, number] = [Number(this.low.value), Number(this.high.value)];
      const known = range.every(Number.isFinite) && range[0] < range[1];
      this.problem.textContent = known ? "" : "The range needs two ascending numbers.";
      if (!known) return;
      this.range = range;
      this.changed(false);
    };
    this.low.onchange = entered;
    this.high.onchange = entered;
    const unit = layer.unit ? `, ${layer.unit}` : "";
    this.low.setAttribute("aria-label", `Lowest value of the colours${unit}`);
    this.high.setAttribute("aria-label", `Highest value of the colours${unit}`);
    const reset = (): void => {
      this.range = null;
      this.problem.textContent = "";
      this.changed(false);
    };
    const button = element("button", { type: "button", onclick: reset, disabled: !this.range }, "Reset");
    return element("div", { class: "range" }, this.low, "to", this.high, button);
  }

  private shadeSlider(): HTMLInputElement {
    const made = element("input", {
      type: "range", min: 0, max: 100, step: 5, name: "shade", value: String(Math.round(100 * this.shading)),
    });
    made.oninput = () => {
      this.shading = Number(made.value) / 100;
      this.onChange(this.look, false);
    };
    return made;
  }

  private changed(layerChanged: boolean): void {
    this.onChange(this.look, layerChanged);
    this.render();
  }
}

/** Return a control with its label. */
export function labelled(text: string, control: HTMLElement): HTMLElement {
  return element("label", { class: "labelled" }, element("span", {}, text), control);
}

function field(name: string): HTMLInputElement {
  return element("input", { type: "text", inputmode: "decimal", size: 7, name, autocomplete: "off" });
}

function rangeFrom(text: string | null): [number, number] | null {
  if (!text) return null;
  const [low, high] = text.split(",").map(Number);
  return Number.isFinite(low) && Number.isFinite(high) && low! < high! ? [low!, high!] : null;
}
