// The body as it is drawn: only when something has changed.
import {
  BufferAttribute, BufferGeometry, DataTexture, FloatType, GLSL3, Group, LineSegments, Mesh, NearestFilter,
  NoColorSpace, OrthographicCamera, RGBAFormat, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderTarget,
  WebGLRenderer,
} from "three";
import type { Rgb } from "../../colormaps";
import { setCamera, towards, type Look } from "./camera";
import { DetailChoice, DETAILS } from "./detail";
import { facing, type BodyMesh } from "./mesh";
import { linesOf, simplify, type Outline } from "./outlines";
import { FRAGMENT, NOTHING, PICK_FRAGMENT, VERTEX } from "./shaders";
import { SmoothPicture } from "./smooth";

const SETTLED_MS = 180;
// Every so many frames one is timed, and a new detail twice: waiting for a picture takes time, too.
const TIMED = 6;

/** How a layer is drawn. */
export interface Painted {
  table: Rgb[];
  range: [number, number];
  /** Values are codes, which are not mixed. */
  codes: boolean;
  shading: number;
}

/** What lies under a point of the picture. */
export interface Picked {
  point: Vector3;
  /** NaN where unknown, or without a layer. */
  value: number;
}

/** Return what draws on a canvas until the signal aborts; null if this browser has no WebGL 2. */
export function rendererOf(canvas: HTMLCanvasElement, signal: AbortSignal): WebGLRenderer | null {
  const context = canvas.getContext("webgl2", { antialias: false, alpha: true, powerPreference: "high-performance" });
  if (!context) return null;
  const renderer = new WebGLRenderer({ canvas, context });
  renderer.setClearColor(0, 0);
  signal.addEventListener("abort", () => {
    renderer.dispose();
    renderer.forceContextLoss();
  });
  return renderer;
}

