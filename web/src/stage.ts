// The picture: one renderer, one scene, one camera, and a part of the window for each side.

import * as THREE from "three";

import type { Arrangement } from "./view_state";

export interface Viewport {
  side: number; // whose points and boxes are seen; -1: both
  x: number; // in CSS pixels, from the upper left corner
  y: number;
  width: number;
  height: number;
}

/** The layer of three.js that a side's objects are in; layer 0 is what both see. */
export const layerOf = (side: number): number => side + 1;

export class Stage {
  readonly scene = new THREE.Scene();
  readonly renderer: THREE.WebGLRenderer;
  readonly background = new THREE.Color();
  viewports: Viewport[] = [];
  width = 1;
  height = 1;
  private readonly sky = new THREE.HemisphereLight(0xffffff, 0x8a8378, 1.9);
  private readonly sun = new THREE.DirectionalLight(0xffffff, 1.5);
  private readonly fog = new THREE.FogExp2(0, 0);

  constructor(readonly canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({
      canvas,
      // Smooth edges cost a processor that draws by itself more than half its pictures.
      antialias: !drawnBySoftware(),
      powerPreference: "high-performance",
    });
    this.renderer.localClippingEnabled = true;
    this.renderer.autoClear = false;
    this.sky.position.set(0, 0, 1);
    this.sun.position.set(-0.5, -0.7, 1.2);
    this.scene.add(this.sky, this.sun);
    this.scene.fog = this.fog;
  }

  get ratio(): number {
    return this.renderer.getPixelRatio();
  }

  resize(width: number, height: number): void {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(this.width, this.height, false);
  }

  setBackground(css: string, fog: number): void {
    this.background.setStyle(css);
    this.fog.color.copy(this.background);
    this.fog.density = fog;
  }

  arrange(sides: number, arrangement: Arrangement): void {
    const { width, height } = this;
    const whole = { x: 0, y: 0, width, height };
    if (sides < 2) this.viewports = [{ side: 0, ...whole }];
    else if (arrangement === "over") this.viewports = [{ side: -1, ...whole }];
    else if (arrangement === "first") this.viewports = [{ side: 0, ...whole }];
    else if (arrangement === "second") this.viewports = [{ side: 1, ...whole }];
    else if (width >= height) {
      const half = Math.floor(width / 2);
      this.viewports = [
        { side: 0, x: 0, y: 0, width: half, height },
        { side: 1, x: half, y: 0, width: width - half, height },
      ];
    } else {
      const half = Math.floor(height / 2);
      this.viewports = [
        { side: 0, x: 0, y: 0, width, height: half },
        { side: 1, x: 0, y: half, width, height: height - half },
      ];
    }
  }

  /** The viewport at a place of the canvas. */
  at(x: number, y: number): Viewport {
    return (
      this.viewports.find((v) => x >= v.x && x < v.x + v.width && y >= v.y && y < v.y + v.height) ??
      this.viewports[0]!
    );
  }

  /** The matrix from the scene to a viewport's clip space. */
  matrixOf(viewport: Viewport, camera: THREE.PerspectiveCamera): THREE.Matrix4 {
    this.fit(viewport, camera);
    return new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
  }

  /** The ray through a place of the canvas. */
  rayAt(x: number, y: number, camera: THREE.PerspectiveCamera): THREE.Ray {
    const v = this.at(x, y);
    this.fit(v, camera);
    const raycaster = new THREE.Raycaster();
    const place = new THREE.Vector2(((x - v.x) / v.width) * 2 - 1, 1 - ((y - v.y) / v.height) * 2);
    raycaster.setFromCamera(place, camera);
    return raycaster.ray;
  }

  /** Pixels (of the device) that a metre at one metre from the eye takes. */
  pixelsPerMetre(camera: THREE.PerspectiveCamera): number {
    const height = this.viewports[0]?.height ?? this.height;
    return (height * this.ratio) / (2 * Math.tan((camera.fov * Math.PI) / 360));
  }

  render(camera: THREE.PerspectiveCamera): void {
    const { renderer } = this;
    renderer.setScissorTest(false);
    renderer.setClearColor(this.background, 1);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const v of this.viewports) {
      const bottom = this.height - v.y - v.height;
      renderer.setViewport(v.x, bottom, v.width, v.height);
      renderer.setScissor(v.x, bottom, v.width, v.height);
      this.fit(v, camera);
      camera.layers.set(0);
      if (v.side < 0) {
        camera.layers.enable(layerOf(0));
        camera.layers.enable(layerOf(1));
      } else camera.layers.enable(layerOf(v.side));
      renderer.render(this.scene, camera);
    }
  }

  private fit(viewport: Viewport, camera: THREE.PerspectiveCamera): void {
    const aspect = viewport.width / viewport.height;
    if (Math.abs(camera.aspect - aspect) > 1e-6) {
      camera.aspect = aspect;
      camera.updateProjectionMatrix();
    }
    camera.updateMatrixWorld();
  }
}

/** Whether the browser draws without a graphics card. */
function drawnBySoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const told = context?.getExtension("WEBGL_debug_renderer_info");
  const name = told ? String(context?.getParameter(told.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

/** A grid of ten metres on the ground, with lines that fade before they crowd. */
export function groundGrid(z: number): THREE.GridHelper {
  const grid = new THREE.GridHelper(240, 24);
  grid.rotation.x = Math.PI / 2;
  grid.position.z = z - 0.02;
  const material = grid.material as THREE.LineBasicMaterial;
  material.transparent = true;
  material.vertexColors = false;
  material.opacity = 0.35;
  material.depthWrite = false;
  grid.renderOrder = -1;
  return grid;
}

export function inLayer(object: THREE.Object3D, layer: number): void {
  object.traverse((one) => one.layers.set(layer));
}
