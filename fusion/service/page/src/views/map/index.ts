// The map of a surface: its layers, a second surface next to it, a profile, values under the cursor.
import type OlMap from "ol/Map.js";
import { ApiProblem, getAll } from "../../api";
import { element, fill } from "../../dom";
import { degrees, metres } from "../../format";
import type { LayerAbout } from "../../layers";
import { worded } from "../../layers";
import { labelled, LookControls, titleOf, type Look } from "../../look";
import { hrefOf, keepInAddress, type Route, type View } from "../../router";
import { ScaleBar } from "../../scalebar";
import { pathOfNames } from "../ahead";
import { listen, makeMap } from "./chart";
import { PaintedSurface } from "./painting";
import { ProfilePanel } from "./profile";
import { Surface, type Place, type Point, type PointValues } from "./surface";
import { Swipe } from "./swipe";

const KINDS: [kind: string, title: string][] = [
  ["maplet", "Maplets (SPC)"], ["mapola", "Mapolas (lidar)"], ["fused", "Fused maplets"],
  ["bigmap", "Bigmaps"], ["pair", "Pairs"], ["dtm", "Released models"],
];
const ORDER = ["fused", "bigmap", "maplet", "mapola", "pair", "dtm"];

export const map: View = {
  title: "Map",
  async open(root, route, signal) {
    root.classList.add("whole");
    const [kind, name] = route.path;
    if (!kind || !name) {
      await openFirst(route, kind, signal);
      return;
    }
    const place = { kind, name };
    const other = secondOf(route.query);
    const [names, surface, second] = await Promise.all([
      namesOf(route.workspace, kind, signal),
      Surface.open(route.workspace, place, signal),
      other && Surface.open(route.workspace, other.place, signal),
    ]);
    const page = new MapPage(root, route, { surface, names }, signal);
    page.start(second ? { surface: second, share: other!.share } : null);
  },
};

/** Go to the first surface that there is, of a kind if given. */
async function openFirst(route: Route, kind: string | undefined, signal: AbortSignal): Promise<void> {
  for (const each of kind ? [kind] : ORDER) {
    const [first] = await namesOf(route.workspace, each, signal);
    if (!first) continue;
    location.replace(hrefOf(route.workspace, "map", [each, first], route.query));
    return;
  }
  throw new ApiProblem(404, { detail: "there are no surfaces yet", do: `run: spcola run ${route.workspace}` });
}

async function namesOf(workspace: string, kind: string, signal: AbortSignal): Promise<string[]> {
  return (await getAll<Place>(pathOfNames(workspace, kind), "surfaces", { signal })).map((each) => each.name);
}

/** Return the second surface that "swipe=KIND/NAME@SHARE" of the address names. */
function secondOf(query: URLSearchParams): { place: Place; share: number } | null {
  const found = /^([a-z]+)\/(.+)@([\d.]+)$/.exec(query.get("swipe") ?? "");
  if (!found) return null;
  return { place: { kind: found[1]!, name: found[2]! }, share: Math.min(1, Math.max(0, Number(found[3]))) };
}

function numbersOf(text: string | null, count: number): number[] | null {
  const numbers = (text ?? "").split(",").map(Number);
  return text && numbers.length === count && numbers.every(Number.isFinite) ? numbers : null;
}

const rounded = (value: number): string => String(Number(value.toPrecision(7)));

class MapPage {
  private readonly target = element("div", {
    class: "chart", tabindex: 0, role: "application",
    "aria-label": "Map. Arrow keys move it, plus and minus zoom; the values are those at its middle.",
  });
  private readonly bar = new ScaleBar();
  private readonly values = element("div", { class: "values" });
  private readonly chart = element("div", { class: "stage" });
  private readonly controls: LookControls;
  private readonly profile: ProfilePanel;
  private readonly first: Surface;
  private second: Surface | null = null;
  private painted: PaintedSurface[] = [];
  private line: [Point, Point] | null;
  private map!: OlMap;
  private made!: ReturnType<typeof makeMap>;
  private tools!: ReturnType<typeof listen>;
  private swipe!: Swipe;
  private share = 0.5;

