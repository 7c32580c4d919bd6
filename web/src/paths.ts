// The path of a track: where it was, solid, and where it will be, dashed.

import * as THREE from "three";

import type { Point3, Rgb } from "./document";
import { FatLines } from "./fat_lines";
import type { Packet } from "./packet";

export interface Track {
  track: number;
  class: string;
  time_s: number[];
  at: [number, number, number, number][];
  size: [number, number, number];
}

export function tracksOf(packet: Packet): Map<number, Track> {
  const tracks = (packet.header["tracks"] ?? []) as Track[];
  return new Map(tracks.map((track) => [track.track, track]));
}

/** The index of the last moment of a track that is not after a time, -1 before the first. */
export function momentOf(track: Track, time_s: number): number {
  let low = 0;
  let high = track.time_s.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (track.time_s[middle]! <= time_s + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

export class PathDrawing {
  readonly object = new THREE.Group();
  private readonly before = new FatLines(3, 512);
  private readonly after = new FatLines(2, 512);

  constructor() {
    this.object.add(this.before.object, this.after.object);
  }

  draw(track: Track | undefined, time_s: number, before: Rgb, after: Rgb): void {
    this.before.begin();
    this.after.begin();
    if (track !== undefined) {
      const now = momentOf(track, time_s);
      const floor = (k: number): Point3 => {
        const [x, y, z] = track.at[k]!;
        return [x, y, z - track.size[2] / 2 + 0.05];
      };
      for (let k = 1; k < track.at.length; k++) {
        if (k <= now) this.before.add(floor(k - 1), floor(k), before);
        else if (k % 2 === 0) this.after.add(floor(k - 1), floor(k), after);
      }
    }
    this.before.end();
    this.after.end();
  }
}
