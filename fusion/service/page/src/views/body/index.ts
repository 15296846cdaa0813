// The body in three dimensions, with layers and the outlines of maps.
import { ApiProblem, getJson } from "../../api";
import { element, fill } from "../../dom";
import { degrees, metres } from "../../format";
import { isSource, tableOf, worded } from "../../layers";
import { labelled, LookControls, type Look as LayerLook } from "../../look";
import { hrefOf, keepInAddress, type Route, type View } from "../../router";
import { ScaleBar } from "../../scalebar";
import { facetsOf, outlinedOf, pathOfOutlines } from "../ahead";
import { limited, lonLat, lookOf, textOf, type Look } from "./camera";
import { loadMesh } from "./loading";
import type { BodyMesh } from "./mesh";
import { outlinesOf, squareAt, type Outline, type OutlineTable } from "./outlines";
import { BodyScene, rendererOf } from "./scene";
import { addTurning } from "./turning";
import { asked, bodyLayers, rangeOf, valuesOf } from "./values";

const KINDS: [kind: string, title: string, ink: [number, number, number]][] = [
  ["maplet", "Maplets", [0.0, 0.45, 0.7]],
  ["mapola", "Mapolas", [0.8, 0.4, 0.0]],
  ["fused", "Fused maplets", [0.0, 0.55, 0.4]],
  ["bigmap", "Bigmaps", [0.75, 0.2, 0.55]],
];

export const body: View = {
  title: "Body",
  async open(root, route, signal) {
    root.classList.add("whole");
    const canvas = bodyCanvas();
    const renderer = rendererOf(canvas, signal);
    if (!renderer) {
      throw new ApiProblem(0, { detail: "this browser has no WebGL 2", do: "use another one, or the maps" });
    }
    const waiting = element("p", { class: "waiting", role: "status" }, "The shape is loading …");
    fill(root, element("section", { class: "panel" }, element("h1", {}, "Body"), waiting), element("div", { class: "stage" }));
    const facets = facetsOf(route);
    const squares = new Map(outlinedOf(route).map((kind) => [kind, squaresOf(route, kind, signal)]));
    const known = bodyLayers(route.workspace, signal);
    // Values and mesh come at the same time.
    const first = known.then((layers) =>
      asked(route.workspace, layers.find(({ name }) => name === route.query.get("layer")), facets, signal),
    );
    first.catch(() => undefined);
    const [layers, loaded] = await Promise.all([known, loadMesh(route.workspace, facets, signal)]);
    const scene = new BodyScene(canvas, renderer, loaded.mesh, (cost) => (root.dataset.frameMs = cost.toFixed(1)));
    const shown = new BodyPage(root, route, { canvas, scene, mesh: loaded.mesh, layers, facets, first, squares }, signal);
    root.dataset.fetchedMs = loaded.fetched.toFixed(0);
    root.dataset.preparedMs = loaded.prepared.toFixed(0);
    await shown.start();
  },
};

function bodyCanvas(): HTMLCanvasElement {
  return element("canvas", {
    tabindex: 0,
    role: "application",
    "aria-label": "The body. Arrow keys turn it, plus and minus zoom, Home resets; Shift makes smaller steps.",
  });
}

interface Content {
  canvas: HTMLCanvasElement;
  scene: BodyScene;
  mesh: BodyMesh;
  layers: Awaited<ReturnType<typeof bodyLayers>>;
  facets: number;
  /** Values of the layer that the address names, asked for together with the mesh; null if it has none. */
  first: Promise<Float32Array | null> | null;
  /** Outlines that the address names, asked for together with the mesh. */
  squares: Map<string, Promise<Outline[]>>;
}

function squaresOf(route: Route, kind: string, signal: AbortSignal): Promise<Outline[]> {
  const found = getJson<OutlineTable>(pathOfOutlines(route.workspace, kind), { signal }).then(outlinesOf);
  // Whoever awaits it gets the problem; until then it is nobody's.
  found.catch(() => undefined);
  return found;
}

class BodyPage {
  private readonly canvas: HTMLCanvasElement;
  private readonly readout = element("output", { class: "readout" });
  private readonly status = element("p", { class: "waiting", role: "status" });
  private readonly bar = new ScaleBar();
  private readonly scene: BodyScene;
  private readonly controls: LookControls;
  private readonly squares = new Map<string, Outline[]>();
  private look: Look;
  private values: Float32Array | null = null;
  private light: [number, number] | null;
  private saving = 0;

  constructor(
    private readonly root: HTMLElement,
    private readonly route: Route,
    private readonly content: Content,
    private readonly signal: AbortSignal,
  ) {
    const { mesh, layers } = content;
    this.canvas = content.canvas;
    this.scene = content.scene;
    this.look = limited(lookOf(route.query.get("camera")) ?? this.first, mesh.radius);
    const light = (route.query.get("light") ?? "").split(",").map(Number);
    this.light = light.length === 2 && light.every(Number.isFinite) ? [light[0]!, light[1]!] : null;
    this.controls = new LookControls(
      layers,
      route.query,
      (layer) => rangeOf(layer, this.values),
      (look, changed) => void this.show(look, changed).catch((error: unknown) => {
        this.status.textContent = error instanceof ApiProblem ? error.line : String(error);
      }),
    );
    this.fillRoot();
    root.dataset.facets = String(mesh.faces.length / 3);
    signal.addEventListener("abort", () => {
      clearTimeout(this.saving);
      this.scene.close();
    });
  }