  constructor(
    private readonly root: HTMLElement,
    private readonly route: Route,
    private readonly content: { surface: Surface; names: string[] },
    private readonly signal: AbortSignal,
  ) {
    this.first = content.surface;
    const layers = this.first.about.layers;
    if (!layers.length) throw new ApiProblem(0, { detail: "has no known values", where: this.first.about.name });
    this.controls = new LookControls(layers, route.query, (layer) => this.rangeOf(layer), (look) => this.paint(look));
    const ends = numbersOf(route.query.get("line"), 4);
    this.line = ends && [[ends[0]!, ends[1]!], [ends[2]!, ends[3]!]];
    this.profile = new ProfilePanel(
      signal,
      route.query.get("profile"),
      (point) => this.tools.mark(point),
      (layer) => keepInAddress({ profile: layer === "height" ? "" : layer }),
    );
  }

  start(second: { surface: Surface; share: number } | null): void {
    const { query } = this.route;
    this.share = second?.share ?? 0.5;
    // Tiles come while the map is made.
    for (const each of [this.first, second?.surface]) each?.askWhole(this.controls.look.layer.name);
    this.fillRoot();
    const center = numbersOf(query.get("center"), 2) as Point | null;
    const zoom = numbersOf(query.get("zoom"), 1);
    this.made = makeMap(this.target, this.first, { center, resolution: zoom && zoom[0]! > 0 ? zoom[0]! : null }, this.signal);
    this.map = this.made.map;
    this.tools = listen(this.map, {
      moved: (middle, resolution) => this.moved(middle, resolution),
      pointed: (point, pixel) => void this.read(point, pixel),
      drawn: (line) => this.setLine(line),
    });
    this.swipe = new Swipe(this.map, this.share, (share) => this.swiped(share), this.signal);
    this.target.append(this.swipe.bar);
    this.showSecond(second?.surface ?? null);
    this.map.once("rendercomplete", () => (this.root.dataset.ready = "true"));
    const sizes = new ResizeObserver(() => this.map.updateSize());
    sizes.observe(this.target);
    this.signal.addEventListener("abort", () => sizes.disconnect());
  }

  private rangeOf(layer: LayerAbout): [number, number] {
    return layer.range ?? [0, 1];
  }

  private fillRoot(): void {
    const { kind, name, gsd_m: gsd, side_m: side, longitude_deg: lon, latitude_deg: lat } = this.first.about;
    const panel = element(
      "section",
      { class: "panel", "aria-label": "Surface and layers" },
      element("h1", {}, `${kind} ${name}`),
      this.choices(),
      element("p", { class: "quiet" }, `${metres(side)} wide, GSD ${metres(gsd)}, at ${degrees(lon)} E, ${degrees(lat)}`),
      this.controls.root,
      this.swipeChoice(),
      this.lineBox(),
    );
    fill(this.chart, this.target, this.bar.root, this.buttons(), this.north());
    fill(this.root, panel, element("div", { class: "stage column" }, this.chart, this.values, this.profile.root));
    this.showValues(this.first, null);
  }

  private choices(): HTMLElement {
    const { workspace } = this.route;
    const { kind, name } = this.first.about;
    const kinds = element(
      "select",
      { name: "kind", onchange: () => (location.hash = hrefOf(workspace, "map", [kinds.value])) },
      ...KINDS.map(([each, title]) => element("option", { value: each, selected: each === kind }, title)),
    );
    const names = element(
      "select",
      { name: "surface", onchange: () => (location.hash = hrefOf(workspace, "map", [kind, names.value], { layer: this.controls.look.layer.name })) },
      ...this.content.names.map((each) => element("option", { value: each, selected: each === name }, each)),
    );
    return element("div", {}, labelled("Kind", kinds), labelled("Name", names));
  }

