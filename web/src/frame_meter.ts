// How fast the page draws: pictures and data frames of the last seconds.

export class FrameMeter {
  frames = 0; // data frames shown since the start
  private readonly pictures: number[] = [];
  private readonly data: number[] = [];
  private readonly work_ms: number[] = [];

  rendered(): void {
    keep(this.pictures);
  }

  shown(): void {
    this.frames++;
    keep(this.data);
  }

  /** Takes how long the page's own script worked for a new frame: decoding, colours, panels, drawing calls. */
  worked(ms: number): void {
    this.work_ms.push(ms);
    if (this.work_ms.length > 100) this.work_ms.shift();
  }

  /** The median of that work. */
  get script_ms(): number {
    const sorted = [...this.work_ms].sort((a, b) => a - b);
    return sorted[sorted.length >> 1] ?? 0;
  }

  /** Pictures and data frames a second over the last two seconds. */
  rates(): { pictures_per_s: number; frames_per_s: number } {
    return { pictures_per_s: rate(this.pictures), frames_per_s: rate(this.data) };
  }
}

function keep(times: number[]): void {
  times.push(performance.now());
  if (times.length > 240) times.shift();
}

function rate(times: number[]): number {
  const since = performance.now() - 2000;
  const recent = times.filter((time) => time >= since);
  if (recent.length < 2) return 0;
  return ((recent.length - 1) * 1000) / (recent[recent.length - 1]! - recent[0]!);
}