  async start(): Promise<void> {
    const { signal } = this;
    addTurning(
      this.canvas,
      this.content.mesh.radius,
      {
        look: () => this.look,
        turn: (look) => this.turn(look),
        click: (x, y) => this.go(x, y),
        reset: () => this.turn(this.first),
      },
      signal,
    );
    this.canvas.addEventListener("pointermove", (event) => this.point(event), { signal });
    this.canvas.addEventListener("pointerleave", () => this.readPlace(), { signal });
    const sizes = new ResizeObserver(() => {
      // It calls for the size at the beginning, too, which is drawn already.
      if (!this.scene.fits) this.turn(this.look);
    });
    sizes.observe(this.canvas);
    signal.addEventListener("abort", () => sizes.disconnect());
    this.scene.shine(this.light);
    this.turn(this.look);
    // A coarse picture comes first: something is seen while the rest is drawn.
    await new Promise(requestAnimationFrame);
    if (this.signal.aborted) return;
    this.root.dataset.shownMs = performance.now().toFixed(0);
    const layer = this.show(this.controls.look, true);
    await Promise.all([layer, ...outlinedOf(this.route).map((kind) => this.outline(kind, true))]);
    if (this.signal.aborted) return;
    await this.scene.whole();
    this.root.dataset.ready = "true";
  }

  private get first(): Look {
    return { longitude: 0, latitude: 15, width: 2.3 * this.content.mesh.radius };
  }

  private fillRoot(): void {
    const faces = this.content.mesh.faces.length / 3;
    const panel = element(
      "section",
      { class: "panel", "aria-label": "Layers and outlines" },
      element("h1", {}, "Body"),
      this.controls.root,
      this.status,
      this.lightBox(),
      this.outlineBox(),
      this.search(),
      element("p", { class: "quiet" }, `${faces.toLocaleString("en").replaceAll(",", "\u202f")} facets. `,
        "Drag or arrow keys turn, wheel or + and − zoom, Home resets. Click a square to open its map."),
    );
    const stage = element("div", { class: "stage" }, this.canvas, this.readout, this.bar.root, this.buttons());
    fill(this.root, panel, stage);
  }

  private buttons(): HTMLElement {
    const button = (text: string, title: string, act: () => void): HTMLElement =>
      element("button", { type: "button", "aria-label": title, title, onclick: act }, text);
    const zoom = (share: number) => () => this.turn({ ...this.look, width: this.look.width / share });
    return element(
      "div",
      { class: "zoom" },
      button("+", "Zoom in", zoom(1.4)),
      button("−", "Zoom out", zoom(1 / 1.4)),
      button("N", "Look at the north pole", () => this.turn({ ...this.look, latitude: 90 })),
      button("S", "Look at the south pole", () => this.turn({ ...this.look, latitude: -90 })),
      button("⌂", "Whole body", () => this.turn(this.first)),
    );
  }

  private turn(look: Look): void {
    this.look = limited(look, this.content.mesh.radius);
    this.scene.turn(this.look);
    this.bar.set(this.look.width / Math.max(1, Math.min(this.canvas.clientWidth, this.canvas.clientHeight)));
    this.readPlace();
    this.save({ camera: textOf(this.look) });
  }

  /** Show a layer; its values are loaded if it is another one. */
  private async show(look: LayerLook, changed: boolean): Promise<void> {
    const { layer } = look;
    if (changed) {
      const { mesh, facets } = this.content;
      this.status.textContent = layer.name === "hillshade" ? "" : "The layer is loading …";
      const early = await this.content.first;
      this.content.first = null;
      const found = early ?? (await valuesOf(this.route.workspace, layer, mesh, facets, this.signal));
      if (this.signal.aborted || this.controls.look.layer !== layer) return;
      this.status.textContent = "";
      this.values = found;
      this.scene.setValues(found);
      this.controls.render();
    }
    const { range, colours, shading } = this.controls.look;
    const plain = layer.name === "hillshade";
    this.scene.paint(plain ? null : { table: tableOf(layer, colours), range, codes: isSource(layer), shading });
    this.save(this.controls.entries);
  }

  private async outline(kind: string, shown: boolean): Promise<void> {
    if (!shown) this.squares.delete(kind);
    else {
      const { squares } = this.content;
      const early = squares.get(kind) ?? squaresOf(this.route, kind, this.signal);
      squares.delete(kind);
      this.squares.set(kind, await early);
    }
    if (this.signal.aborted) return;
    this.scene.outline(kind, this.squares.get(kind) ?? [], KINDS.find(([each]) => each === kind)![2]);
    this.save({ outlines: [...this.squares.keys()].join(",") || "none" });
    const names = [...this.squares.values()].flat();
    fill(this.names, ...names.map((each) => element("option", { value: `${each.kind} ${each.name}` })));
  }

