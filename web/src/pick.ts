// What lies under the pointer.

import { contains, rayHits } from "./box_geometry";
import type { Point3 } from "./document";
import type { Box, PointFrame } from "./frame_data";

/** The matrix that takes the scene to clip space, column major, as three.js keeps it. */
export type Matrix = ArrayLike<number>;

/**
 * Returns the index of the point that is drawn under a place of the view, or -1.
 *
 * Among the points within the radius the one that is nearest to the eye is taken, with the
 * distance on the screen counted so that of two at one depth the nearer to the pointer wins.
 *
 * @param x, y the place in pixels from the view's upper left corner.
 * @param hidden whether a point is not drawn.
 */
export function pickPoint(
  frame: PointFrame,
  matrix: Matrix,
  width: number,
  height: number,
  x: number,
  y: number,
  radius: number,
  hidden: (k: number) => boolean,
): number {
  const { position, count } = frame;
  const m = matrix;
  let best = -1;
  let cost = Infinity;
  const reach = radius * radius;
  for (let k = 0; k < count; k++) {
    const px = position[3 * k]!;
    const py = position[3 * k + 1]!;
    const pz = position[3 * k + 2]!;
    const w = m[3]! * px + m[7]! * py + m[11]! * pz + m[15]!;
    if (w <= 0) continue;
    const sx = (((m[0]! * px + m[4]! * py + m[8]! * pz + m[12]!) / w + 1) * width) / 2 - x;
    const sy = ((1 - (m[1]! * px + m[5]! * py + m[9]! * pz + m[13]!) / w) * height) / 2 - y;
    const square = sx * sx + sy * sy;
    if (square > reach || hidden(k)) continue;
    const z = (m[2]! * px + m[6]! * py + m[10]! * pz + m[14]!) / w;
    if (z < -1 || z > 1) continue;
    const score = w * (1 + 0.5 * (square / reach));
    if (score < cost) [cost, best] = [score, k];
  }
  return best;
}

/** Returns the index of the box that a ray meets first, or -1. */
export function pickBox(
  boxes: Box[],
  origin: Point3,
  direction: Point3,
  hidden: (box: Box, k: number) => boolean,
): number {
  let best = -1;
  let nearest = Infinity;
  boxes.forEach((box, k) => {
    if (hidden(box, k)) return;
    const distance = rayHits(box.box, origin, direction);
    // From inside a box one looks past it: it would hide everything else.
    if (distance > 0 && distance < nearest) [nearest, best] = [distance, k];
  });
  return best;
}

/** Returns the index of the box that a point belongs to: by its instance, else by where it is. */
export function boxOfPoint(boxes: Box[], frame: PointFrame, k: number): number {
  const instance = frame.fields.get("instance")?.[k] ?? 0;
  const inside = (box: Box): boolean =>
    contains(
      box.box,
      frame.position[3 * k]!,
      frame.position[3 * k + 1]!,
      frame.position[3 * k + 2]!,
    );
  if (instance > 0) {
    const same = boxes.findIndex((box) => box.score === null && (box.track & 0xffff) === instance);
    if (same >= 0) return same;
  }
  const label = boxes.findIndex((box) => box.score === null && inside(box));
  return label >= 0 ? label : boxes.findIndex(inside);
}
