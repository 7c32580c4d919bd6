// What colours a point: one number of it, and how that number becomes an entry of a colour table.

import {
  classTable,
  gradientTable,
  instanceTable,
  listTable,
  sideColours,
  type Table,
  type Theme,
} from "./colour";
import type { Point3, Scene } from "./document";
import type { PointFrame } from "./frame_data";

export const QUANTITIES = [
  "class",
  "instance",
  "intensity",
  "height",
  "range",
  "ring",
  "time",
  "sensor",
  "side",
  "away",
] as const;
export type Quantity = (typeof QUANTITIES)[number];

interface Description {
  label: string;
  unit: string;
  table: "class" | "instance" | "sensor" | "side" | "viridis" | "turbo" | "away";
  needs: string | null; // the field that must be there
}

export const DESCRIPTIONS: Record<Quantity, Description> = {
  class: { label: "Class", unit: "", table: "class", needs: "semantic" },
  instance: { label: "Instance", unit: "", table: "instance", needs: "instance" },
  intensity: { label: "Intensity", unit: "", table: "viridis", needs: "intensity" },
  height: { label: "Height", unit: "m", table: "turbo", needs: null },
  range: { label: "Range", unit: "m", table: "viridis", needs: null },
  ring: { label: "Ring", unit: "", table: "viridis", needs: "ring" },
  time: { label: "Time in the sweep", unit: "s", table: "viridis", needs: "time" },
  sensor: { label: "Sensor", unit: "", table: "sensor", needs: "sensor" },
  side: { label: "Real or synthetic", unit: "", table: "side", needs: null },
  away: { label: "Distance to the other", unit: "m", table: "away", needs: "away" },
};

export const isCategorical = (quantity: Quantity): boolean =>
  ["class", "instance", "sensor", "side"].includes(DESCRIPTIONS[quantity].table);

/** The quantities that at least one side can be coloured by. */
export function offered(scene: Scene): Quantity[] {
  const fields = new Set(scene.sides.flatMap((side) => side.fields));
  const pair = scene.sides.length > 1;
  return QUANTITIES.filter((quantity) => {
    if (quantity === "side") return pair;
    if (quantity === "away") return pair || fields.has("away");
    const { needs } = DESCRIPTIONS[quantity];
    return needs === null || fields.has(needs);
  });
}

export function tableFor(quantity: Quantity, scene: Scene, theme: Theme): Table {
  switch (DESCRIPTIONS[quantity].table) {
    case "class":
      return classTable(scene, theme);
    case "instance":
      return instanceTable(theme);
    case "sensor": {
      const hues = instanceTable(theme);
      return listTable(
        Array.from({ length: 16 }, (_, k) => [
          hues[4 * (k + 1)]!,
          hues[4 * (k + 1) + 1]!,
          hues[4 * (k + 1) + 2]!,
        ]),
      );
    }
    case "side":
      return listTable(sideColours(theme));
    case "viridis":
    case "turbo":
    case "away":
      return gradientTable(DESCRIPTIONS[quantity].table, theme);
  }
}

/** Where the sensors of a scene stand: what ranges are measured from. */
export function sensorOrigins(scene: Scene): Point3[] {
  return scene.sensors.map(({ pose }) => [pose[3] ?? 0, pose[7] ?? 0, pose[11] ?? 0]);
}

/**
 * Writes the quantity of every point of a frame into an array that is as long at least.
 *
 * Categories are written as entries of the table (0..255), numbers as they are. Where the frame
 * has no such field, -1: the shader draws such points in the background's grey.
 */
export function fillQuantity(
  to: Float32Array,
  frame: PointFrame,
  quantity: Quantity,
  side: number,
  origins: Point3[],
  groundZ: number,
): void {
  const { count, position, fields } = frame;
  const { needs } = DESCRIPTIONS[quantity];
  if (quantity === "height") {
    for (let k = 0; k < count; k++) to[k] = position[3 * k + 2]! - groundZ;
  } else if (quantity === "range") {
    const sensor = fields.get("sensor");
    const first: Point3 = origins[0] ?? [0, 0, 0];
    for (let k = 0; k < count; k++) {
      const from = sensor === undefined ? first : (origins[sensor[k]!] ?? first);
      const dx = position[3 * k]! - from[0];
      const dy = position[3 * k + 1]! - from[1];
      const dz = position[3 * k + 2]! - from[2];
      to[k] = Math.sqrt(dx * dx + dy * dy + dz * dz);
    }
  } else if (quantity === "side") {
    to.fill(side, 0, count);
  } else {
    const values = fields.get(needs ?? "");
    if (values === undefined) {
      to.fill(-1, 0, count);
    } else if (quantity === "instance") {
      for (let k = 0; k < count; k++) to[k] = instanceEntry(values[k]!);
    } else {
      for (let k = 0; k < count; k++) to[k] = values[k]!;
    }
  }
}

/**
 * The entry of the instance table: 0 for no object, else 1..254, the same for the same object.
 * After 254 golden angles the hue is far from the first one's; after 255 it would be almost the same.
 */
export function instanceEntry(instance: number): number {
  return instance <= 0 ? 0 : ((instance - 1) % 254) + 1;
}

/** A domain that holds all but the most extreme hundredth of the values at either end. */
export function domainOf(values: Float32Array, count: number): [number, number] {
  const picked: number[] = [];
  const stride = Math.max(1, Math.floor(count / 4000));
  for (let k = 0; k < count; k += stride) {
    const value = values[k]!;
    if (Number.isFinite(value)) picked.push(value);
  }
  if (picked.length === 0) return [0, 1];
  picked.sort((a, b) => a - b);
  const low = picked[Math.floor(0.01 * (picked.length - 1))]!;
  const high = picked[Math.ceil(0.99 * (picked.length - 1))]!;
  return high - low > 1e-6 ? [low, high] : [low, low + 1];
}

/** The domain of a quantity: fixed where its meaning fixes it, else from a frame's values. */
export function domainFor(
  quantity: Quantity,
  scene: Scene,
  values: Float32Array,
  count: number,
): [number, number] {
  if (quantity === "away") return [0, 1];
  if (quantity === "range") return [0, rounded(domainOf(values, count)[1])];
  if (quantity === "ring") {
    const channels = Math.max(0, ...scene.sensors.map((sensor) => sensor.channels));
    if (channels > 1) return [0, channels - 1];
  }
  const [low, high] = domainOf(values, count);
  if (quantity === "intensity") return [0, Math.max(1, high)];
  if (quantity === "height") return [Math.floor(low), Math.ceil(high)];
  return [low, high];
}

const rounded = (value: number): number => Math.max(10, Math.ceil(value / 10) * 10);

/** What a point's value reads as, for people. */
export function sayQuantity(quantity: Quantity, value: number): string {
  const { unit } = DESCRIPTIONS[quantity];
  const digits = quantity === "time" ? 4 : unit === "m" ? 2 : 0;
  return `${value.toFixed(digits)}${unit ? ` ${unit}` : ""}`;
}
