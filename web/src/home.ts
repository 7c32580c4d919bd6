// Where the eye stands when the page opens.

import * as THREE from "three";

import type { Scene } from "./document";
import type { SideView } from "./side_view";

export interface Home {
  position: [number, number, number];
  target: [number, number, number];
}

/** Behind and above the first sensor, looking where it looks; without one, over what there is. */
export function homeOf(scene: Scene, sides: SideView[], bounds?: THREE.Box3): Home {
  const sensor = scene.sensors[0];
  const around = middleOf(sides, bounds);
  const ground = scene.ground_z;
  if (sensor === undefined) {
    const { x, y, reach } = around ?? { x: 0, y: 0, reach: 60 };
    return {
      position: [x - 0.7 * reach, y - 0.7 * reach, ground + 0.65 * reach],
      target: [x, y, ground],
    };
  }
  const p = sensor.pose;
  const at = [p[3]!, p[7]!, p[11]!] as const;
  let [dx, dy] = [p[0]!, p[4]!];
  const length = Math.hypot(dx, dy);
  [dx, dy] = length > 0.1 ? [dx / length, dy / length] : [1, 0];
  return {
    position: [
      at[0] - 26 * dx + 8 * dy,
      at[1] - 26 * dy - 8 * dx,
      Math.max(at[2] + 8, ground + 20),
    ],
    target: [at[0] + 14 * dx, at[1] + 14 * dy, ground],
  };
}

function middleOf(
  sides: SideView[],
  bounds?: THREE.Box3,
): { x: number; y: number; reach: number } | null {
  const [xs, ys]: [number[], number[]] = [[], []];
  for (const { frame, boxes } of sides) {
    const stride = Math.max(1, Math.floor(frame.count / 2000));
    for (let k = 0; k < frame.count; k += stride) {
      xs.push(frame.position[3 * k]!);
      ys.push(frame.position[3 * k + 1]!);
    }
    if (frame.count === 0) for (const box of boxes) (xs.push(box.box[0]), ys.push(box.box[1]));
  }
  if (xs.length < 3) {
    if (bounds === undefined) return null;
    const size = bounds.getSize(new THREE.Vector3());
    const middle = bounds.getCenter(new THREE.Vector3());
    return { x: middle.x, y: middle.y, reach: 0.4 * Math.max(size.x, size.y) };
  }
  xs.sort((a, b) => a - b);
  ys.sort((a, b) => a - b);
  const at = (sorted: number[], share: number): number =>
    sorted[Math.floor(share * (sorted.length - 1))]!;
  const reach = Math.max(at(xs, 0.85) - at(xs, 0.15), at(ys, 0.85) - at(ys, 0.15), 15);
  return { x: at(xs, 0.5), y: at(ys, 0.5), reach };
}
