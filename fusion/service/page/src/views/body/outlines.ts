// The squares of maplets, mapolas and bigmaps, laid onto the body.
import { BufferAttribute, BufferGeometry, GLSL3, LineSegments, ShaderMaterial, Vector3 } from "three";
import { cellOf, type BodyMesh } from "./mesh";
import { LINE_FRAGMENT, LINE_VERTEX } from "./shaders";

const MANY = 400;

type Triple = [number, number, number];

/** What the route "outlines" answers. */
export interface OutlineTable {
  kind: string;
  name: string[];
  center_m: Triple[];
  axes: [Triple, Triple, Triple][];
  side_m: number[];
}

/** A square on the body. */
export interface Outline {
  kind: string;
  name: string;
  center: Vector3;
  /** Ux (down), Uy (right) and Uz (outward). */
  axes: [Vector3, Vector3, Vector3];
  side: number;
}

const PARTS = 6;
const LIFT = 0.004;
const LANDINGS = 4;

/** Return the squares of a table. */
export function outlinesOf(table: OutlineTable): Outline[] {
  return table.name.map((name, k) => ({
    kind: table.kind,
    name,
    center: new Vector3(...table.center_m[k]!),
    axes: table.axes[k]!.map((axis) => new Vector3(...axis)) as Outline["axes"],
    side: table.side_m[k]!,
  }));
}

/** Draw fewer lines, or all. */
export function simplify({ geometry }: LineSegments, fewer: boolean): void {
  geometry.setIndex(fewer ? (geometry.userData.few as BufferAttribute) : null);
}

/** Return the lines of squares; their material's `eye` is the direction of the camera. */
export function linesOf(squares: Outline[], mesh: BodyMesh, ink: [number, number, number]): LineSegments {
  const positions = new Float32Array(squares.length * 4 * PARTS * 6);
  const outward = new Float32Array(positions.length);
  let at = 0;
  for (const square of squares) {
    const rim = rimOf(square, mesh);
    for (let k = 0; k < rim.length; k++) {
      for (const point of [rim[k]!, rim[(k + 1) % rim.length]!]) {
        point.toArray(positions, at);
        square.axes[2].toArray(outward, at);
        at += 3;
      }
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("outward", new BufferAttribute(outward, 3));
  // While the body turns: four straight lines for each square.
  const few = new Uint32Array(8 * squares.length);
  for (let k = 0; k < few.length; k++) few[k] = 8 * PARTS * (k >> 3) + 2 * PARTS * (((k + 1) >> 1) & 3);
  geometry.userData.few = new BufferAttribute(few, 1);
  const material = new ShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: LINE_VERTEX,
    fragmentShader: LINE_FRAGMENT,
    // Many lines would hide what they lie on.
    uniforms: { eye: { value: new Vector3() }, ink: { value: ink }, opacity: { value: squares.length > MANY ? 0.3 : 1 } },
    transparent: true,
    depthTest: false,
  });
  const lines = new LineSegments(geometry, material);
  lines.frustumCulled = false;
  lines.renderOrder = 1;
  return lines;
}

/** Return the smallest square, of equals the nearest, around a point of the body's surface. */
export function squareAt(point: Vector3, eye: Vector3, squares: Outline[]): Outline | null {
  let [best, cost]: [Outline | null, number] = [null, Infinity];
  const away = new Vector3();
  for (const square of squares) {
    away.subVectors(point, square.center);
    const [down, right, up] = square.axes.map((axis) => Math.abs(away.dot(axis))) as Triple;
    const reach = Math.max(down, right);
    if (reach > square.side / 2 || up > square.side || square.axes[2].dot(eye) < 0) continue;
    const found = square.side * (1 + reach / square.side);
    if (found < cost) [best, cost] = [square, found];
  }
  return best;
}

/** Return points along the rim of a square on the surface, a little above it. */
function rimOf(square: Outline, mesh: BodyMesh): Vector3[] {
  const [down, right, up] = square.axes;
  const corners: [number, number][] = [[-1, -1], [-1, 1], [1, 1], [1, -1]];
  const found: Vector3[] = [];
  corners.forEach(([i, j], k) => {
    const [m, n] = corners[(k + 1) % 4]!;
    for (let part = 0; part < PARTS; part++) {
      const share = part / PARTS;
      const point = square.center
        .clone()
        .addScaledVector(down, ((i + (m - i) * share) * square.side) / 2)
        .addScaledVector(right, ((j + (n - j) * share) * square.side) / 2);
      found.push(landed(point, up, mesh));
    }
  });
  return found;
}

/** Move a point along `up` until it has the distance from the origin that the body has there. */
function landed(point: Vector3, up: Vector3, mesh: BodyMesh): Vector3 {
  const begin = point.clone();
  for (let k = 0; k < LANDINGS; k++) {
    const wanted = (1 + LIFT) * mesh.radii[cellOf(mesh.rows, point.x, point.y, point.z)]!;
    // |begin + t up| = wanted; the outer one of both solutions.
    const along = begin.dot(up);
    const under = along * along - begin.lengthSq() + wanted * wanted;
    if (under < 0) break;
    point.copy(begin).addScaledVector(up, Math.sqrt(under) - along);
  }
  return point;
}