  private buttons(): HTMLElement {
    const button = (text: string, title: string, act: () => void): HTMLElement =>
      element("button", { type: "button", "aria-label": title, title, onclick: act }, text);
    const zoom = (share: number) => () => {
      const view = this.map.getView();
      view.animate({ resolution: view.getResolution()! * share, duration: 120 });
    };
    const whole = (): void => this.map.getView().animate({ center: [0, 0], resolution: this.made.fitting, duration: 120 });
    return element("div", { class: "zoom" }, button("+", "Zoom in", zoom(0.5)), button("−", "Zoom out", zoom(2)), button("⌂", "Whole surface", whole));
  }

  /** Return an arrow to the north; none at the poles, where it has no direction. */
  private north(): HTMLElement | null {
    const [down, right] = this.first.about.axes;
    if (Math.hypot(down[2], right[2]) < 0.02) return null;
    const arrow = element("div", { class: "north", role: "img", "aria-label": "North" }, element("span", {}, "↑"), "N");
    arrow.style.transform = `rotate(${Math.atan2(right[2], -down[2])}rad)`;
    return arrow;
  }

  /** Return the choice of the surface to the right of the bar. */
  private swipeChoice(): HTMLElement {
    const { kind, name, same_place: places } = this.first.about;
    const others = places.filter((each) => each.kind !== kind || each.name !== name);
    const keyOf = (each: Place): string => `${each.kind}/${each.name}`;
    const chosen = secondOf(this.route.query);
    const select = element(
      "select",
      { name: "swipe", disabled: !others.length },
      element("option", { value: "" }, others.length ? "nothing" : "none of this place"),
      ...others.map((each) =>
        element("option", { value: keyOf(each), selected: chosen !== null && keyOf(each) === keyOf(chosen.place) }, `${each.kind} ${each.name}`),
      ),
    );
    select.onchange = () => void this.chooseSecond(others.find((each) => keyOf(each) === select.value) ?? null);
    return element("fieldset", {}, element("legend", {}, "Swipe"), labelled("Right of bar", select), this.note);
  }

  private readonly note = element("p", { class: "quiet" });

  /** Say what both surfaces have in common. */
  private showNote(): void {
    const layer = this.controls.look.layer.name;
    const about = this.second?.about;
    const lacks = about && !this.second!.layer(layer) ? `${about.name} has no ${titleOf(layer).toLowerCase()}. ` : "";
    this.note.textContent = about ? `${lacks}Each lies in the frame of its own grid.` : "";
  }

  private async chooseSecond(place: Place | null): Promise<void> {
    const second = place && (await Surface.open(this.route.workspace, place, this.signal));
    if (!this.signal.aborted) this.showSecond(second);
  }

  private showSecond(second: Surface | null): void {
    this.second = second;
    for (const each of this.painted) this.map.removeLayer(each.layer);
    const surfaces = second ? [this.first, second] : [this.first];
    this.painted = surfaces.map((each, k) => new PaintedSurface(each, this.made.projection, this.controls.look, `surface-${k}`));
    this.painted.forEach((each, k) => {
      each.layer.setZIndex(1 + k);
      this.map.addLayer(each.layer);
    });
    this.swipe.divide(this.painted[0]!.layer, this.painted[1]?.layer ?? null);
    this.swiped(this.share);
    this.showNote();
    this.setLine(this.line);
  }

  private swiped(share: number): void {
    this.share = share;
    const about = this.second?.about;
    keepInAddress({ swipe: about ? `${about.kind}/${about.name}@${share.toFixed(3)}` : "" });
  }

  private paint(look: Look): void {
    for (const each of this.painted) each.paint(look);
    this.showNote();
    keepInAddress(this.controls.entries);
  }

  private moved(center: Point, resolution: number): void {
    this.bar.set(resolution);
    keepInAddress({ center: center.map(rounded).join(","), zoom: rounded(resolution) });
    // Without a pointer the values are those at the middle.
    const known = this.place !== null && center.every((each, k) => each === this.place![k]);
    if (!known && !this.target.matches(":hover")) void this.read(center, this.map.getPixelFromCoordinate(center) as Point);
  }

  private readonly fields = ["x1", "y1", "x2", "y2"].map((name) =>
    element("input", { name, type: "text", inputmode: "decimal", size: 5, "aria-label": `${name[0]} of the ${name[1] === "1" ? "beginning" : "end"}, metres` }),
  );
  private readonly drawing = element("button", { type: "button", "aria-pressed": "false" }, "Draw");

