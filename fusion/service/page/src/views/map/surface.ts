// A surface of the service: its description, its tiles as numbers, values and profiles.
import { ask, getJson } from "../../api";
import type { LayerAbout } from "../../layers";
import { pathOfSurface } from "../ahead";

export interface Place {
  kind: string;
  name: string;
}

interface Level {
  level: number;
  gsd_m: number;
  cells: number;
  tiles: number;
}

export interface SurfaceAbout extends Place {
  gsd_m: number;
  size: number;
  side_m: number;
  tile: number;
  longitude_deg: number;
  latitude_deg: number;
  radius_m: number;
  axes: [Triple, Triple, Triple];
  levels: Level[];
  layers: LayerAbout[];
  etag: string;
  same_place: Place[];
}

export interface PointValues {
  x_m: number;
  y_m: number;
  longitude_deg: number;
  latitude_deg: number;
  radius_m: number | null;
  layers: Record<string, number | null>;
}

export interface ProfileValues {
  distance_m: number[];
  x_m: number[];
  y_m: number[];
  longitude_deg: number[];
  latitude_deg: number[];
  layers: Record<string, (number | null)[]>;
}

type Triple = [number, number, number];
export type Point = [x: number, y: number];

// Tiles of 256 kB each.
const KEPT = 160;

export class Surface {
  private readonly tiles = new Map<string, Promise<Float32Array>>();

  private constructor(
    private readonly path: string,
    readonly about: SurfaceAbout,
  ) {}

  static async open(workspace: string, place: Place, signal: AbortSignal): Promise<Surface> {
    const path = pathOfSurface(workspace, place);
    return new Surface(path, await getJson<SurfaceAbout>(path, { signal }));
  }

  /** Half of the side of the area that the cells cover, metres. */
  get reach(): number {
    return (this.about.size * this.about.gsd_m) / 2;
  }

  /** A layer by its name; undefined if the surface has none. */
  layer(name: string): LayerAbout | undefined {
    return this.about.layers.find((each) => each.name === name);
  }

  /** Return a tile, 256 × 256 values from its upper left, NaN where unknown; kept once loaded. */
  tile(layer: string, level: number, row: number, column: number): Promise<Float32Array> {
    const key = `${layer}/${level}/${row}/${column}`;
    let found = this.tiles.get(key);
    if (found) this.tiles.delete(key);
    else {
      const asked = `${this.path}/tiles/${level}/${row}/${column}?layer=${layer}&format=float32`;
      found = ask(asked).then(async (answer) => new Float32Array(await answer.arrayBuffer()));
      found.catch(() => this.tiles.delete(key));
    }
    this.tiles.set(key, found);
    if (this.tiles.size > KEPT) this.tiles.delete(this.tiles.keys().next().value!);
    return found;
  }

  /** Ask for the tile of a layer, and for its hill-shade, where one tile is the whole surface. */
  askWhole(layer: string): void {
    const [level, ...others] = this.about.levels;
    if (!level || others.length) return;
    for (const each of new Set([layer, "hillshade"])) {
      // Whoever draws it gets the problem.
      if (this.layer(each)) this.tile(each, level.level, 0, 0).catch(() => undefined);
    }
  }

  /** Return all layers at a point on the grid; null outside it. */
  async values([x, y]: Point, signal: AbortSignal): Promise<PointValues | null> {
    if (Math.max(Math.abs(x), Math.abs(y)) > this.about.side_m / 2) return null;
    return getJson<PointValues>(`${this.path}/value?x=${x}&y=${y}`, { signal });
  }

  /** Return all layers along a line; its ends are moved onto the grid. */
  profile(line: [Point, Point], signal: AbortSignal): Promise<ProfileValues> {
    const half = this.about.side_m / 2;
    const [from, to] = line.map((point) => point.map((each) => Math.min(half, Math.max(-half, each))).join(","));
    return getJson<ProfileValues>(`${this.path}/profile?from=${from}&to=${to}`, { signal });
  }
}
