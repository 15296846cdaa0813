// The service's mesh, and what drawing it needs: normals, a coarse version, radii by direction.

export interface BodyMesh {
  /** Body-fixed metres of the origin of `positions`. */
  center: [number, number, number];
  /** (V, 3) metres from the centre. */
  positions: Float32Array;
  /** (V, 4): outward normals times 127, and 0. */
  normals: Int8Array;
  /** (F, 3) vertices of facets, counter-clockwise seen from outside. */
  faces: Uint32Array;
  /** Facets between ever fewer of the same vertices, for turning on a slow machine; may be all. */
  coarse: Uint32Array[];
  /** Mean distances from the body's origin, `rows` from the south pole × 2 `rows` from 0° east. */
  radii: Float32Array;
  rows: number;
  /** Largest distance from the body's origin. */
  radius: number;
}

interface Header {
  vertices: number;
  faces: number;
  center_m: [number, number, number];
}

// Vertices of the coarse meshes, about.
const COARSE = [20_000, 5_000];

/** Read the mesh of the route "shape". */
export function meshOf(bytes: ArrayBuffer): BodyMesh {
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length))) as Header;
  const begin = 4 + length;
  // Copies: the parts are handed to the page's thread one by one.
  const positions = new Float32Array(bytes, begin, 3 * header.vertices).slice();
  const faces = new Uint32Array(bytes, begin + positions.byteLength, 3 * header.faces).slice();
  const { radii, rows, radius } = radiiOf(positions, header.center_m);
  const coarse: Uint32Array[] = [];
  for (const wanted of COARSE) coarse.push(coarseOf(positions, coarse.at(-1) ?? faces, wanted));
  return { center: header.center_m, positions, normals: normalsOf(positions, faces), faces, coarse, radii, rows, radius };
}

/** Return normals of vertices: means of those of their facets, weighted by area. */
export function normalsOf(positions: Float32Array, faces: Uint32Array): Int8Array {
  const sums = new Float32Array(positions.length);
  for (let k = 0; k < faces.length; k += 3) {
    const a = 3 * faces[k]!;
    const b = 3 * faces[k + 1]!;
    const c = 3 * faces[k + 2]!;
    const ux = positions[b]! - positions[a]!;
    const uy = positions[b + 1]! - positions[a + 1]!;
    const uz = positions[b + 2]! - positions[a + 2]!;
    const vx = positions[c]! - positions[a]!;
    const vy = positions[c + 1]! - positions[a + 1]!;
    const vz = positions[c + 2]! - positions[a + 2]!;
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    for (let corner = 0; corner < 3; corner++) {
      const at = corner === 0 ? a : corner === 1 ? b : c;
      sums[at]! += nx;
      sums[at + 1]! += ny;
      sums[at + 2]! += nz;
    }
  }
  const count = positions.length / 3;
  const normals = new Int8Array(4 * count);
  for (let k = 0; k < count; k++) {
    const x = sums[3 * k]!;
    const y = sums[3 * k + 1]!;
    const z = sums[3 * k + 2]!;
    const size = Math.sqrt(x * x + y * y + z * z) || 1;
    normals[4 * k] = Math.round((127 * x) / size);
    normals[4 * k + 1] = Math.round((127 * y) / size);
    normals[4 * k + 2] = Math.round((127 * z) / size);
  }
  return normals;
}

/** Return facets between about as many vertices as are `wanted`: one vertex of each cell of a cubic grid. */
export function coarseOf(positions: Float32Array, faces: Uint32Array, wanted: number): Uint32Array {
  const count = positions.length / 3;
  if (faces.length / 6 <= 2 * wanted) return faces.slice();
  let reach = 0;
  for (const each of positions) reach = Math.max(reach, Math.abs(each));
  // A closed surface crosses about 6 n² of (n + n)³ cells.
  const n = Math.ceil(Math.sqrt(wanted / 12));
  const step = reach / n;
  const first = new Int32Array((2 * n + 1) ** 3).fill(-1);
  const chosen = new Uint32Array(count);
  for (let k = 0; k < count; k++) {
    const i = Math.floor((positions[3 * k]! + reach) / step);
    const j = Math.floor((positions[3 * k + 1]! + reach) / step);
    const l = Math.floor((positions[3 * k + 2]! + reach) / step);
    const cell = (i * (2 * n + 1) + j) * (2 * n + 1) + l;
    if (first[cell]! < 0) first[cell] = k;
    chosen[k] = first[cell]!;
  }
  const kept = new Uint32Array(faces.length);
  let length = 0;
  for (let k = 0; k < faces.length; k += 3) {
    const a = chosen[faces[k]!]!;
    const b = chosen[faces[k + 1]!]!;
    const c = chosen[faces[k + 2]!]!;
    if (a === b || b === c || a === c) continue;
    kept[length++] = a;
    kept[length++] = b;
    kept[length++] = c;
  }
  return kept.slice(0, length);
}

/** Write the facets whose outer side is seen from the direction `eye` into `found`; return how many. */
export function facing({ positions, faces }: BodyMesh, eye: { x: number; y: number; z: number }, found: Uint32Array): number {
  let length = 0;
  for (let k = 0; k < faces.length; k += 3) {
    const a = 3 * faces[k]!;
    const b = 3 * faces[k + 1]!;
    const c = 3 * faces[k + 2]!;
    const ux = positions[b]! - positions[a]!;
    const uy = positions[b + 1]! - positions[a + 1]!;
    const uz = positions[b + 2]! - positions[a + 2]!;
    const vx = positions[c]! - positions[a]!;
    const vy = positions[c + 1]! - positions[a + 1]!;
    const vz = positions[c + 2]! - positions[a + 2]!;
    const towards = eye.x * (uy * vz - uz * vy) + eye.y * (uz * vx - ux * vz) + eye.z * (ux * vy - uy * vx);
    if (!(towards > 0)) continue;
    found[length++] = faces[k]!;
    found[length++] = faces[k + 1]!;
    found[length++] = faces[k + 2]!;
  }
  return length / 3;
}

/** Return mean distances from the origin in cells of latitude and longitude. */
function radiiOf(
  positions: Float32Array,
  center: [number, number, number],
): { radii: Float32Array; rows: number; radius: number } {
  const count = positions.length / 3;
  const rows = Math.min(180, Math.max(8, Math.floor(Math.sqrt(count / 8))));
  const sums = new Float64Array(2 * rows * rows);
  const numbers = new Float64Array(2 * rows * rows);
  let [radius, all] = [0, 0];
  for (let k = 0; k < count; k++) {
    const x = positions[3 * k]! + center[0];
    const y = positions[3 * k + 1]! + center[1];
    const z = positions[3 * k + 2]! + center[2];
    // Math.hypot takes several times as long as the root.
    const size = Math.sqrt(x * x + y * y + z * z);
    const cell = cellOf(rows, x, y, z);
    sums[cell]! += size;
    numbers[cell]! += 1;
    radius = Math.max(radius, size);
    all += size;
  }
  const radii = Float32Array.from(sums, (sum, k) => (numbers[k] ? sum / numbers[k]! : all / count));
  return { radii, rows, radius };
}

/** Return the cell of a direction. */
export function cellOf(rows: number, x: number, y: number, z: number): number {
  const share = Math.atan2(z, Math.sqrt(x * x + y * y)) / Math.PI + 0.5;
  const turn = Math.atan2(y, x) / (2 * Math.PI);
  const row = Math.min(rows - 1, Math.floor(share * rows));
  const column = Math.min(2 * rows - 1, Math.floor((turn - Math.floor(turn)) * 2 * rows));
  return 2 * rows * row + column;
}
