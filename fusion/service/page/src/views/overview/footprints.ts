// Outlines of square surfaces on the body, in longitude and latitude.
import type { Footprints } from "./values";

export type Point = [longitude: number, latitude: number];

// Steps along a side at most: near the poles a side is a curve.
const STEPS = 12;
const STEP = 0.1;
const DEG = Math.PI / 180;

/** Return the outline of a square that faces away from the centre: closed, in degrees. */
export function outline(of: Footprints, k: number): Point[] {
  const [longitude, latitude] = [of.longitude_deg[k]! * DEG, of.latitude_deg[k]! * DEG];
  const half = of.side_m[k]! / 2 / of.radius_m[k]!;
  const [sl, cl, sb, cb] = [Math.sin(longitude), Math.cos(longitude), Math.sin(latitude), Math.cos(latitude)];
  // Radians of longitude along a side.
  const steps = Math.min(STEPS, Math.ceil((2 * half) / Math.max(cb - half, 1e-6) / STEP));
  return edge(steps).map(([east, north]) => {
    const [e, n] = [east * half, north * half];
    const x = cb * cl - sl * e - sb * cl * n;
    const y = cb * sl + cl * e - sb * sl * n;
    const z = sb + cb * n;
    return [(Math.atan2(y, x) / DEG + 360) % 360, Math.atan2(z, Math.hypot(x, y)) / DEG];
  });
}

/** Return an outline in parts that do not cross the border of the map. */
export function unwrapped(points: Point[]): Point[][] {
  const parts: Point[][] = [];
  let part: Point[] = [];
  points.forEach((point, k) => {
    const before = points[k - 1];
    if (before && Math.abs(point[0] - before[0]) > 180) {
      // The same step is drawn at both borders.
      const shift = point[0] < before[0] ? 360 : -360;
      part.push([point[0] + shift, point[1]]);
      parts.push(part);
      part = [[before[0] - shift, before[1]]];
    }
    part.push(point);
  });
  parts.push(part);
  return parts;
}

function edge(steps: number): Point[] {
  const corners: Point[] = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
  const found: Point[] = [];
  for (let k = 0; k < 4; k++) {
    const [one, two] = [corners[k]!, corners[k + 1]!];
    for (let step = 0; step < steps; step++) {
      const share = step / steps;
      found.push([one[0] + (two[0] - one[0]) * share, one[1] + (two[1] - one[1]) * share]);
    }
  }
  return [...found, corners[0]!];
}
