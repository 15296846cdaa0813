// Coverage on the body as a map: density of returns, outlines of surfaces, points below the spacecraft.
import { colourOf, colours, css, legend } from "../../colormaps";
import { element, fill } from "../../dom";
import { count, degrees, metres, number } from "../../format";
import { hrefOf, keepInAddress, type Route } from "../../router";
import { letters, onTheme, themed } from "../../theme";
import { outline, unwrapped, type Point } from "./footprints";
import type { Coverage, Footprints } from "./values";

type SurfaceLayer = "maplets" | "mapolas" | "fused" | "bigmaps";
interface Layer {
  title: string;
  /** CSS variable of its colour. */
  colour?: string;
  /** Kind of surface in the address of a map. */
  kind?: string;
  dash?: number[];
}
interface Place {
  layer: string;
  name: string;
  at: Point;
  size: string;
  href: string;
}

const LAYERS: Record<string, Layer> = {
  returns: { title: "Density of returns" },
  maplets: { title: "Maplets", colour: "--spc", kind: "maplet" },
  mapolas: { title: "Mapolas", colour: "--lidar", kind: "mapola", dash: [4, 2] },
  fused: { title: "Fused", colour: "--fused", kind: "fused", dash: [1, 2] },
  bigmaps: { title: "Bigmaps", colour: "--text", kind: "bigmap" },
  images: { title: "Images (point below the spacecraft)", colour: "--text" },
};
const SHOWN = "returns,maplets,bigmaps";
const NEAR_PX = 14;
const MANY = 400;
const MARGIN = { left: 38, right: 10, top: 8, bottom: 22 };

/** Show the coverage of a workspace; which layers are shown is in the address. */
export async function showCoverage(
  root: HTMLElement,
  route: Route,
  coverage: Promise<Coverage>,
  signal: AbortSignal,
): Promise<void> {
  const canvas = element("canvas", { class: "map", role: "img", tabindex: 0 });
  const line = element("p", { class: "under number", "aria-live": "polite" });
  const shown = new Set((route.query.get("show") ?? SHOWN).split(","));
  const scale = element("div", { class: "row" });
  fill(root, element("h2", { id: "coverage" }, "Coverage"), choices(), canvas, line, scale);
  fill(line, "Reading footprints and returns …");
  const found = await coverage;
  const densities = found.returns.density_per_m2.flat().filter((value) => value > 0);
  const limits = densities.length ? logLimits(densities) : null;
  const places = placesOf(found, route.workspace);
  canvas.setAttribute("aria-label", described(found));
  rest();

  const draw = (): void => drawMap(canvas, found, shown, limits);
  new ResizeObserver(draw).observe(canvas);
  onTheme(draw, signal);
  canvas.addEventListener("pointermove", (event) => {
    const near = nearest(canvas, places, shown, event);
    canvas.classList.toggle("link", Boolean(near?.href));
    if (near) fill(line, `${near.name}, ${near.layer}: ${placeText(near.at)}, ${near.size}`);
    else fill(line, valueText(canvas, found, event));
  });
  canvas.addEventListener("pointerleave", rest);
  canvas.addEventListener("click", (event) => {
    const near = nearest(canvas, places, shown, event);
    if (near?.href) location.hash = near.href;
  });
  showScale();

  function rest(): void {
    fill(line, `${count(found.returns.returns)} returns, ${count(found.images.all)} images. A click near the middle of an outline opens its map.`);
  }

  function showScale(): void {
    const [low, high] = limits ?? [0, 0];
    const asked = shown.has("returns") && limits;
    fill(scale, asked && legend("viridis", number(10 ** low, 2), `${number(10 ** high, 2)} 1/m²`, "Returns (logarithmic)"));
  }

  function choices(): HTMLElement {
    return element(
      "fieldset",
      { class: "row choices" },
      element("legend", { class: "hidden" }, "Layers of the coverage"),
      ...Object.entries(LAYERS).map(([name, layer]) => {
        const box = element("input", { type: "checkbox", checked: shown.has(name), onchange: () => toggle(name, box.checked) });
        return element("label", {}, box, layer.colour && key(layer), ` ${layer.title}`);
      }),
    );
  }

  function toggle(name: string, wanted: boolean): void {
    if (wanted) shown.add(name);
    else shown.delete(name);
    keepInAddress({ show: [...shown].filter(Boolean).join(",") || "none" });
    draw();
    showScale();
  }
}