export class BodyScene {
  readonly camera = new OrthographicCamera();
  private readonly scene = new Scene();
  private readonly world = new Group();
  private readonly geometry = new BufferGeometry();
  private readonly material: ShaderMaterial;
  private readonly picking: ShaderMaterial;
  private readonly surface: Mesh;
  private readonly target = new WebGLRenderTarget(1, 1, { type: FloatType, format: RGBAFormat });
  private readonly meshes: BufferAttribute[];
  private readonly facingEye: BufferAttribute;
  private readonly smooth = new SmoothPicture();
  private readonly choice = new DetailChoice();
  private readonly lines = new Map<string, LineSegments>();
  /** Which of the details is drawn. Until all is there it is a coarse one: something is seen at once. */
  private detail = this.choice.at;
  private frames = 0;
  private awaited: (() => void) | null = null;
  private loading = true;
  private look: Look = { longitude: 0, latitude: 0, width: 1 };
  private light: Vector3 | null = null;
  private asked = 0;
  private settling = 0;
  /** From where, and how many facets of the whole mesh were seen last. */
  private faced: Vector3 | null = null;
  private facing = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly renderer: WebGLRenderer,
    readonly mesh: BodyMesh,
    private readonly measured: (cost: number) => void,
  ) {
    this.meshes = [mesh.faces, ...mesh.coarse].map((faces) => new BufferAttribute(faces, 1));
    this.facingEye = new BufferAttribute(new Uint32Array(mesh.faces.length), 1);
    this.geometry.setAttribute("position", new BufferAttribute(mesh.positions, 3));
    this.geometry.setAttribute("normal", new BufferAttribute(mesh.normals, 4, true));
    this.setValues(null);
    this.geometry.setIndex(this.meshes[1]!);
    const uniforms = {
      table: { value: tableTexture([[128, 128, 128]]) },
      range: { value: new Vector2(0, 1) },
      light: { value: new Vector3(0, 0, 1) },
      plain: { value: [0.72, 0.71, 0.69] },
      hatch: { value: [0.5, 0.5, 0.5] },
      shading: { value: 1 },
      kind: { value: 0 },
    };
    const shared = { glslVersion: GLSL3, vertexShader: VERTEX, uniforms } as const;
    this.material = new ShaderMaterial({ ...shared, fragmentShader: FRAGMENT });
    this.picking = new ShaderMaterial({ ...shared, fragmentShader: PICK_FRAGMENT });
    this.surface = new Mesh(this.geometry, this.material);
    this.surface.position.set(...mesh.center);
    this.surface.frustumCulled = false;
    this.world.add(this.surface);
    this.scene.add(this.world);
  }

  /** Look from elsewhere; while this goes on a slow machine draws fewer facets. */
  turn(look: Look): void {
    this.look = look;
    this.detail = this.choice.at;
    clearTimeout(this.settling);
    if (!this.loading) this.settling = window.setTimeout(() => this.settle(), SETTLED_MS);
    this.draw();
  }

  /** Draw all there is; resolves when it is drawn. */
  whole(): Promise<void> {
    this.loading = false;
    return new Promise((resolve) => {
      this.awaited = resolve;
      this.settle();
    });
  }

  private settle(): void {
    clearTimeout(this.settling);
    this.choice.fade();
    this.detail = 0;
    this.draw();
  }

  /** Set where the light comes from, in the body's frame; null: from the upper left of the view. */
  shine(place: [number, number] | null): void {
    this.light = place && towards(...place);
    this.draw();
  }

  /** Set the values of vertices, NaN where unknown; null: no layer. */
  setValues(values: Float32Array | null): void {
    const count = this.mesh.positions.length / 3;
    const given = values ?? new Float32Array(1);
    const known = values ? given.map((value) => (Number.isNaN(value) ? NOTHING : value)) : new Float32Array(count);
    this.geometry.setAttribute("value", new BufferAttribute(known, 1));
  }

  /** Set the colours; null: none, shaded grey. */
  paint(painted: Painted | null): void {
    const { uniforms } = this.material;
    uniforms.kind!.value = painted ? (painted.codes ? 2 : 1) : 0;
    uniforms.shading!.value = painted?.shading ?? 1;
    if (painted) {
      (uniforms.table!.value as DataTexture).dispose();
      uniforms.table!.value = tableTexture(painted.table);
      (uniforms.range!.value as Vector2).set(...painted.range);
    }
    this.draw();
  }

  /** Show or hide the outlines of a kind. */
  outline(kind: string, squares: Outline[], ink: [number, number, number]): void {
    const before = this.lines.get(kind);
    if (before) {
      this.world.remove(before);
      before.geometry.dispose();
      (before.material as ShaderMaterial).dispose();
      this.lines.delete(kind);
    }
    if (squares.length) {
      const lines = linesOf(squares, this.mesh, ink);
      this.lines.set(kind, lines);
      this.world.add(lines);
    }
    this.draw();
  }

  /** Draw with the next frame of the screen. */
  draw(): void {
    if (!this.asked) this.asked = requestAnimationFrame(() => this.frame());
  }

  /** Return what lies under CSS pixels of the canvas; null off the body. */
  pick(x: number, y: number): Picked | null {
    const { clientWidth, clientHeight } = this.canvas;
    this.camera.setViewOffset(clientWidth, clientHeight, x, y, 1, 1);
    this.surface.material = this.picking;
    for (const each of this.lines.values()) each.visible = false;
    this.renderer.setRenderTarget(this.target);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    const found = new Float32Array(4);
    this.renderer.readRenderTargetPixels(this.target, 0, 0, 1, 1, found);
    this.renderer.setRenderTarget(null);
    this.surface.material = this.material;
    for (const each of this.lines.values()) each.visible = true;
    this.camera.clearViewOffset();
    const [value, known, depth, hit] = found as unknown as [number, number, number, number];
    if (hit < 0.5) return null;
    const across = (2 * x) / clientWidth - 1;
    const up = 1 - (2 * y) / clientHeight;
    const point = new Vector3(across, up, 2 * depth - 1).unproject(this.camera);
    return { point, value: known > 0.5 && this.material.uniforms.kind!.value ? value : Number.NaN };
  }

  /** Return the direction of the camera from the body. */
  get eye(): Vector3 {
    return towards(this.look.longitude, this.look.latitude);
  }

  /** Free what the graphics processor holds. */
  close(): void {
    cancelAnimationFrame(this.asked);
    clearTimeout(this.settling);
    this.geometry.dispose();
    this.material.dispose();
    this.picking.dispose();
    this.target.dispose();
    this.smooth.close();
  }

  private frame(): void {
    this.asked = 0;
    this.fit();
    setCamera(this.camera, this.look, this.canvas.clientWidth / this.canvas.clientHeight, this.mesh.radius);
    this.shineAndFace();
    const { detail } = this;
    // A graphics processor draws all facets faster than those that face it are found.
    if (detail > 0 || this.choice.at === 0) this.all(this.meshes[DETAILS[detail]!.mesh]!);
    else this.faceEye();
    for (const each of this.lines.values()) simplify(each, detail > 0);
    const begin = performance.now();
    if (detail > 0) this.renderer.render(this.scene, this.camera);
    else this.smooth.render(this.renderer, this.scene, this.camera);
    if (this.frames++ % TIMED < 2) this.time(begin);
    if (detail > 0 || !this.awaited) return;
    this.awaited();
    this.awaited = null;
  }

  /** Time the frame that has begun, and choose the detail of the next one after it. */
  private time(begin: number): void {
    const gl = this.renderer.getContext();
    // Waits until the picture is there.
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    const cost = performance.now() - begin;
    if (this.detail === 0) this.measured(cost);
    if (this.choice.note(this.detail, cost)) this.frames = 0;
  }

  /** Whether the last picture has the size of the canvas on the page. */
  get fits(): boolean {
    const size = this.renderer.getSize(new Vector2());
    return size.x === this.canvas.clientWidth && size.y === this.canvas.clientHeight;
  }

  private all(facets: BufferAttribute): void {
    this.geometry.setIndex(facets);
    this.geometry.setDrawRange(0, Infinity);
  }

  /** Draw of the whole mesh what faces the camera: the other half costs a quarter of a picture made in software. */
  private faceEye(): void {
    const { eye, facingEye } = this;
    if (!this.faced?.equals(eye)) {
      this.facing = facing(this.mesh, eye, facingEye.array as Uint32Array);
      facingEye.clearUpdateRanges();
      facingEye.addUpdateRange(0, 3 * this.facing);
      facingEye.needsUpdate = true;
      this.faced = eye;
    }
    this.geometry.setIndex(facingEye);
    this.geometry.setDrawRange(0, 3 * this.facing);
  }

  private fit(): void {
    const { clientWidth, clientHeight } = this.canvas;
    const ratio = Math.min(2, devicePixelRatio) * DETAILS[this.detail]!.ratio;
    if (this.fits && this.renderer.getPixelRatio() === ratio) return;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(clientWidth, clientHeight, false);
  }

  private shineAndFace(): void {
    const fixed = this.light;
    const light = this.material.uniforms.light!.value as Vector3;
    // 45° high, from the upper left, as in the maps.
    if (fixed) light.copy(fixed);
    else light.set(-0.5, 0.5, Math.SQRT1_2).applyQuaternion(this.camera.quaternion);
    for (const each of this.lines.values()) {
      ((each.material as ShaderMaterial).uniforms.eye!.value as Vector3).copy(this.eye);
    }
  }
}

function tableTexture(table: Rgb[]): DataTexture {
  const bytes = new Uint8Array(4 * 256);
  for (let k = 0; k < 256; k++) bytes.set([...(table[Math.min(k, table.length - 1)] ?? [0, 0, 0]), 255], 4 * k);
  const texture = new DataTexture(bytes, 256, 1, RGBAFormat);
  Object.assign(texture, { minFilter: NearestFilter, magFilter: NearestFilter, colorSpace: NoColorSpace });
  texture.needsUpdate = true;
  return texture;
}
