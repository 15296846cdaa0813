// The map of OpenLayers: one or two surfaces over a hatched ground, and the line of the profile.
import Feature from "ol/Feature.js";
import OlMap from "ol/Map.js";
import View from "ol/View.js";
import { defaults as defaultControls } from "ol/control/defaults.js";
import LineString from "ol/geom/LineString.js";
import PointGeometry from "ol/geom/Point.js";
import { fromExtent } from "ol/geom/Polygon.js";
import Draw from "ol/interaction/Draw.js";
import VectorLayer from "ol/layer/Vector.js";
import Projection from "ol/proj/Projection.js";
import VectorSource from "ol/source/Vector.js";
import CircleStyle from "ol/style/Circle.js";
import Fill from "ol/style/Fill.js";
import Stroke from "ol/style/Stroke.js";
import Style from "ol/style/Style.js";
import { onTheme, themed } from "../../theme";
import type { Point, Surface } from "./surface";

const LINE = [new Style({ stroke: new Stroke({ color: "#000000", width: 4 }) }), new Style({ stroke: new Stroke({ color: "#ffffff", width: 1.8 }) })];
const MARK = new Style({
  image: new CircleStyle({ radius: 5, fill: new Fill({ color: "#ffffff" }), stroke: new Stroke({ color: "#000000", width: 2 }) }),
});

interface Hooks {
  /** Middle and metres per pixel after a movement. */
  moved(center: Point, resolution: number): void;
  /** A point of the map under the pointer, with its pixel; null: none. */
  pointed(point: Point | null, pixel: Point): void;
  /** A line has been drawn. */
  drawn(line: [Point, Point]): void;
}

/** Make the map in an element that has a size. */
export function makeMap(target: HTMLElement, surface: Surface, state: { center: Point | null; resolution: number | null }, signal: AbortSignal) {
  const reach = surface.reach;
  const extent = [-reach, -reach, reach, reach];
  const projection = new Projection({ code: "local", units: "m", extent, getPointResolution: (each) => each });
  const fitting = (2.08 * reach) / Math.max(50, Math.min(target.clientWidth, target.clientHeight));
  const map = new OlMap({
    target,
    controls: defaultControls({ attribution: false, rotate: false, zoom: false }),
    view: new View({
      projection,
      center: state.center ?? [0, 0],
      resolution: state.resolution ?? fitting,
      minResolution: surface.about.gsd_m / 40,
      maxResolution: 2 * fitting,
      constrainRotation: true,
      enableRotation: false,
      extent: [-2 * reach, -2 * reach, 2 * reach, 2 * reach],
      constrainOnlyCenter: true,
      smoothExtentConstraint: false,
    }),
  });
  const ground = new VectorLayer({ source: new VectorSource({ features: [new Feature(fromExtent(extent))] }), zIndex: 0 });
  const hatch = (): void => ground.setStyle(new Style({ fill: new Fill({ color: hatching() }), stroke: new Stroke({ color: themed("--line"), width: 1 }) }));
  hatch();
  onTheme(hatch, signal);
  map.addLayer(ground);
  signal.addEventListener("abort", () => {
    map.setTarget(undefined);
    map.dispose();
  });
  return { map, projection, fitting };
}

/** Hear movements and pointers of a map; return what sets the line and the mark of its profile. */
export function listen(map: OlMap, hooks: Hooks) {
  const view = map.getView();
  map.on("moveend", () => hooks.moved(view.getCenter() as Point, view.getResolution()!));
  map.on("pointermove", (event) => {
    if (!event.dragging) hooks.pointed(event.coordinate as Point, event.pixel as Point);
  });
  const source = new VectorSource();
  const marks = new VectorSource();
  map.addLayer(new VectorLayer({ source, style: LINE, zIndex: 10 }));
  map.addLayer(new VectorLayer({ source: marks, style: MARK, zIndex: 11 }));
  let drawing: Draw | null = null;
  const setLine = (line: [Point, Point] | null): void => {
    source.clear();
    marks.clear();
    if (line) source.addFeature(new Feature(new LineString(line)));
  };
  return {
    setLine,
    mark(point: Point | null): void {
      marks.clear();
      if (point) marks.addFeature(new Feature(new PointGeometry(point)));
    },
    /** Let the user draw a line, or not. */
    draw(active: boolean): void {
      if (drawing) map.removeInteraction(drawing);
      drawing = null;
      if (!active) return;
      drawing = new Draw({ type: "LineString", maxPoints: 2, style: [...LINE, MARK] });
      drawing.on("drawend", (event) => {
        const ends = (event.feature.getGeometry() as LineString).getCoordinates();
        hooks.drawn([ends[0], ends[ends.length - 1]] as [Point, Point]);
      });
      map.addInteraction(drawing);
    },
  };
}

/** Return stripes that stand for "unknown". */
function hatching(): CanvasPattern {
  const tile = document.createElement("canvas");
  [tile.width, tile.height] = [8, 8];
  const context = tile.getContext("2d")!;
  context.fillStyle = themed("--panel");
  context.fillRect(0, 0, 8, 8);
  context.strokeStyle = themed("--quiet");
  context.globalAlpha = 0.55;
  for (const k of [-8, 0, 8]) {
    context.moveTo(k, 8);
    context.lineTo(k + 8, 0);
  }
  context.stroke();
  return context.createPattern(tile, "repeat")!;
}
