// The clock of the time line: which step is due, when it plays at the sensor's rate.

import type { Step } from "./document";

export class PlayClock {
  playing = false;
  private time_s = 0;

  constructor(
    private readonly steps: Step[],
    private readonly rate_hz: number,
  ) {}

  /** When a step is due, in seconds: by the frames' own times where they rise, else by the rate. */
  timeOf(step: number): number {
    return this.steps[step]?.time_s ?? 0;
  }

  /** How long a step is shown. */
  lengthOf(step: number): number {
    const gap = this.timeOf(step + 1) - this.timeOf(step);
    const usual = 1 / this.rate_hz;
    // A hole in the recording is not waited for; times that fall or stand still say nothing.
    return step + 1 < this.steps.length && gap > 0 && gap < 3 * usual ? gap : usual;
  }

  start(): void {
    this.playing = true;
    this.time_s = 0;
  }

  stop(): void {
    this.playing = false;
  }

  /**
   * Returns the step that is due after some seconds went by, from the one that is shown.
   *
   * @param ready whether a step can be shown: the clock waits before one that cannot.
   */
  advance(
    step: number,
    elapsed_s: number,
    speed: number,
    loop: boolean,
    ready: (step: number) => boolean,
  ): number {
    if (!this.playing || this.steps.length === 0) return step;
    // A tab that slept does not race through what it missed.
    this.time_s += Math.min(elapsed_s, 0.5) * speed;
    let at = step;
    for (let passed = 0; passed < this.steps.length && this.time_s >= this.lengthOf(at); passed++) {
      let next = at + 1;
      if (next >= this.steps.length) {
        if (!loop) {
          this.stop();
          break;
        }
        next = 0;
      }
      if (!ready(next)) {
        this.time_s = this.lengthOf(at);
        break;
      }
      this.time_s -= this.lengthOf(at);
      at = next;
    }
    return at;
  }
}

/** The steps to load ahead of one, nearest first: forward with the loop, and one back. */
export function stepsAhead(step: number, count: number, ahead: number, loop: boolean): number[] {
  const found: number[] = [];
  for (let k = 1; k <= Math.min(ahead, count - 1); k++) {
    const next = step + k;
    if (next < count) found.push(next);
    else if (loop) found.push(next - count);
  }
  if (step > 0 && !found.includes(step - 1)) found.push(step - 1);
  return found;
}
