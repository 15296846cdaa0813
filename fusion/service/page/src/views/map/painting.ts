// Tiles of numbers as pictures, which are coloured again in place.
import DataTileSource from "ol/source/DataTile.js";
import TileLayer from "ol/layer/Tile.js";
import TileGrid from "ol/tilegrid/TileGrid.js";
import type Projection from "ol/proj/Projection.js";
import type { Rgb } from "../../colormaps";
import { isSource, tableOf } from "../../layers";
import type { Look } from "../../look";
import type { Surface } from "./surface";

const SIDE = 256;

interface Painted {
  canvas: HTMLCanvasElement;
  values: Float32Array;
  shades: Float32Array | null;
}

/** A surface in the map: the layer of OpenLayers, and how it is coloured. */
export class PaintedSurface {
  readonly layer: TileLayer<DataTileSource>;
  /** Tiles that OpenLayers still has; it drops those not seen for long. */
  private painted = new Set<WeakRef<Painted>>();
  private readonly owned = new WeakMap<HTMLCanvasElement, Painted>();
  private shown = "";

  constructor(
    readonly surface: Surface,
    private readonly projection: Projection,
    private look: Look,
    className: string,
  ) {
    const reach = surface.reach;
    this.layer = new TileLayer<DataTileSource>({ className, extent: [-reach, -reach, reach, reach], cacheSize: KEPT_TILES });
    this.layer.setSource(this.source());
  }

  /** Colour all tiles as `look` says; tiles of another layer are loaded. */
  paint(look: Look): void {
    this.look = look;
    if (look.layer.name !== this.shown) {
      this.layer.setSource(this.source());
      return;
    }
    for (const each of this.painted) {
      const tile = each.deref();
      if (tile) this.colour(tile);
      else this.painted.delete(each);
    }
    this.layer.changed();
  }

  private source(): DataTileSource {
    const { about, reach } = this.surface;
    const coarsestFirst = [...about.levels].reverse();
    const layer = this.look.layer.name;
    this.shown = layer;
    this.painted = new Set();
    return new DataTileSource({
      projection: this.projection,
      tileGrid: new TileGrid({
        extent: [-reach, -reach, reach, reach],
        origin: [-reach, reach],
        resolutions: coarsestFirst.map((each) => each.gsd_m),
        tileSize: SIDE,
      }),
      transition: 0,
      interpolate: false,
      wrapX: false,
      loader: (z, x, y) => this.load(layer, coarsestFirst[z]!.level, y, x),
    });
  }

  private async load(layer: string, level: number, row: number, column: number): Promise<HTMLCanvasElement> {
    const shaded = layer !== "hillshade" && this.surface.layer("hillshade") !== undefined;
    const there = this.surface.layer(layer) !== undefined;
    const [values, shades] = await Promise.all([
      there ? this.surface.tile(layer, level, row, column) : new Float32Array(SIDE * SIDE).fill(Number.NaN),
      shaded ? this.surface.tile("hillshade", level, row, column) : null,
    ]);
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [SIDE, SIDE];
    const tile = { canvas, values, shades };
    this.owned.set(canvas, tile);
    this.painted.add(new WeakRef(tile));
    this.colour(tile);
    return canvas;
  }

  private colour({ canvas, values, shades }: Painted): void {
    const { layer, colours, range, shading } = this.look;
    const table = tableOf(layer, colours);
    const context = canvas.getContext("2d")!;
    const image = context.createImageData(SIDE, SIDE);
    // The code 0 of a source is "none": nothing is drawn there.
    const least = isSource(layer) ? 0.5 : -Infinity;
    fillPixels(image.data, { values, shades: shading > 0 ? shades : null, table, range, shading, least });
    context.putImageData(image, 0, 0);
  }
}

const KEPT_TILES = 128;

interface Pixels {
  values: Float32Array;
  shades: Float32Array | null;
  table: Rgb[];
  range: [number, number];
  shading: number;
  least: number;
}

/** Write colours, transparent where a value is unknown. */
export function fillPixels(data: Uint8ClampedArray, { values, shades, table, range, shading, least }: Pixels): void {
  const [low, high] = range;
  const steps = 255 / (high - low);
  for (let k = 0; k < values.length; k++) {
    const value = values[k]!;
    if (!(value >= least)) continue;
    const code = Math.round((value - low) * steps);
    const [red, green, blue] = table[code < 0 ? 0 : code > 255 ? 255 : code]!;
    const shade = shades ? shades[k]! : Number.NaN;
    // Never brighter than the legend: a lit slope must not look like another value.
    const lit = shade >= 0 ? 1 - shading * (1 - shade) : 1;
    data[4 * k] = red * lit;
    data[4 * k + 1] = green * lit;
    data[4 * k + 2] = blue * lit;
    data[4 * k + 3] = 255;
  }
}
