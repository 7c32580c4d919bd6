// The distance between two places that were clicked.

import type { Point3 } from "./document";

export class Measure {
  on = false;
  from: Point3 | null = null;
  to: Point3 | null = null;

  /** Takes a place: the first, the second, or the first of a new measurement. */
  take(place: Point3): void {
    if (this.from === null || this.to !== null) {
      this.from = place;
      this.to = null;
    } else this.to = place;
  }

  clear(): void {
    this.from = this.to = null;
  }

  get text(): string {
    return this.from !== null && this.to !== null ? sayDistance(this.from, this.to) : "";
  }
}

/** Says how far two places are from each other: along the line, on the level, in height. */
export function sayDistance(from: Point3, to: Point3): string {
  const [dx, dy, dz] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
  const level = Math.hypot(dx, dy);
  const sign = dz < 0 ? "−" : "+";
  return `${Math.hypot(level, dz).toFixed(2)} m  (level ${level.toFixed(2)}, height ${sign}${Math.abs(dz).toFixed(2)})`;
}
