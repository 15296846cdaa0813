// Pictures with smooth edges. They take several times as long where there is no graphics processor,
// so that it must be possible to leave them out: the canvas itself has none.
import {
  BufferAttribute, BufferGeometry, Camera, GLSL3, Mesh, NoBlending, RawShaderMaterial, Scene, Vector2,
  WebGLRenderTarget, type WebGLRenderer,
} from "three";
import { COPY_FRAGMENT, COPY_VERTEX } from "./shaders";

const SAMPLES = 4;

export class SmoothPicture {
  private readonly target = new WebGLRenderTarget(1, 1, { samples: SAMPLES });
  private readonly copied = new Scene();
  private readonly geometry = new BufferGeometry();
  private readonly material = new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: COPY_VERTEX,
    fragmentShader: COPY_FRAGMENT,
    uniforms: { picture: { value: this.target.texture } },
    blending: NoBlending,
    depthTest: false,
    depthWrite: false,
  });
  private readonly size = new Vector2();
  private readonly camera = new Camera();

  constructor() {
    // One triangle that covers the whole canvas.
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const mesh = new Mesh(this.geometry, this.material);
    mesh.frustumCulled = false;
    this.copied.add(mesh);
  }

  /** Draw a scene onto the canvas. */
  render(renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
    renderer.getDrawingBufferSize(this.size);
    this.target.setSize(this.size.x, this.size.y);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    renderer.render(this.copied, this.camera);
  }

  /** Free what the graphics processor holds. */
  close(): void {
    this.target.dispose();
    this.geometry.dispose();
    this.material.dispose();
  }
}
