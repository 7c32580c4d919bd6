// Lanes on the ground: their surface by kind, and arrows that point the way of traffic.

import * as THREE from "three";

import type { Point3, Rgb } from "./document";
import type { Packet } from "./packet";

interface Lane {
  kind: string;
  line: Point3[];
  left?: Point3[] | null;
  right?: Point3[] | null;
  name?: string;
}

const LANE_COLOURS: Record<string, Rgb> = {
  driving: [76, 150, 230],
  bus: [224, 142, 40],
  tram: [180, 90, 200],
  bicycle: [70, 180, 120],
  crossing: [232, 196, 72],
  sidewalk: [150, 150, 160],
  walkingarea: [150, 150, 160],
  parking: [160, 130, 200],
  connection: [112, 150, 190],
};
const DIRECTED = new Set(["driving", "bus", "bicycle", "connection", "tram", "rail"]);
const ARROW_EVERY_M = 12;
const ABOVE_M = 0.04; // over the surface, so that both are not one depth

export class LaneDrawing {
  readonly object = new THREE.Group();

  constructor(packet: Packet) {
    const byKind = new Map<string, Lane[]>();
    for (const lane of (packet.header["lanes"] ?? []) as Lane[]) {
      if (lane.line.length < 2) continue;
      byKind.set(lane.kind, [...(byKind.get(lane.kind) ?? []), lane]);
    }
    for (const [kind, lanes] of byKind) {
      const [r, g, b] = LANE_COLOURS[kind] ?? [140, 150, 160];
      const colour = new THREE.Color().setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
      const surface: number[] = [];
      const arrows: number[] = [];
      const lines: number[] = [];
      for (const lane of lanes) {
        if (lane.left && lane.right) strip(surface, lane.left, lane.right);
        for (let k = 1; k < lane.line.length; k++) {
          lines.push(...raised(lane.line[k - 1]!), ...raised(lane.line[k]!));
        }
        if (DIRECTED.has(kind)) arrowsAlong(arrows, lane.line);
      }
      this.mesh(surface, colour, kind === "connection" ? 0.08 : 0.22);
      this.mesh(arrows, colour, 0.95);
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(lines, 3));
      this.object.add(
        new THREE.LineSegments(
          geometry,
          new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity: 0.55 }),
        ),
      );
    }
  }

  private mesh(corners: number[], color: THREE.Color, opacity: number): void {
    if (corners.length === 0) return;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    const material = new THREE.MeshBasicMaterial({
      color,
      opacity,
      transparent: true,
      side: THREE.DoubleSide,
      depthWrite: false,
      polygonOffset: true,
      polygonOffsetFactor: -1,
      polygonOffsetUnits: -4,
    });
    this.object.add(new THREE.Mesh(geometry, material));
  }
}

const raised = ([x, y, z]: Point3): Point3 => [x, y, z + ABOVE_M];

/** Triangles between two borders, which may have different numbers of places. */
export function strip(to: number[], left: Point3[], right: Point3[]): void {
  let [i, j] = [0, 0];
  while (i + 1 < left.length || j + 1 < right.length) {
    const stepLeft =
      j + 1 >= right.length ||
      (i + 1 < left.length && (i + 1) / (left.length - 1) <= (j + 1) / (right.length - 1));
    const a = left[i];
    const b = right[j];
    const c = stepLeft ? left[++i] : right[++j];
    if (a && b && c) to.push(...raised(a), ...raised(b), ...raised(c));
  }
}

/** Arrows along a line, every few metres, at least one. */
export function arrowsAlong(to: number[], line: Point3[]): void {
  const lengths = line.slice(1).map((p, k) => Math.hypot(p[0] - line[k]![0], p[1] - line[k]![1]));
  const total = lengths.reduce((sum, length) => sum + length, 0);
  if (total < 2) return;
  const count = Math.max(1, Math.round(total / ARROW_EVERY_M));
  for (let n = 0; n < count; n++) {
    let rest = ((n + 0.5) / count) * total;
    let k = 0;
    while (k < lengths.length - 1 && rest > lengths[k]!) rest -= lengths[k++]!;
    const [a, b] = [line[k]!, line[k + 1]!];
    const length = lengths[k]! || 1;
    const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    const z = a[2] + ((b[2] - a[2]) * rest) / length + 2 * ABOVE_M;
    const at = (along: number, across: number): number[] => [
      a[0] + ux * (rest + along) - uy * across,
      a[1] + uy * (rest + along) + ux * across,
      z,
    ];
    to.push(...at(0.9, 0), ...at(-0.7, 0.55), ...at(-0.35, 0));
    to.push(...at(0.9, 0), ...at(-0.35, 0), ...at(-0.7, -0.55));
  }
}