/** Return a sample of how a layer is drawn. */
function key(layer: Layer): HTMLElement {
  const made = element("canvas", { class: "key", width: 20, height: 10, "aria-hidden": "true" });
  const context = made.getContext("2d")!;
  context.strokeStyle = themed(layer.colour!);
  context.lineWidth = 2;
  context.setLineDash(layer.dash ?? []);
  if (layer.kind) context.strokeRect(2, 1, 16, 8);
  else {
    cross(context, 10, 5);
    context.stroke();
  }
  return made;
}

function drawMap(canvas: HTMLCanvasElement, found: Coverage, shown: Set<string>, limits: [number, number] | null): void {
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d")!;
  context.scale(ratio, ratio);
  const at = (point: Point): Point => project(canvas, point);
  drawGround(context, at);
  if (shown.has("returns") && limits) drawDensity(context, found, at, limits);
  drawGraticule(context, at);
  context.save();
  context.beginPath();
  const [[left, top], [right, bottom]] = [at([0, 90]), at([360, -90])];
  context.rect(left, top, right - left, bottom - top);
  context.clip();
  const drawn = Object.entries(LAYERS).filter(([name, layer]) => shown.has(name) && layer.colour);
  const paths = drawn.map(([name, layer]) => (layer.kind ? outlines(found[name as SurfaceLayer], at) : crosses(found.images, at)));
  // A border in the colour of the ground sets lines apart from the colours below them.
  context.strokeStyle = themed("--ground");
  context.lineWidth = 3.5;
  context.setLineDash([]);
  const many = drawn.map(([name]) => found[name as SurfaceLayer | "images"].name.length > MANY);
  paths.forEach((path, k) => many[k] || context.stroke(path));
  drawn.forEach(([, layer], k) => {
    // Many lines would hide what they lie on.
    context.lineWidth = many[k] ? 0.5 : 1.5;
    context.globalAlpha = many[k] ? 0.45 : 1;
    context.strokeStyle = themed(layer.colour!);
    context.setLineDash(layer.dash ?? []);
    context.stroke(paths[k]!);
  });
  context.restore();
}

function drawGround(context: CanvasRenderingContext2D, at: (point: Point) => Point): void {
  const [[left, top], [right, bottom]] = [at([0, 90]), at([360, -90])];
  context.fillStyle = themed("--panel");
  context.fillRect(left, top, right - left, bottom - top);
}

function drawDensity(
  context: CanvasRenderingContext2D,
  found: Coverage,
  at: (point: Point) => Point,
  [low, high]: [number, number],
): void {
  const step = found.returns.step_deg;
  colours("viridis");
  found.returns.density_per_m2.forEach((row, i) =>
    row.forEach((value, j) => {
      const colour = value > 0 && colourOf("viridis", Math.log10(value), low, high);
      if (!colour) return;
      const [x, y] = at([j * step, -90 + (i + 1) * step]);
      const [x2, y2] = at([(j + 1) * step, -90 + i * step]);
      context.fillStyle = css(colour);
      context.fillRect(x, y, x2 - x + 0.5, y2 - y + 0.5);
    }),
  );
}

function drawGraticule(context: CanvasRenderingContext2D, at: (point: Point) => Point): void {
  context.strokeStyle = themed("--grid");
  context.fillStyle = themed("--quiet");
  context.lineWidth = 1;
  context.font = `11px ${letters()}`;
  context.setLineDash([]);
  context.beginPath();
  const line = (from: Point, to: Point): void => {
    context.moveTo(...at(from));
    context.lineTo(...at(to));
  };
  context.textAlign = "center";
  context.textBaseline = "top";
  for (let longitude = 0; longitude <= 360; longitude += 30) {
    line([longitude, -90], [longitude, 90]);
    const [x, y] = at([longitude, -90]);
    if (longitude % 60 === 0) context.fillText(`${longitude}°${longitude === 180 ? " E" : ""}`, Math.min(x, context.canvas.clientWidth - 16), y + 5);
  }
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (let latitude = -90; latitude <= 90; latitude += 30) {
    line([0, latitude], [360, latitude]);
    const [x, y] = at([0, latitude]);
    context.fillText(degrees(latitude, 0), x - 5, Math.max(y, 8));
  }
  context.stroke();
}

function outlines(of: Footprints, at: (point: Point) => Point): Path2D {
  const path = new Path2D();
  for (let k = 0; k < of.name.length; k++) {
    for (const part of unwrapped(outline(of, k))) {
      part.forEach((point, n) => (n ? path.lineTo(...at(point)) : path.moveTo(...at(point))));
    }
  }
  return path;
}

