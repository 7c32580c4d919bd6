// Which points lie on the ground: by semantic class where there is one, else by height over the lowest nearby.

import { GROUND_CLASSES } from "./colour";
import type { Scene } from "./document";
import type { PointFrame } from "./frame_data";

const CELL_M = 2;
const ABOVE_M = 0.3;
const REACH_CELLS = 160; // half the width of the grid: points beyond it use its border

/** A table of 256: 1 at the numbers of classes that are ground. */
function groundClasses(scene: Scene): Uint8Array {
  const table = new Uint8Array(256);
  for (const one of scene.classes) if (GROUND_CLASSES.test(one.name)) table[one.id & 255] = 1;
  return table;
}

export class GroundFinder {
  private readonly classes: Uint8Array;
  private readonly known: boolean;
  private lowest: Float32Array | null = null;

  constructor(scene: Scene) {
    this.classes = groundClasses(scene);
    this.known = this.classes.includes(1);
  }

  /** Writes 1 where a point is ground, else 0. */
  mark(to: Uint8Array, frame: PointFrame): void {
    const semantic = frame.fields.get("semantic");
    if (semantic !== undefined && this.known && hasLabels(semantic, frame.count)) {
      for (let k = 0; k < frame.count; k++) to[k] = this.classes[semantic[k]! & 255]!;
      return;
    }
    this.byHeight(to, frame);
  }

  private byHeight(to: Uint8Array, { count, position }: PointFrame): void {
    const width = 2 * REACH_CELLS;
    const lowest = (this.lowest ??= new Float32Array(width * width));
    lowest.fill(Infinity);
    const cell = (v: number): number =>
      Math.min(width - 1, Math.max(0, Math.floor(v / CELL_M) + REACH_CELLS));
    for (let k = 0; k < count; k++) {
      const at = cell(position[3 * k + 1]!) * width + cell(position[3 * k]!);
      const z = position[3 * k + 2]!;
      if (z < lowest[at]!) lowest[at] = z;
    }
    for (let k = 0; k < count; k++) {
      const at = cell(position[3 * k + 1]!) * width + cell(position[3 * k]!);
      to[k] = position[3 * k + 2]! < lowest[at]! + ABOVE_M ? 1 : 0;
    }
  }
}

function hasLabels(semantic: ArrayLike<number>, count: number): boolean {
  const stride = Math.max(1, Math.floor(count / 500));
  for (let k = 0; k < count; k += stride) if (semantic[k] !== 0) return true;
  return false;
}
