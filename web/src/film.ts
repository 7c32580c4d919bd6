// Pictures and films of what is seen: the scene with what is written over it.

export function saveBlob(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** A canvas that holds several others, one over the other. */
class Composite {
  readonly canvas = document.createElement("canvas");
  private readonly brush = this.canvas.getContext("2d")!;

  constructor(private readonly parts: HTMLCanvasElement[]) {}

  draw(): void {
    const [first] = this.parts;
    // A film's size must not change while it is recorded, and codecs want even numbers.
    const [width, height] = [first!.width & ~1, first!.height & ~1];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    for (const part of this.parts) this.brush.drawImage(part, 0, 0, width, height);
  }
}

export async function savePicture(parts: HTMLCanvasElement[], name: string): Promise<void> {
  const composite = new Composite(parts);
  composite.draw();
  const blob = await new Promise<Blob | null>((done) => composite.canvas.toBlob(done, "image/png"));
  if (blob === null) throw new Error("This browser could not make a picture of the view.");
  saveBlob(blob, name);
}

const CODECS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];

export class FilmRecorder {
  private recorder: MediaRecorder | null = null;
  private composite: Composite | null = null;
  private startedAt = 0;

  get recording(): boolean {
    return this.recorder !== null;
  }

  get seconds(): number {
    return this.recording ? (performance.now() - this.startedAt) / 1000 : 0;
  }

  /** Starts; `done` is called with the film's bytes and its file's ending when it was stopped. */
  start(parts: HTMLCanvasElement[], done: (film: Blob, ending: string) => void): void {
    const type =
      typeof MediaRecorder === "undefined"
        ? undefined
        : CODECS.find((codec) => MediaRecorder.isTypeSupported(codec));
    if (type === undefined) throw new Error("This browser cannot record films.");
    this.composite = new Composite(parts);
    this.composite.draw();
    const stream = this.composite.canvas.captureStream(30);
    const recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 12_000_000 });
    const pieces: Blob[] = [];
    recorder.ondataavailable = (event) => pieces.push(event.data);
    recorder.onstop = () => {
      for (const track of stream.getTracks()) track.stop();
      done(new Blob(pieces, { type }), type.startsWith("video/mp4") ? "mp4" : "webm");
    };
    recorder.start(1000);
    this.recorder = recorder;
    this.startedAt = performance.now();
  }

  /** Called after every picture that was drawn. */
  frame(): void {
    if (this.recording) this.composite?.draw();
  }

  stop(): void {
    this.recorder?.stop();
    this.recorder = null;
    this.composite = null;
  }
}
