// What there is to look at: the document that comes with the page.

export type Rgb = [number, number, number];
export type Point3 = [number, number, number];

export interface NamedColour {
  name: string;
  colour: Rgb;
}

export interface SemanticClass extends NamedColour {
  id: number;
}

export interface FrameEntry {
  name: string;
  time_s: number;
  points: number;
  error: string | null;
}

export interface Side {
  name: string;
  role: "real" | "synthetic" | "only";
  fields: string[];
  frames: FrameEntry[];
  rate_hz: number;
  box_packet: boolean;
  point_packet: boolean;
}

export interface SceneEvent {
  time_s: number;
  frame: number;
  kind: string;
  text: string;
  track: number | null;
}

export interface WorstPlace {
  frame: number;
  text: string;
  at: Point3;
}

export interface Sensor {
  name: string;
  model: string;
  pose: number[]; // scene_SE3_sensor, row major
  elevation_deg: [number, number];
  azimuth_deg: [number, number] | null;
  range_m: number;
  channels: number;
  columns: number;
}

export interface TwinEntry {
  packet: string;
  lanes: string | null;
  signals: boolean;
  coverage: { packet: string } | null;
}

export interface Scene {
  title: string;
  kind: "dataset" | "motion" | "twin" | "frames" | "pair";
  classes: SemanticClass[];
  box_classes: NamedColour[];
  sides: Side[];
  pairs: [number, number][] | null;
  events: SceneEvent[];
  worst: WorstPlace[] | null;
  sensors: Sensor[];
  twin: TwinEntry | null;
  tracks: string | null;
  detections: boolean;
  ground_z: number;
  attribution: string[];
}

const KINDS = ["dataset", "motion", "twin", "frames", "pair"];

/** Returns the document, or throws an Error whose message is a sentence for people. */
export function readDocument(value: unknown): Scene {
  if (typeof value !== "object" || value === null || Array.isArray(value)) {
    throw new Error("The document of this page is not an object.");
  }
  const raw = value as Partial<Scene> & { format?: unknown };
  if (raw.format !== 1) {
    throw new Error(`The document has format ${String(raw.format)}; this page reads format 1.`);
  }
  const kind = raw.kind ?? "dataset";
  if (!KINDS.includes(kind)) {
    throw new Error(`The document is of kind “${kind}”; this page knows ${KINDS.join(", ")}.`);
  }
  return {
    title: raw.title ?? "UrbanTwin",
    kind,
    classes: raw.classes ?? [],
    box_classes: raw.box_classes ?? [],
    sides: (raw.sides ?? []).map((side) => ({
      ...side,
      fields: side.fields ?? [],
      frames: side.frames ?? [],
      rate_hz: side.rate_hz > 0 ? side.rate_hz : 10,
    })),
    pairs: raw.pairs ?? null,
    events: (raw.events ?? []).map((event) => ({ ...event, track: event.track ?? null })),
    worst: raw.worst ?? null,
    sensors: raw.sensors ?? [],
    twin: raw.twin ?? null,
    tracks: raw.tracks ?? null,
    detections: raw.detections ?? false,
    ground_z: raw.ground_z ?? 0,
    attribution: raw.attribution ?? [],
  };
}

/** One step of the time line: which frame of each side is shown, and when. */
export interface Step {
  time_s: number;
  frames: number[]; // the index in each side's frames, -1 where there is none
  error: string | null;
}

/** Returns the steps of the time line: pairs of frames, or the frames of the only side. */
export function stepsOf(scene: Scene): Step[] {
  const [first, second] = scene.sides;
  if (first === undefined) return [];
  if (second !== undefined) {
    const pairs =
      scene.pairs ??
      Array.from(
        { length: Math.min(first.frames.length, second.frames.length) },
        (_, k): [number, number] => [k, k],
      );
    return pairs.map(([a, b]) => {
      const frames = [first.frames[a], second.frames[b]];
      const errors = frames.map((frame) => frame?.error).filter((error) => error);
      return {
        time_s: frames[0]?.time_s ?? 0,
        frames: [a, b],
        error: errors.length > 0 ? errors.join("; ") : null,
      };
    });
  }
  return first.frames.map((frame, k) => ({
    time_s: frame.time_s,
    frames: [k],
    error: frame.error,
  }));
}

/** Returns the step that shows a frame of side 0, or the one nearest to it. */
export function stepOfFrame(steps: Step[], frame: number): number {
  let best = 0;
  let distance = Infinity;
  steps.forEach((step, k) => {
    const d = Math.abs((step.frames[0] ?? 0) - frame);
    if (d < distance) [best, distance] = [k, d];
  });
  return best;
}
