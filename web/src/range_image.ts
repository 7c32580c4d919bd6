// The range image: a sensor's points by row (ring) and column (azimuth), as the sensor saw them.

import type { Sensor } from "./document";
import type { PointFrame } from "./frame_data";

export interface RangeImage {
  width: number;
  height: number;
  index: Int32Array; // the point at each pixel, -1 where there is none; row 0 is the uppermost
}

/** Takes a point of the scene to a sensor's frame: x forward, y left, z up. */
function inSensor(pose: number[], x: number, y: number, z: number): [number, number, number] {
  const dx = x - pose[3]!;
  const dy = y - pose[7]!;
  const dz = z - pose[11]!;
  return [
    pose[0]! * dx + pose[4]! * dy + pose[8]! * dz,
    pose[1]! * dx + pose[5]! * dy + pose[9]! * dz,
    pose[2]! * dx + pose[6]! * dy + pose[10]! * dz,
  ];
}

export class RangeProjector {
  private index = new Int32Array(0);
  private nearest = new Float32Array(0);

  /**
   * Returns the image of one sensor's points. The middle column looks along the sensor's x axis,
   * azimuth falls from left to right, as one sees it. Rings count downwards or upwards, as the
   * points themselves tell; without rings rows are elevations. Of two points at a pixel the nearer stays.
   */
  project(frame: PointFrame, sensor: Sensor, number: number): RangeImage {
    const width = sensor.columns > 0 ? Math.min(4096, sensor.columns) : 1024;
    const height = sensor.channels > 0 ? Math.min(512, sensor.channels) : 64;
    const size = width * height;
    if (this.index.length < size) {
      this.index = new Int32Array(size);
      this.nearest = new Float32Array(size);
    }
    const index = this.index.subarray(0, size).fill(-1);
    const nearest = this.nearest.subarray(0, size).fill(Infinity);
    const of = frame.fields.get("sensor");
    const ring = frame.fields.get("ring");
    const upwards = ring !== undefined && this.ringsCountUpwards(frame, sensor, number);
    const [low, high] = this.elevations(frame, sensor, number, ring === undefined);
    const { position, count } = frame;
    for (let k = 0; k < count; k++) {
      if (of !== undefined && of[k] !== number) continue;
      const [x, y, z] = inSensor(
        sensor.pose,
        position[3 * k]!,
        position[3 * k + 1]!,
        position[3 * k + 2]!,
      );
      const range = Math.hypot(x, y, z);
      if (!(range > 0)) continue;
      const column = Math.floor((0.5 - Math.atan2(y, x) / (2 * Math.PI)) * width + 0.5) % width;
      let row: number;
      if (ring !== undefined) {
        row = upwards ? height - 1 - ring[k]! : ring[k]!;
      } else {
        const elevation = Math.asin(z / range);
        row = Math.round(((high - elevation) / (high - low)) * (height - 1));
      }
      if (row < 0 || row >= height) continue;
      const at = row * width + column;
      if (range < nearest[at]!) {
        nearest[at] = range;
        index[at] = k;
      }
    }
    return { width, height, index };
  }

  private elevations(
    frame: PointFrame,
    sensor: Sensor,
    number: number,
    needed: boolean,
  ): [number, number] {
    const [from, to] = sensor.elevation_deg ?? [0, 0];
    if (to - from > 0.1) return [(from * Math.PI) / 180, (to * Math.PI) / 180];
    if (!needed) return [-1, 1];
    let [low, high] = [Infinity, -Infinity];
    this.each(frame, number, (k) => {
      const elevation = this.elevationOf(frame, sensor, k);
      low = Math.min(low, elevation);
      high = Math.max(high, elevation);
    });
    return high > low ? [low, high] : [-0.5, 0.5];
  }

  private ringsCountUpwards(frame: PointFrame, sensor: Sensor, number: number): boolean {
    const ring = frame.fields.get("ring")!;
    let [n, sr, se, sre] = [0, 0, 0, 0];
    this.each(frame, number, (k) => {
      const elevation = this.elevationOf(frame, sensor, k);
      n += 1;
      sr += ring[k]!;
      se += elevation;
      sre += ring[k]! * elevation;
    });
    return n * sre - sr * se > 0; // the sign of the covariance
  }

  private elevationOf({ position }: PointFrame, sensor: Sensor, k: number): number {
    const [x, y, z] = inSensor(
      sensor.pose,
      position[3 * k]!,
      position[3 * k + 1]!,
      position[3 * k + 2]!,
    );
    return Math.atan2(z, Math.hypot(x, y));
  }

  private each(frame: PointFrame, number: number, visit: (k: number) => void): void {
    const of = frame.fields.get("sensor");
    const stride = Math.max(1, Math.floor(frame.count / 2000));
    for (let k = 0; k < frame.count; k += stride)
      if (of === undefined || of[k] === number) visit(k);
  }
}

/** The point at or next to a pixel, -1 where nothing is near. */
export function nearPixel(image: RangeImage, column: number, row: number, reach = 2): number {
  let best = -1;
  let nearest = Infinity;
  for (let dy = -reach; dy <= reach; dy++) {
    for (let dx = -reach; dx <= reach; dx++) {
      const y = row + dy;
      if (y < 0 || y >= image.height) continue;
      const x = (column + dx + image.width) % image.width;
      const found = image.index[y * image.width + x]!;
      const square = dx * dx + dy * dy;
      if (found >= 0 && square < nearest) [nearest, best] = [square, found];
    }
  }
  return best;
}
