// Boxes as geometry: corners, what a ray hits, which points are inside.

import type { Point3 } from "./document";
import type { Box } from "./frame_data";

export type BoxNumbers = Box["box"];

/** Corners by the signs of (length, width, height): bit 0 back/front, bit 1 right/left, bit 2 bottom/top. */
export function cornersOf([x, y, z, l, w, h, yaw]: BoxNumbers): Point3[] {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return Array.from({ length: 8 }, (_, k): Point3 => {
    const along = (k & 1 ? 0.5 : -0.5) * l;
    const across = (k & 2 ? 0.5 : -0.5) * w;
    return [x + along * c - across * s, y + along * s + across * c, z + (k & 4 ? 0.5 : -0.5) * h];
  });
}

/** Pairs of corners that are edges. */
export const EDGES: readonly [number, number][] = [
  [0, 1],
  [1, 3],
  [3, 2],
  [2, 0],
  [4, 5],
  [5, 7],
  [7, 6],
  [6, 4],
  [0, 4],
  [1, 5],
  [2, 6],
  [3, 7],
];

/** Distance along a ray to a box, Infinity where it misses (the slab method, in the box's frame). */
export function rayHits(box: BoxNumbers, origin: Point3, direction: Point3): number {
  const [x, y, z, l, w, h, yaw] = box;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const [dx, dy] = [origin[0] - x, origin[1] - y];
  const from = [dx * c + dy * s, -dx * s + dy * c, origin[2] - z];
  const along = [
    direction[0] * c + direction[1] * s,
    -direction[0] * s + direction[1] * c,
    direction[2],
  ];
  const half = [l / 2, w / 2, h / 2];
  let near = 0;
  let far = Infinity;
  for (let k = 0; k < 3; k++) {
    if (Math.abs(along[k]!) < 1e-12) {
      if (Math.abs(from[k]!) > half[k]!) return Infinity;
      continue;
    }
    const a = (-half[k]! - from[k]!) / along[k]!;
    const b = (half[k]! - from[k]!) / along[k]!;
    near = Math.max(near, Math.min(a, b));
    far = Math.min(far, Math.max(a, b));
  }
  return near <= far ? near : Infinity;
}

/** Whether a point lies in a box that is larger by a margin on every side. */
export function contains(
  box: BoxNumbers,
  px: number,
  py: number,
  pz: number,
  margin = 0.1,
): boolean {
  const [x, y, z, l, w, h, yaw] = box;
  if (Math.abs(pz - z) > h / 2 + margin) return false;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const [dx, dy] = [px - x, py - y];
  return (
    Math.abs(dx * c + dy * s) <= l / 2 + margin && Math.abs(-dx * s + dy * c) <= w / 2 + margin
  );
}

/** Distance from the nearest sensor (the scene's origin where there is none) to a box's centre. */
export function rangeOf(box: BoxNumbers, origins: Point3[]): number {
  if (origins.length === 0) return Math.hypot(box[0], box[1]);
  return Math.min(...origins.map(([x, y, z]) => Math.hypot(box[0] - x, box[1] - y, box[2] - z)));
}
