// The whole view as one object: what a link, a file and the page's own controls hold.

import { NO_FILTERS, SORTS, type Filters } from "./filters";
import { QUANTITIES, type Quantity } from "./quantity";

export const LAYERS = [
  "points",
  "boxes",
  "ignored",
  "names",
  "path",
  "detections",
  "twin",
  "lanes",
  "signals",
  "sensors",
  "coverage",
  "grid",
] as const;
export type Layer = (typeof LAYERS)[number];

export const EYES = ["orbit", "above", "sensor", "chase"] as const;
export type EyeMode = (typeof EYES)[number];
export const ARRANGEMENTS = ["beside", "over", "first", "second"] as const;
export type Arrangement = (typeof ARRANGEMENTS)[number];
export const THEMES = ["auto", "light", "dark"] as const;

export interface View {
  step: number; // on the time line
  speed: number;
  loop: boolean;
  colour: Quantity;
  from: number | null; // the colour table's domain, null: as the data has it
  to: number | null;
  size: number;
  fog: number; // 0..1
  ground: boolean; // shown
  hidden: number[]; // semantic classes whose points are hidden
  section: boolean;
  section_turn_deg: number; // where the plane's normal points; 0: +x, 90: +y
  section_level: boolean; // a level plane: what is above it is cut
  section_at_m: number;
  section_thick_m: number; // 0: everything behind the plane
  layers: Record<Layer, boolean>;
  selected: number | null; // a track, or −2 − k for box k of a frame whose boxes have none
  selected_side: number;
  follow: boolean;
  score: number; // threshold
  filters: Filters;
  eye: EyeMode;
  sensor: string;
  position: [number, number, number] | null;
  target: [number, number, number] | null;
  fov: number;
  range_image: boolean;
  arrangement: Arrangement;
  theme: (typeof THEMES)[number];
}

export const DEFAULT_VIEW: View = {
  step: 0,
  speed: 1,
  loop: true,
  colour: "class",
  from: null,
  to: null,
  size: 1,
  fog: 0,
  ground: true,
  hidden: [],
  section: false,
  section_turn_deg: 0,
  section_level: false,
  section_at_m: 0,
  section_thick_m: 0,
  layers: {
    points: true,
    boxes: true,
    ignored: false,
    names: false,
    path: true,
    detections: true,
    twin: false,
    lanes: false,
    signals: true,
    sensors: true,
    coverage: false,
    grid: true,
  },
  selected: null,
  selected_side: 0,
  follow: false,
  score: 0.3,
  filters: NO_FILTERS,
  eye: "orbit",
  sensor: "",
  position: null,
  target: null,
  fov: 50,
  range_image: false,
  arrangement: "beside",
  theme: "auto",
};

/** Returns a view from what a stranger wrote: what is missing, unknown or out of bounds takes the default. */
export function readView(value: unknown, base: View = DEFAULT_VIEW): View {
  const raw = (typeof value === "object" && value !== null ? value : {}) as Record<string, unknown>;
  const number = (key: keyof View, low: number, high: number): number => {
    const v = raw[key];
    return typeof v === "number" && Number.isFinite(v)
      ? Math.min(high, Math.max(low, v))
      : (base[key] as number);
  };
  const flag = (v: unknown, fallback: boolean): boolean => (typeof v === "boolean" ? v : fallback);
  const orNull = (key: "from" | "to" | "selected"): number | null => {
    const v = raw[key];
    return typeof v === "number" && Number.isFinite(v) ? v : v === null ? null : base[key];
  };
  const one = <T extends string>(v: unknown, of: readonly T[], fallback: T): T =>
    of.includes(v as T) ? (v as T) : fallback;
  const place = (key: "position" | "target"): View["position"] => {
    const v = raw[key];
    const good = Array.isArray(v) && v.length === 3 && v.every((n) => Number.isFinite(n));
    return good ? (v as [number, number, number]) : base[key];
  };
  const layers = { ...base.layers };
  const rawLayers = (raw["layers"] ?? {}) as Record<string, unknown>;
  for (const layer of LAYERS) layers[layer] = flag(rawLayers[layer], layers[layer]);
  return {
    step: Math.round(number("step", 0, 1e7)),
    speed: number("speed", 0.05, 20),
    loop: flag(raw["loop"], base.loop),
    colour: one(raw["colour"], QUANTITIES, base.colour),
    from: orNull("from"),
    to: orNull("to"),
    size: number("size", 0.25, 6),
    fog: number("fog", 0, 1),
    ground: flag(raw["ground"], base.ground),
    hidden: Array.isArray(raw["hidden"])
      ? raw["hidden"].filter((n): n is number => Number.isInteger(n) && n >= 0 && n < 256)
      : base.hidden,
    section: flag(raw["section"], base.section),
    section_turn_deg: number("section_turn_deg", -360, 360),
    section_level: flag(raw["section_level"], base.section_level),
    section_at_m: number("section_at_m", -1000, 1000),
    section_thick_m: number("section_thick_m", 0, 1000),
    layers,
    selected: orNull("selected"),
    selected_side: Math.round(number("selected_side", 0, 1)),
    follow: flag(raw["follow"], base.follow),
    score: number("score", 0, 1),
    filters: readFilters(raw["filters"], base.filters),
    eye: one(raw["eye"], EYES, base.eye),
    sensor: typeof raw["sensor"] === "string" ? raw["sensor"].slice(0, 200) : base.sensor,
    position: place("position"),
    target: place("target"),
    fov: number("fov", 5, 120),
    range_image: flag(raw["range_image"], base.range_image),
    arrangement: one(raw["arrangement"], ARRANGEMENTS, base.arrangement),
    theme: one(raw["theme"], THEMES, base.theme),
  };
}