function crosses(of: Coverage["images"], at: (point: Point) => Point): Path2D {
  const path = new Path2D();
  of.name.forEach((_, k) => cross(path, ...at([of.longitude_deg[k]!, of.latitude_deg[k]!])));
  return path;
}

function cross(path: Path2D | CanvasRenderingContext2D, x: number, y: number): void {
  path.moveTo(x - 3, y);
  path.lineTo(x + 3, y);
  path.moveTo(x, y - 3);
  path.lineTo(x, y + 3);
}

function project(canvas: HTMLCanvasElement, [longitude, latitude]: Point): Point {
  const width = canvas.clientWidth - MARGIN.left - MARGIN.right;
  const height = canvas.clientHeight - MARGIN.top - MARGIN.bottom;
  return [MARGIN.left + (longitude / 360) * width, MARGIN.top + ((90 - latitude) / 180) * height];
}

function placeUnder(canvas: HTMLCanvasElement, event: PointerEvent | MouseEvent): Point | null {
  const width = canvas.clientWidth - MARGIN.left - MARGIN.right;
  const height = canvas.clientHeight - MARGIN.top - MARGIN.bottom;
  const longitude = ((event.offsetX - MARGIN.left) / width) * 360;
  const latitude = 90 - ((event.offsetY - MARGIN.top) / height) * 180;
  return longitude >= 0 && longitude < 360 && Math.abs(latitude) < 90 ? [longitude, latitude] : null;
}

function nearest(canvas: HTMLCanvasElement, places: Place[], shown: Set<string>, event: PointerEvent | MouseEvent): Place | null {
  let best: Place | null = null;
  let least = NEAR_PX;
  for (const place of places) {
    if (!shown.has(place.layer)) continue;
    const [x, y] = project(canvas, place.at);
    const distance = Math.hypot(x - event.offsetX, y - event.offsetY);
    if (distance < least) [best, least] = [place, distance];
  }
  return best;
}

function placesOf(found: Coverage, workspace: string): Place[] {
  const surfaces = Object.entries(LAYERS).flatMap(([layer, { kind }]) => {
    if (!kind) return [];
    const of = found[layer as SurfaceLayer];
    return of.name.map((name, k): Place => {
      // A bigmap is one surface of a site: the fused one is always there.
      const surface = kind === "bigmap" && !name.includes(":") ? `${name}:fused` : name;
      return {
        layer,
        name,
        at: [of.longitude_deg[k]!, of.latitude_deg[k]!],
        size: `${metres(of.side_m[k])} wide, GSD ${metres(of.gsd_m[k])}`,
        href: hrefOf(workspace, "map", [kind, surface]),
      };
    });
  });
  const { images } = found;
  const points = images.name.map((name, k): Place => ({
    layer: "images",
    name,
    at: [images.longitude_deg[k]!, images.latitude_deg[k]!],
    size: `${metres(images.distance_m[k])} from the centre`,
    href: "",
  }));
  return [...surfaces, ...points];
}

function valueText(canvas: HTMLCanvasElement, found: Coverage, event: PointerEvent): string {
  const place = placeUnder(canvas, event);
  if (!place) return "";
  const { step_deg: step, density_per_m2: density } = found.returns;
  const value = density[Math.floor((place[1] + 90) / step)]?.[Math.floor(place[0] / step)];
  return `${placeText(place)}: ${value ? `${number(value, 2)} returns/m²` : "no returns"}`;
}

function placeText([longitude, latitude]: Point): string {
  return `${degrees(longitude, 1)} E, ${degrees(latitude, 1)}`;
}

function described(found: Coverage): string {
  const parts = (["maplets", "mapolas", "fused", "bigmaps"] as const).map((name) => `${found[name].name.length} ${name}`);
  const covered = found.returns.density_per_m2.flat();
  const share = covered.filter((value) => value > 0).length / Math.max(covered.length, 1);
  return `Map of the body: ${parts.join(", ")}; returns in ${Math.round(100 * share)} percent of the cells. The lists below have the places.`;
}

function logLimits(values: number[]): [number, number] {
  const sorted = values.map(Math.log10).sort((a, b) => a - b);
  const low = sorted[Math.floor(sorted.length * 0.02)]!;
  const high = sorted[Math.floor((sorted.length - 1) * 0.98)]!;
  return high - low > 0.1 ? [low, high] : [low - 0.1, high + 0.1];
}
