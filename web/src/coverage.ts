// Coverage: a value for each cell of the ground, drawn as a layer on it.

import * as THREE from "three";

import { entry, gradientTable, type Table, type Theme } from "./colour";
import type { Packet } from "./packet";

export class CoverageDrawing {
  readonly object: THREE.Mesh;
  readonly unit: string;
  readonly domain: [number, number];
  table: Table = new Uint8Array(1024);
  private readonly texture: THREE.DataTexture;
  private readonly values: ArrayLike<number>;

  constructor(packet: Packet) {
    const value = packet.arrays.get("value");
    if (value === undefined) throw new Error("The coverage has no values.");
    const [rows = 0, columns = 0] = value.shape;
    const header = packet.header as Record<string, number | string | undefined>;
    const [x0, y0] = [Number(header["x0"] ?? 0), Number(header["y0"] ?? 0)];
    const cell = Number(header["cell_m"] ?? 1);
    const heights = packet.arrays.get("z")?.data;
    const level = Number(header["z"] ?? 0) || 0;
    this.unit = String(header["unit"] ?? "");
    this.values = value.data;
    const found = Array.from(value.data).filter((v) => Number.isFinite(v) && v > 0);
    found.sort((a, b) => a - b);
    this.domain = [0, found[Math.floor(0.98 * (found.length - 1))] ?? 1];

    const geometry = new THREE.PlaneGeometry(1, 1, columns, rows);
    const position = geometry.getAttribute("position") as THREE.BufferAttribute;
    const uv = geometry.getAttribute("uv") as THREE.BufferAttribute;
    for (let r = 0; r <= rows; r++) {
      for (let c = 0; c <= columns; c++) {
        const k = r * (columns + 1) + c;
        const z = heights?.[k] ?? level;
        position.setXYZ(k, x0 + c * cell, y0 + r * cell, (Number.isFinite(z) ? z : level) + 0.06);
        uv.setXY(k, c / columns, r / rows);
      }
    }
    this.texture = new THREE.DataTexture(new Uint8Array(4 * rows * columns), columns, rows);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.texture.minFilter = this.texture.magFilter = THREE.NearestFilter;
    this.object = new THREE.Mesh(
      geometry,
      new THREE.MeshBasicMaterial({
        map: this.texture,
        transparent: true,
        depthWrite: false,
        side: THREE.DoubleSide,
        polygonOffset: true,
        polygonOffsetFactor: -2,
        polygonOffsetUnits: -8,
      }),
    );
    this.object.frustumCulled = false;
  }

  setTheme(theme: Theme): void {
    this.table = gradientTable("viridis", theme);
    const { table } = this;
    const pixels = this.texture.image.data as Uint8Array;
    for (let k = 0; k < this.values.length; k++) {
      const value = this.values[k]!;
      const seen = Number.isFinite(value) && value > 0;
      const share = (value - this.domain[0]) / (this.domain[1] - this.domain[0] || 1);
      const [r, g, b] = seen ? entry(table, Math.round(255 * Math.min(1, share))) : [0, 0, 0];
      pixels.set([r, g, b, seen ? 165 : 0], 4 * k);
    }
    this.texture.needsUpdate = true;
  }
}