  /** Return the box of the profile: drawn, or given by the coordinates of its ends. */
  private lineBox(): HTMLElement {
    this.drawing.onclick = () => this.setDrawing(this.drawing.getAttribute("aria-pressed") !== "true");
    const [x1, y1, x2, y2] = this.fields;
    const enter = (event: Event): void => {
      event.preventDefault();
      const ends = numbersOf(this.fields.map((each) => each.value || "x").join(","), 4);
      if (ends) this.setLine([[ends[0]!, ends[1]!], [ends[2]!, ends[3]!]]);
    };
    const remove = element("button", { type: "button", onclick: () => this.setLine(null) }, "Remove");
    return element(
      "fieldset",
      {},
      element("legend", {}, "Profile"),
      element("div", { class: "row" }, this.drawing, remove),
      element("form", { class: "ends", onsubmit: enter }, x1, y1, "to", x2, y2, element("button", { type: "submit" }, "Show")),
    );
  }

  private setDrawing(active: boolean): void {
    this.drawing.setAttribute("aria-pressed", String(active));
    this.drawing.textContent = active ? "Click both ends" : "Draw";
    this.tools.draw(active);
  }

  private setLine(line: [Point, Point] | null): void {
    const half = this.first.about.side_m / 2;
    // The digits of the address: a link shows the same numbers.
    const onGrid = (each: number): number => Number(rounded(Math.min(half, Math.max(-half, each))));
    line = line && (line.map((point) => point.map(onGrid)) as [Point, Point]);
    this.line = line;
    this.setDrawing(false);
    this.tools.setLine(line);
    const ends = line?.flat().map(rounded);
    this.fields.forEach((field, k) => (field.value = ends?.[k] ?? ""));
    keepInAddress({ line: ends?.join(",") ?? "" });
    const surfaces = this.second ? [this.first, this.second] : [this.first];
    this.profile.show(line, surfaces).catch((error: unknown) => this.say(error));
  }

  private asked = new AbortController();
  /** Where the values shown, or asked for, are; null: nowhere. */
  private place: Point | null = null;

  /** Show the values of all layers at a point, of the surface that is seen there. */
  private async read(point: Point | null, pixel: Point): Promise<void> {
    this.asked.abort();
    this.asked = new AbortController();
    const { signal } = this.asked;
    this.place = point;
    const surface = this.second && this.swipe.isSecond(pixel[0]) ? this.second : this.first;
    try {
      const found = point && (await surface.values(point, AbortSignal.any([signal, this.signal])));
      if (!signal.aborted && !this.signal.aborted) this.showValues(surface, found);
    } catch (error) {
      if (!signal.aborted && !this.signal.aborted) this.say(error);
    }
  }

  /** Show values; dashes outside the surface, so that the page does not move. */
  private showValues(surface: Surface, found: PointValues | null): void {
    const { kind, name, layers } = surface.about;
    const item = (title: string, text: string | null, key = ""): HTMLElement =>
      element("div", key ? { "data-layer": key } : {}, element("dt", {}, title), element("dd", {}, text ?? "–"));
    const shown = layers.filter((each) => each.name !== "hillshade");
    fill(
      this.values,
      element(
        "dl",
        { "aria-label": `Values of ${kind} ${name}` },
        item("Surface", found ? `${kind} ${name}` : "none here"),
        item("x, y", found && `${metres(found.x_m)}, ${metres(found.y_m)}`),
        item("Longitude, latitude", found && `${degrees(found.longitude_deg, 3)} E, ${degrees(found.latitude_deg, 3)}`),
        item("Radius", found && metres(found.radius_m, 6)),
        ...shown.map((each) => item(titleOf(each.name), found && worded(each, found.layers[each.name]), each.name)),
      ),
    );
    this.values.style.minHeight = `${this.values.offsetHeight}px`;
  }

  private say(error: unknown): void {
    const text = error instanceof ApiProblem ? error.line : String(error);
    fill(this.values, element("p", { class: "problem", role: "alert" }, text));
  }
}
