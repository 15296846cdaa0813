// A bar that divides the map: one surface to its left, another one to its right.
import { unByKey } from "ol/Observable.js";
import { getRenderPixel } from "ol/render.js";
import type RenderEvent from "ol/render/Event.js";
import type OlMap from "ol/Map.js";
import type Layer from "ol/layer/Layer.js";
import { element } from "../../dom";

const STEP = 0.02;

export class Swipe {
  readonly bar = element("div", {
    class: "swipe", role: "slider", tabindex: 0, "aria-orientation": "horizontal",
    "aria-valuemin": 0, "aria-valuemax": 100, "aria-label": "Border between both surfaces",
  });
  private keys: Parameters<typeof unByKey>[0][] = [];

  /** @param onMove called with the new share of the width, 0 … 1 */
  constructor(
    private readonly map: OlMap,
    private share: number,
    private readonly onMove: (share: number) => void,
    signal: AbortSignal,
  ) {
    this.bar.hidden = true;
    this.bar.append(element("span", { class: "grip", "aria-hidden": "true" }, "◂ ▸"));
    this.bar.addEventListener("pointerdown", (event) => this.bar.setPointerCapture(event.pointerId), { signal });
    this.bar.addEventListener(
      "pointermove",
      (event) => {
        if (!this.bar.hasPointerCapture(event.pointerId)) return;
        const box = this.bar.parentElement!.getBoundingClientRect();
        this.move((event.clientX - box.left) / box.width);
      },
      { signal },
    );
    this.bar.addEventListener(
      "keydown",
      (event) => {
        const step = event.shiftKey ? 5 * STEP : STEP;
        const places: Record<string, number> = {
          ArrowLeft: this.share - step, ArrowRight: this.share + step, Home: 0, End: 1,
        };
        const place = places[event.key];
        if (place === undefined) return;
        event.preventDefault();
        event.stopPropagation();
        this.move(place);
      },
      { signal },
    );
  }

  /** Divide the map between two layers; null: the first one alone. */
  divide(first: Layer, second: Layer | null): void {
    unByKey(this.keys.flat());
    this.keys = [];
    this.bar.hidden = second === null;
    if (second) {
      this.clip(first, () => [0, this.share]);
      this.clip(second, () => [this.share, 1]);
    }
    this.place();
  }

  /** Whether a point of the map, CSS pixels from its left, belongs to the second surface. */
  isSecond(x: number): boolean {
    return !this.bar.hidden && x > this.share * this.bar.parentElement!.clientWidth;
  }

  private move(share: number): void {
    this.share = Math.min(1, Math.max(0, share));
    this.place();
    this.onMove(this.share);
    this.map.render();
  }

  private place(): void {
    this.bar.style.left = `${100 * this.share}%`;
    this.bar.setAttribute("aria-valuenow", String(Math.round(100 * this.share)));
  }

  private clip(layer: Layer, part: () => [number, number]): void {
    this.keys.push(
      layer.on("prerender", (event: RenderEvent) => {
        const context = event.context as CanvasRenderingContext2D;
        const [width, height] = this.map.getSize() as [number, number];
        const [from, to] = part().map((share) => share * width) as [number, number];
        const corners = [[from, 0], [to, 0], [to, height], [from, height]].map((each) => getRenderPixel(event, each));
        context.save();
        context.beginPath();
        corners.forEach((at, k) => (k ? context.lineTo(at[0]!, at[1]!) : context.moveTo(at[0]!, at[1]!)));
        context.closePath();
        context.clip();
      }),
      layer.on("postrender", (event: RenderEvent) => (event.context as CanvasRenderingContext2D).restore()),
    );
  }
}
