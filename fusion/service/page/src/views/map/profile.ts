// The profile along a line: heights with their band of sigma, or another layer.
import { element, fill } from "../../dom";
import { isSource } from "../../layers";
import { labelled, titleOf } from "../../look";
import type { Band, bandPlot } from "../../plots";
import type { Point, ProfileValues, Surface } from "./surface";

const HEIGHT = 190;
const COLOURS: Record<string, string> = { spc: "--spc", lidar: "--lidar", fused: "--fused", maplet: "--spc", mapola: "--lidar" };

/** Return the variable of the style sheet with the colour of a surface. */
export function colourOf(kind: string, name: string): string {
  const part = name.includes(":") ? name.split(":").pop()! : kind;
  return COLOURS[part] ?? "--fused";
}

export class ProfilePanel {
  readonly root = element("section", { class: "profile", "aria-label": "Profile", hidden: true });
  private drawn = new AbortController();
  private layer: string;
  private plot: typeof bandPlot | null = null;

  /** @param onPoint called with the point under the cursor of the plot; null: none */
  constructor(
    private readonly signal: AbortSignal,
    layer: string | null,
    private readonly onPoint: (point: Point | null) => void,
    private readonly onLayer: (layer: string) => void,
  ) {
    this.layer = layer ?? "height";
    signal.addEventListener("abort", () => this.drawn.abort());
  }

  /** Load and draw the profiles of surfaces along a line; null hides the panel. */
  async show(line: [Point, Point] | null, surfaces: Surface[]): Promise<void> {
    this.drawn.abort();
    this.drawn = new AbortController();
    const { signal } = this.drawn;
    this.root.hidden = line === null;
    if (!line || this.signal.aborted) return;
    // What draws plots is large: it comes with the first profile.
    const [plots, ...found] = await Promise.all([import("../../plots"), ...surfaces.map((each) => each.profile(line, signal))]);
    this.plot = plots.bandPlot;
    if (!signal.aborted) this.draw(surfaces, found, signal);
  }

  private draw(surfaces: Surface[], found: ProfileValues[], signal: AbortSignal): void {
    const first = found[0]!;
    const layers = Object.keys(first.layers);
    if (!layers.includes(this.layer)) this.layer = "height";
    const about = surfaces[0]!.layer(this.layer)!;
    const select = element(
      "select",
      {
        onchange: () => {
          this.layer = select.value;
          this.onLayer(this.layer);
          this.drawn.abort();
          this.drawn = new AbortController();
          this.draw(surfaces, found, this.drawn.signal);
        },
      },
      ...layers.map((each) => element("option", { value: each, selected: each === this.layer }, titleOf(each))),
    );
    const place = element("div", { class: "plot" });
    place.dataset.height = String(HEIGHT);
    const save = element("button", { type: "button", onclick: () => download(surfaces, found) }, "Save as CSV");
    const band = this.layer === "height" && "sigma" in first.layers ? "The band is ± one sigma." : "";
    fill(
      this.root,
      element("div", { class: "row" }, element("h2", {}, "Profile"), labelled("Layer", select), save, element("span", { class: "quiet" }, band)),
      place,
    );
    const bands = surfaces.map((surface, k) => bandOf(surface, found[k]!, this.layer));
    const unit = isSource(about) || !about.unit ? "" : ` (${about.unit})`;
    const labels = { x: "distance (m)", y: `${this.layer}${unit}` };
    this.plot!(place, first.distance_m, bands, labels, (at) => {
      this.onPoint(at === null ? null : [first.x_m[at]!, first.y_m[at]!]);
    }, signal);
  }
}

function bandOf(surface: Surface, values: ProfileValues, layer: string): Band {
  const { kind, name } = surface.about;
  const y = values.layers[layer] ?? values.distance_m.map(() => null);
  const sigma = layer === "height" ? (values.layers.sigma ?? null) : null;
  return { label: `${kind} ${name}`, y, sigma, colour: colourOf(kind, name) };
}

function download(surfaces: Surface[], found: ProfileValues[]): void {
  surfaces.forEach((surface, k) => {
    const { layers, ...places } = found[k]!;
    const columns: Record<string, (number | null)[]> = { ...places, ...layers };
    const names = Object.keys(columns);
    const rows = places.distance_m.map((_, at) => names.map((name) => columns[name]![at] ?? "").join(","));
    const text = [names.join(","), ...rows, ""].join("\r\n");
    const url = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    const { kind, name } = surface.about;
    element("a", { href: url, download: `profile-${kind}-${name.replace(":", "-")}.csv` }).click();
    URL.revokeObjectURL(url);
  });
}
