// Detections judged at a threshold of their score: hits, misses and false alarms.

import type { Box } from "./frame_data";

export type Verdict = "hit" | "miss" | "false alarm";

const NEAR_M = 4; // how far a hit's label may be, where the packet does not name it

/** Returns every box's verdict when detections below the threshold do not count; null: not judged, or dropped. */
export function verdictsAt(boxes: Box[], threshold: number): (Verdict | null)[] {
  const verdicts = boxes.map((box): Verdict | null => {
    if (box.score !== null) return box.score >= threshold ? box.verdict : null;
    return box.verdict;
  });
  const found = new Set<number>();
  boxes.forEach((box, k) => {
    if (box.score === null || box.verdict !== "hit") return;
    const label = labelOf(boxes, k, found);
    if (label < 0) return;
    found.add(label);
    verdicts[label] = box.score >= threshold ? "hit" : "miss";
  });
  return verdicts;
}

function labelOf(boxes: Box[], k: number, taken: Set<number>): number {
  const hit = boxes[k]!;
  if (typeof hit.match === "number") return hit.match;
  let best = -1;
  let nearest = NEAR_M;
  boxes.forEach((box, j) => {
    if (box.score !== null || box.class !== hit.class || taken.has(j)) return;
    if (box.verdict === "miss") return;
    const distance = Math.hypot(box.box[0] - hit.box[0], box.box[1] - hit.box[1]);
    if (distance < nearest) [nearest, best] = [distance, j];
  });
  return best;
}

export interface Counts {
  hits: number;
  misses: number;
  falseAlarms: number;
}

/** Counts: hits and false alarms of detections, misses of labels. */
export function countVerdicts(boxes: Box[], verdicts: (Verdict | null)[]): Counts {
  const counts = { hits: 0, misses: 0, falseAlarms: 0 };
  boxes.forEach((box, k) => {
    if (box.score !== null && verdicts[k] === "hit") counts.hits++;
    if (box.score !== null && verdicts[k] === "false alarm") counts.falseAlarms++;
    if (box.score === null && verdicts[k] === "miss") counts.misses++;
  });
  return counts;
}
