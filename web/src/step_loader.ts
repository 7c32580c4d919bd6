// What each step of the time line needs: fetched ahead, bounded, and what failed remembered.

import type { Step } from "./document";
import type { Packet } from "./packet";
import type { PacketCache } from "./packet_cache";
import type { SideView } from "./side_view";
import { stepsAhead } from "./timeline";

const AHEAD = 12;
const AHEAD_STILL = 4;
const AT_ONCE = 4;

/** How many steps may be loaded ahead, so that they do not push each other out of the memory. */
export function stepsThatFit(bytes: number, limit: number): number {
  return bytes > 0 ? Math.max(1, Math.floor((0.6 * limit) / bytes)) : AHEAD;
}

export class StepLoader {
  constructor(
    readonly steps: Step[],
    private readonly sides: SideView[],
    private readonly cache: PacketCache,
    private readonly arrived: () => void,
  ) {}

  namesOf(step: number): string[] {
    const frames = this.steps[step]?.frames ?? [];
    return frames.flatMap((frame, side) => this.sides[side]?.packets(frame) ?? []);
  }

  /** Whether a step can be shown now: all of it is here, or it is known to be damaged. */
  ready(step: number): boolean {
    return this.namesOf(step).every(
      (name) => this.cache.has(name) || this.cache.failure(name) !== undefined,
    );
  }

  /** What is wrong with a step, as far as is known. */
  error(step: number): string | null {
    const told = this.steps[step]?.error;
    if (told) return told;
    const failures = this.namesOf(step).map((name) => this.cache.failure(name)?.message);
    const said = [...new Set(failures.filter((message) => message !== undefined))];
    return said.length > 0 ? said.join(" ") : null;
  }

  /** Fetches a step, then what comes next. */
  want(step: number, loop: boolean, playing: boolean): void {
    for (const name of this.namesOf(step)) this.fetch(name);
    const room = stepsThatFit(this.bytesOf(step), this.cache.limit);
    const count = Math.min(playing ? AHEAD : AHEAD_STILL, room);
    const ahead = stepsAhead(step, this.steps.length, count, loop);
    for (const next of ahead) {
      for (const name of this.namesOf(next)) {
        if (this.cache.pending >= AT_ONCE) return;
        this.fetch(name);
      }
    }
  }

  packet(name: string): Packet | undefined {
    return this.cache.peek(name);
  }

  private bytesOf(step: number): number {
    return this.namesOf(step).reduce((sum, name) => sum + (this.cache.bytesOf(name) ?? 0), 0);
  }

  private fetch(name: string): void {
    if (this.cache.has(name) || this.cache.failure(name) !== undefined) return;
    void this.cache.get(name).then(this.arrived, this.arrived);
  }
}
