// Which objects are listed and drawn, and in what order.

import { rangeOf } from "./box_geometry";
import type { Point3 } from "./document";
import type { Box } from "./frame_data";

export const SORTS = ["range", "points", "class", "track", "speed", "occlusion", "score"] as const;
export type Sort = (typeof SORTS)[number];

export interface Filters {
  classes: string[]; // hidden ones
  range_m: [number, number]; // from, to
  points: number; // at least
  occlusion: number; // at most, 0..1
  ignored: boolean; // whether ignored ones are listed
  text: string;
  sort: Sort;
  descending: boolean;
}

export const NO_FILTERS: Filters = {
  classes: [],
  range_m: [0, 1000],
  points: 0,
  occlusion: 1,
  ignored: true,
  text: "",
  sort: "range",
  descending: false,
};

export const speedOf = (box: Box): number | null =>
  box.velocity ? Math.hypot(box.velocity[0], box.velocity[1], box.velocity[2]) : null;

/** Whether a box passes the filters. What a box does not say never keeps it out. */
export function passes(box: Box, filters: Filters, origins: Point3[]): boolean {
  if (filters.classes.includes(box.class)) return false;
  if (!filters.ignored && box.ignored) return false;
  if (box.points !== null && box.points < filters.points) return false;
  if (box.occlusion !== null && box.occlusion > filters.occlusion + 1e-9) return false;
  const range = rangeOf(box.box, origins);
  if (range < filters.range_m[0] || range > filters.range_m[1]) return false;
  const words = filters.text.trim().toLowerCase();
  if (words) {
    const said = `${box.class} ${box.track >= 0 ? box.track : ""} ${box.verdict ?? ""} ${box.difficulty ?? ""} ${box.ignored ?? ""}`;
    if (!words.split(/\s+/).every((word) => said.toLowerCase().includes(word))) return false;
  }
  return true;
}

/** The indices of the boxes that pass, in order. Boxes that do not say what is sorted by come last. */
export function listed(boxes: Box[], filters: Filters, origins: Point3[]): number[] {
  const keys = boxes.map((box): number | string | null => {
    switch (filters.sort) {
      case "range":
        return rangeOf(box.box, origins);
      case "points":
        return box.points;
      case "class":
        return box.class;
      case "track":
        return box.track;
      case "speed":
        return speedOf(box);
      case "occlusion":
        return box.occlusion;
      case "score":
        return box.score;
    }
  });
  const sign = filters.descending ? -1 : 1;
  return boxes
    .map((_, k) => k)
    .filter((k) => passes(boxes[k]!, filters, origins))
    .sort((a, b) => {
      const [x, y] = [keys[a] ?? null, keys[b] ?? null];
      if (x === null || y === null) return Number(x === null) - Number(y === null) || a - b;
      return (x < y ? -sign : x > y ? sign : 0) || a - b;
    });
}
