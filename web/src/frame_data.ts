// One frame of one side, as its packets give it.

import type { Packet, PacketArray } from "./packet";
import type { Point3 } from "./document";

export interface Box {
  track: number;
  class: string;
  box: [number, number, number, number, number, number, number]; // centre, length, width, height, yaw
  velocity: Point3 | null;
  points: number | null;
  occlusion: number | null;
  truncation: number | null;
  difficulty: string | null;
  ignored: string | null;
  hidden_by: number[] | null;
  why: string | null;
  score: number | null;
  verdict: "hit" | "miss" | "false alarm" | null;
  match?: number | null; // of a hit: the label that it hits, an index in the same list
}

/** Points of a frame: positions decoded into an array that is used again, the rest as it came. */
export class PointFrame {
  count = 0;
  position = new Float32Array(0);
  fields = new Map<string, PacketArray>();

  clear(): void {
    this.count = 0;
    this.fields.clear();
  }

  /** Takes a packet; grows the positions' array only when the frame is larger than all before. */
  load(packet: Packet): void {
    const position = packet.arrays.get("position");
    if (position === undefined) throw new Error("A frame has no positions.");
    const count = position.shape[0] ?? 0;
    if (this.position.length < count * 3) {
      this.position = new Float32Array(Math.ceil((count * 1.25) / 1024) * 3072);
    }
    const to = this.position;
    const from = position.data;
    const [x0, y0, z0] = (packet.header["origin"] as number[] | undefined) ?? [0, 0, 0];
    const step = (packet.header["step"] as number | number[] | undefined) ?? 1;
    const [sx, sy, sz] = Array.isArray(step) ? step : [step, step, step];
    for (let k = 0, end = count * 3; k < end; k += 3) {
      to[k] = x0 + sx * from[k];
      to[k + 1] = y0 + sy * from[k + 1];
      to[k + 2] = z0 + sz * from[k + 2];
    }
    this.count = count;
    this.fields.clear();
    for (const [name, array] of packet.arrays) {
      if (name !== "position" && array.data.length >= count) this.fields.set(name, array.data);
    }
  }
}
