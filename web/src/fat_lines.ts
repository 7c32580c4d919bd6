// Lines of a width in pixels with room for many segments, filled again and again without new buffers.

import * as THREE from "three";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

import type { Point3, Rgb } from "./document";

const srgb = new THREE.Color();

export class FatLines {
  readonly object: LineSegments2;
  readonly material: LineMaterial;
  private geometry!: LineSegmentsGeometry;
  private positions = new Float32Array(0);
  private colours = new Float32Array(0);
  private used = 0;

  constructor(width_px: number, segments = 256, dashed = false) {
    this.material = new LineMaterial({
      vertexColors: true,
      linewidth: width_px,
      worldUnits: false,
      dashed,
      fog: true,
    });
    this.object = new LineSegments2(new LineSegmentsGeometry(), this.material);
    this.object.frustumCulled = false;
    this.reserve(segments);
    this.end();
  }

  begin(): void {
    this.used = 0;
  }

  add(from: Point3, to: Point3, colour: Rgb): void {
    if ((this.used + 1) * 6 > this.positions.length) this.reserve(this.used * 2);
    const at = this.used * 6;
    this.positions.set(from, at);
    this.positions.set(to, at + 3);
    srgb.setRGB(colour[0] / 255, colour[1] / 255, colour[2] / 255, THREE.SRGBColorSpace);
    for (const k of [at, at + 3]) {
      this.colours[k] = srgb.r;
      this.colours[k + 1] = srgb.g;
      this.colours[k + 2] = srgb.b;
    }
    this.used++;
  }

  end(): void {
    this.geometry.instanceCount = this.used;
    for (const name of ["instanceStart", "instanceColorStart"]) {
      const attribute = this.geometry.getAttribute(name) as THREE.InterleavedBufferAttribute;
      attribute.data.clearUpdateRanges();
      attribute.data.addUpdateRange(0, this.used * 6);
      attribute.data.needsUpdate = true;
    }
    this.object.visible = this.used > 0;
  }

  private reserve(segments: number): void {
    const grown = (old: Float32Array): Float32Array<ArrayBuffer> => {
      const larger = new Float32Array(segments * 6);
      larger.set(old);
      return larger;
    };
    this.positions = grown(this.positions);
    this.colours = grown(this.colours);
    this.geometry?.dispose();
    this.geometry = new LineSegmentsGeometry();
    const pairs = (array: Float32Array, first: string, second: string): void => {
      const buffer = new THREE.InstancedInterleavedBuffer(array, 6, 1);
      buffer.setUsage(THREE.DynamicDrawUsage);
      this.geometry.setAttribute(first, new THREE.InterleavedBufferAttribute(buffer, 3, 0));
      this.geometry.setAttribute(second, new THREE.InterleavedBufferAttribute(buffer, 3, 3));
    };
    pairs(this.positions, "instanceStart", "instanceEnd");
    pairs(this.colours, "instanceColorStart", "instanceColorEnd");
    this.object.geometry = this.geometry;
  }
}
