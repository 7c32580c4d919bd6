// The points of one side on the GPU: one geometry used again and again, colours looked up in a table.

import * as THREE from "three";

import type { Table } from "./colour";
import type { PointFrame } from "./frame_data";

const VERTEX = /* glsl */ `
  attribute float value;
  attribute float mark;
  uniform float low, high, categorical, size, pixels, least, most;
  uniform vec4 plane;   // what lies beyond normal · p = w is cut
  uniform float thick;  // and what lies deeper behind it than this, where it is not 0
  uniform float fog;
  varying float entry;
  varying float dim;
  varying float haze;
  void main() {
    vec4 eye = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * eye;
    float beyond = dot(plane.xyz, position) - plane.w;
    bool cut = beyond > 0.0 || (thick > 0.0 && beyond < -thick);
    if (mark > 1.5 || cut) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); gl_PointSize = 0.0; return; }
    float t = categorical > 0.5 ? value / 255.0 : clamp((value - low) / (high - low), 0.0, 1.0);
    entry = value < -0.5 && categorical > 0.5 ? -1.0 : (t * 255.0 + 0.5) / 256.0;
    dim = mark;
    haze = 1.0 - exp(-fog * fog * eye.z * eye.z);
    gl_PointSize = clamp(size * pixels / -eye.z, least, most) * (mark < -0.5 ? 1.35 : 1.0);
  }
`;

const FRAGMENT = /* glsl */ `
  precision mediump float;
  uniform sampler2D table;
  uniform vec3 background, missing;
  varying float entry;
  varying float dim;
  varying float haze;
  void main() {
    vec2 at = gl_PointCoord - 0.5;
    if (dot(at, at) > 0.26) discard;
    vec3 colour = entry < 0.0 ? missing : texture2D(table, vec2(entry, 0.5)).rgb;
    colour = mix(colour, background, max(haze, dim > 0.5 ? 0.72 : 0.0));
    gl_FragColor = vec4(colour, 1.0);
  }
`;

/** What a point's mark says: drawn brighter, as it is, paler, not at all. */
export const MARK = { bright: -1, plain: 0, pale: 1, hidden: 2 } as const;

const POINT_M = 0.06; // a point's diameter in the scene at size 1

export class PointCloud {
  readonly object: THREE.Points;
  value = new Float32Array(0);
  mark = new Int8Array(0);
  private readonly geometry = new THREE.BufferGeometry();
  private readonly material: THREE.ShaderMaterial;
  private readonly table: THREE.DataTexture;

  constructor() {
    this.table = new THREE.DataTexture(new Uint8Array(1024), 256, 1);
    this.table.minFilter = this.table.magFilter = THREE.NearestFilter;
    this.material = new THREE.ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        low: { value: 0 },
        high: { value: 1 },
        categorical: { value: 1 },
        size: { value: POINT_M },
        pixels: { value: 1 },
        least: { value: 1 },
        most: { value: 24 },
        plane: { value: new THREE.Vector4(0, 0, 0, 1) },
        thick: { value: 0 },
        fog: { value: 0 },
        table: { value: this.table },
        background: { value: new THREE.Vector3() },
        missing: { value: new THREE.Vector3(0.5, 0.5, 0.5) },
      },
    });
    this.object = new THREE.Points(this.geometry, this.material);
    this.object.frustumCulled = false;
    this.object.visible = false;
  }

  /** Takes a frame's positions; `value` and `mark` are as long as they need to be from then on. */
  load(frame: PointFrame): void {
    const position = this.geometry.getAttribute("position") as THREE.BufferAttribute | undefined;
    if (position === undefined || position.array !== frame.position) {
      const capacity = frame.position.length / 3;
      this.geometry.dispose(); // the old buffers leave the GPU
      this.value = new Float32Array(capacity);
      this.mark = new Int8Array(capacity);
      this.attribute("position", frame.position, 3);
      this.attribute("value", this.value, 1);
      this.attribute("mark", this.mark, 1);
    }
    this.geometry.setDrawRange(0, frame.count);
    this.changed("position", 3 * frame.count);
  }

  valuesChanged(count: number): void {
    this.changed("value", count);
  }

  marksChanged(count: number): void {
    this.changed("mark", count);
  }

  setTable(table: Table, categorical: boolean, domain: [number, number]): void {
    (this.table.image.data as Uint8Array).set(table);
    this.table.needsUpdate = true;
    const { uniforms } = this.material;
    uniforms["categorical"]!.value = categorical ? 1 : 0;
    uniforms["low"]!.value = domain[0];
    uniforms["high"]!.value = domain[1];
  }

  /** @param pixels the height in device pixels of one metre at one metre from the eye. */
  setLook(size: number, pixels: number, ratio: number, fog: number, background: THREE.Color): void {
    const { uniforms } = this.material;
    uniforms["size"]!.value = POINT_M * size;
    uniforms["pixels"]!.value = pixels;
    uniforms["least"]!.value = Math.max(1, 1.4 * size * ratio);
    uniforms["most"]!.value = 7 * size * ratio;
    uniforms["fog"]!.value = fog;
    const { r, g, b } = background.clone().convertLinearToSRGB();
    (uniforms["background"]!.value as THREE.Vector3).set(r, g, b);
  }

  setSection(plane: THREE.Vector4, thick: number): void {
    (this.material.uniforms["plane"]!.value as THREE.Vector4).copy(plane);
    this.material.uniforms["thick"]!.value = thick;
  }

  private attribute(name: string, array: Float32Array | Int8Array, size: number): void {
    const attribute = new THREE.BufferAttribute(array, size);
    attribute.setUsage(THREE.DynamicDrawUsage);
    this.geometry.setAttribute(name, attribute);
  }

  private changed(name: string, length: number): void {
    const attribute = this.geometry.getAttribute(name) as THREE.BufferAttribute | undefined;
    if (attribute === undefined) return;
    attribute.clearUpdateRanges();
    attribute.addUpdateRange(0, length);
    attribute.needsUpdate = true;
  }
}