function readFilters(value: unknown, base: Filters): Filters {
  const raw = (typeof value === "object" && value !== null ? value : {}) as Record<string, unknown>;
  const number = (v: unknown, low: number, high: number, fallback: number): number =>
    typeof v === "number" && Number.isFinite(v) ? Math.min(high, Math.max(low, v)) : fallback;
  const range = Array.isArray(raw["range_m"]) ? raw["range_m"] : [];
  const sort = raw["sort"] as Filters["sort"];
  return {
    classes: Array.isArray(raw["classes"])
      ? raw["classes"].filter((name): name is string => typeof name === "string").slice(0, 256)
      : base.classes,
    range_m: [
      number(range[0], 0, 1000, base.range_m[0]),
      number(range[1], 0, 1000, base.range_m[1]),
    ],
    points: number(raw["points"], 0, 1e6, base.points),
    occlusion: number(raw["occlusion"], 0, 1, base.occlusion),
    ignored: typeof raw["ignored"] === "boolean" ? raw["ignored"] : base.ignored,
    text: typeof raw["text"] === "string" ? raw["text"].slice(0, 200) : base.text,
    sort: SORTS.includes(sort) ? sort : base.sort,
    descending: typeof raw["descending"] === "boolean" ? raw["descending"] : base.descending,
  };
}

/** The view as a file, and back; throws an Error with a sentence when the file is not one. */
export function fileOf(view: View): string {
  return `${JSON.stringify({ kind: "urbantwin view", format: 1, ...rounded(view) }, null, 2)}\n`;
}

export function viewOfFile(text: string, base: View = DEFAULT_VIEW): View {
  let raw: unknown;
  try {
    raw = JSON.parse(text);
  } catch {
    throw new Error("This file is not JSON; a view saved by this page was expected.");
  }
  if ((raw as { kind?: unknown } | null)?.kind !== "urbantwin view") {
    throw new Error("This file is not a view saved by this page.");
  }
  return readView(raw, base);
}

function rounded(view: View): View {
  const millimetres = (place: View["position"]): View["position"] =>
    place === null
      ? null
      : [
          Math.round(place[0] * 1000) / 1000,
          Math.round(place[1] * 1000) / 1000,
          Math.round(place[2] * 1000) / 1000,
        ];
  return { ...view, position: millimetres(view.position), target: millimetres(view.target) };
}

type Patch = Partial<View>;
type Listener = (view: View, before: View) => void;

/** Keeps the view and tells who listens when it changes. */
export class ViewStore {
  private readonly listeners: Listener[] = [];

  constructor(private current: View) {}

  get view(): View {
    return this.current;
  }

  set(patch: Patch): void {
    const before = this.current;
    const changed = (Object.keys(patch) as (keyof View)[]).some(
      (key) => patch[key] !== before[key],
    );
    if (!changed) return;
    this.current = { ...before, ...patch };
    for (const listener of this.listeners) listener(this.current, before);
  }

  layer(layer: Layer, on: boolean): void {
    this.set({ layers: { ...this.current.layers, [layer]: on } });
  }

  filter(patch: Partial<Filters>): void {
    this.set({ filters: { ...this.current.filters, ...patch } });
  }

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }
}