  private readonly names = element("datalist", { id: "squares" });

  private outlineBox(): HTMLElement {
    const chosen = outlinedOf(this.route);
    const boxes = KINDS.map(([kind, title, ink]) => {
      const box = element("input", { type: "checkbox", name: kind, checked: chosen.includes(kind) });
      box.onchange = () => void this.outline(kind, box.checked).catch(() => (box.checked = false));
      const swatch = element("span", { class: "swatch" });
      swatch.style.backgroundColor = `rgb(${ink.map((each) => Math.round(255 * each)).join(" ")})`;
      return element("label", { class: "check" }, box, swatch, title);
    });
    return element("fieldset", {}, element("legend", {}, "Outlines"), ...boxes);
  }

  private lightBox(): HTMLElement {
    const [longitude, latitude] = this.light ?? [0, 0];
    const place = (name: string, value: number, most: number): HTMLInputElement =>
      element("input", { type: "range", name, min: most === 360 ? 0 : -most, max: most, step: 1, value: String(value) });
    const east = place("light-longitude", longitude, 360);
    const north = place("light-latitude", latitude, 90);
    const fixed = element("input", { type: "checkbox", name: "light", checked: this.light !== null });
    const rows = [labelled("Longitude", east), labelled("Latitude", north)];
    const changed = (): void => {
      this.light = fixed.checked ? [Number(east.value), Number(north.value)] : null;
      for (const each of rows) each.hidden = !fixed.checked;
      this.scene?.shine(this.light);
      this.save({ light: this.light ? this.light.join(",") : "" });
    };
    for (const each of [east, north]) each.oninput = changed;
    fixed.onchange = () => {
      if (fixed.checked) [east.value, north.value] = [String(Math.round(this.look.longitude)), "20"];
      changed();
    };
    for (const each of rows) each.hidden = !fixed.checked;
    const box = element("label", { class: "check" }, fixed, "Sun stays above a place");
    return element("fieldset", {}, element("legend", {}, "Light"), box, ...rows);
  }

  /** Return the entry of a name, with which keyboards reach what pointers click. */
  private search(): HTMLElement {
    const entry = element("input", { list: "squares", name: "square", size: 14, autocomplete: "off" });
    const found = (): Outline | undefined =>
      [...this.squares.values()].flat().find((each) => `${each.kind} ${each.name}` === entry.value || each.name === entry.value);
    const look = (): void => {
      const square = found();
      if (!square) return;
      const [longitude, latitude] = lonLat(square.center);
      this.turn({ longitude, latitude, width: 3 * square.side });
    };
    const open = (event: Event): void => {
      event.preventDefault();
      const square = found();
      if (square) this.open(square);
    };
    return element(
      "form",
      { class: "row", onsubmit: open },
      labelled("Square", entry),
      this.names,
      element("button", { type: "button", onclick: look }, "Look at"),
      element("button", { type: "submit" }, "Open map"),
    );
  }

  private waiting = 0;

  private point(event: PointerEvent): void {
    if (event.buttons) return;
    const at = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - at.left, event.clientY - at.top];
    cancelAnimationFrame(this.waiting);
    this.waiting = requestAnimationFrame(() => this.read(x, y));
  }

  /** Show what lies under the pointer. */
  private read(x: number, y: number): void {
    if (this.signal.aborted) return;
    const found = this.scene.pick(x, y);
    if (!found) {
      this.canvas.style.cursor = "grab";
      this.readPlace();
      return;
    }
    const [longitude, latitude] = lonLat(found.point);
    const square = squareAt(found.point, this.scene.eye, [...this.squares.values()].flat());
    const { layer } = this.controls.look;
    const value = layer.name === "hillshade" ? "" : `${layer.name} ${worded(layer, found.value)}`;
    this.canvas.style.cursor = square ? "pointer" : "grab";
    this.write(longitude, latitude, [`radius ${metres(found.point.length(), 5)}`, value, square ? `${square.kind} ${square.name}` : ""]);
  }

  private readPlace(): void {
    this.write(this.look.longitude, this.look.latitude, ["middle of the view"]);
  }

  private write(longitude: number, latitude: number, more: string[]): void {
    const parts = [`longitude ${degrees(longitude)} E`, `latitude ${degrees(latitude)}`, ...more];
    this.readout.textContent = parts.filter(Boolean).join("  ·  ");
  }

  private go(x: number, y: number): void {
    const found = this.scene.pick(x, y);
    const square = found && squareAt(found.point, this.scene.eye, [...this.squares.values()].flat());
    if (square) this.open(square);
  }

  private open(square: Outline): void {
    location.hash = hrefOf(this.route.workspace, "map", [square.kind, square.name]);
  }

  private pending: Record<string, string> = {};

  /** Keep the state in the address; not at every frame, which browsers refuse. */
  private save(entries: Record<string, string>): void {
    Object.assign(this.pending, entries);
    clearTimeout(this.saving);
    this.saving = window.setTimeout(() => {
      keepInAddress(this.pending);
      this.pending = {};
    }, 250);
  }
}
