import assert from "node:assert/strict";
import { test } from "node:test";

import type { Sensor } from "../src/document";
import { PointFrame } from "../src/frame_data";
import { nearPixel, RangeProjector } from "../src/range_image";

// A sensor that stands at (5, −3, 6) and looks west: its x axis is −x of the scene, its left is south.
const SENSOR: Sensor = {
  name: "pole",
  model: "made up",
  pose: [-1, 0, 0, 5, 0, -1, 0, -3, 0, 0, 1, 6, 0, 0, 0, 1],
  elevation_deg: [-20, 20],
  azimuth_deg: null,
  range_m: 100,
  channels: 5, // −20, −10, 0, 10, 20 degrees
  columns: 360, // a degree each
};

/** A point by azimuth and elevation of the sensor, placed by hand into the scene. */
function seen(azimuth_deg: number, elevation_deg: number, range: number): number[] {
  const [a, e] = [(azimuth_deg * Math.PI) / 180, (elevation_deg * Math.PI) / 180];
  const [x, y, z] = [
    range * Math.cos(e) * Math.cos(a),
    range * Math.cos(e) * Math.sin(a),
    range * Math.sin(e),
  ];
  return [5 - x, -3 - y, 6 + z];
}

function frameOf(points: number[][], ring?: number[]): PointFrame {
  const frame = new PointFrame();
  frame.count = points.length;
  frame.position = Float32Array.from(points.flat());
  if (ring) frame.fields.set("ring", Uint16Array.from(ring));
  return frame;
}

const POINTS = [
  seen(0, 20, 10),
  seen(90, 0, 10),
  seen(-90, -20, 10),
  seen(0, 20, 4),
  seen(0, -10, 7),
];
// Straight ahead is the middle column, the sensor's left (+90°) the first quarter.
const PLACES: [number, number][] = [
  [180, 0],
  [90, 2],
  [270, 4],
  [180, 0],
  [180, 3],
];

test("without rings, rows are elevations and columns azimuths; the nearer point stays", () => {
  const image = new RangeProjector().project(frameOf(POINTS), SENSOR, 0);
  assert.deepEqual([image.width, image.height], [360, 5]);
  const found = new Map<number, number>();
  image.index.forEach((k, at) => k >= 0 && found.set(k, at));
  assert.ok(!found.has(0), "the point 10 m away lies behind the one 4 m away");
  for (const k of [1, 2, 3, 4]) {
    const [column, row] = PLACES[k]!;
    assert.equal(found.get(k), row * 360 + column, `point ${k}`);
  }
});

test("rings that count downwards and upwards give the same picture", () => {
  const down = PLACES.map(([, row]) => row);
  const up = down.map((row) => 4 - row);
  const a = new RangeProjector().project(frameOf(POINTS, down), SENSOR, 0);
  const b = new RangeProjector().project(frameOf(POINTS, up), SENSOR, 0);
  assert.deepEqual([...a.index], [...b.index]);
  assert.equal(a.index[0 * 360 + 180], 3);
});

test("only the points of the sensor that is asked for", () => {
  const frame = frameOf(POINTS);
  frame.fields.set("sensor", Uint8Array.from([1, 1, 0, 1, 1]));
  const image = new RangeProjector().project(frame, SENSOR, 0);
  assert.deepEqual(
    [...image.index].filter((k) => k >= 0),
    [2],
  );
});

test("a click beside a pixel takes the nearest, also across the seam", () => {
  const image = new RangeProjector().project(frameOf([seen(179.6, 0, 9)]), SENSOR, 0);
  const at = image.index.indexOf(0);
  assert.equal(nearPixel(image, (at + 1) % 360, 2), 0);
  assert.equal(nearPixel(image, (at + 359) % 360, 2), 0);
  assert.equal(nearPixel(image, (at + 90) % 360, 2), -1);
});
