import assert from "node:assert/strict";
import { test } from "node:test";

import { contains, cornersOf, rayHits } from "../src/box_geometry";
import { listed, NO_FILTERS, passes } from "../src/filters";
import { PointFrame, type Box } from "../src/frame_data";
import { boxOfPoint, pickBox, pickPoint } from "../src/pick";
import { countVerdicts, verdictsAt } from "../src/verdicts";

const box = (over: Partial<Box> = {}): Box => ({
  track: 1,
  class: "car",
  box: [10, 0, 1, 4, 2, 1.5, 0],
  velocity: null,
  points: 50,
  occlusion: 0.2,
  truncation: 0,
  difficulty: "easy",
  ignored: null,
  hidden_by: null,
  why: null,
  score: null,
  verdict: null,
  ...over,
});

test("corners of a box that is turned by 90 degrees", () => {
  const corners = cornersOf([1, 2, 3, 4, 2, 2, Math.PI / 2]);
  const xs = corners.map((c) => c[0]);
  const ys = corners.map((c) => c[1]);
  assert.ok(Math.abs(Math.max(...xs) - 2) < 1e-9 && Math.abs(Math.min(...xs)) < 1e-9);
  assert.ok(Math.abs(Math.max(...ys) - 4) < 1e-9 && Math.abs(Math.min(...ys)) < 1e-9);
});

test("a ray meets a box at its face, a turned one at its edge, and misses beside it", () => {
  assert.ok(Math.abs(rayHits([10, 0, 0, 4, 2, 2, 0], [0, 0, 0], [1, 0, 0]) - 8) < 1e-9);
  const turned = rayHits([10, 0, 0, 2, 2, 2, Math.PI / 4], [0, 0, 0], [1, 0, 0]);
  assert.ok(Math.abs(turned - (10 - Math.SQRT2)) < 1e-9);
  assert.equal(rayHits([10, 3, 0, 4, 2, 2, 0], [0, 0, 0], [1, 0, 0]), Infinity);
  assert.equal(rayHits([-10, 0, 0, 4, 2, 2, 0], [0, 0, 0], [1, 0, 0]), Infinity, "behind the eye");
});

test("what a ray hits agrees with walking along it", () => {
  let seed = 7;
  const random = (): number => ((seed = (seed * 16807) % 2147483647) / 2147483647) * 2 - 1;
  for (let n = 0; n < 200; n++) {
    const numbers: Box["box"] = [5 + random(), random(), random(), 2, 1, 1.5, 3 * random()];
    const direction: [number, number, number] = [1, 0.3 * random(), 0.3 * random()];
    const hit = rayHits(numbers, [0, 0, 0], direction);
    let walked = Infinity;
    for (let t = 0; t < 10; t += 0.002) {
      if (contains(numbers, t * direction[0], t * direction[1], t * direction[2], 0)) {
        walked = t;
        break;
      }
    }
    // A graze may fall between two steps of the walk.
    if (walked !== Infinity) assert.ok(Math.abs(hit - walked) < 0.003, `${n}: ${hit} ${walked}`);
  }
});

test("filters keep out what they name, never what a box does not say", () => {
  const origins: [number, number, number][] = [[0, 0, 1]];
  assert.ok(passes(box(), NO_FILTERS, origins));
  assert.ok(!passes(box(), { ...NO_FILTERS, classes: ["car"] }, origins));
  assert.ok(!passes(box(), { ...NO_FILTERS, points: 51 }, origins));
  assert.ok(passes(box({ points: null }), { ...NO_FILTERS, points: 51 }, origins));
  assert.ok(!passes(box(), { ...NO_FILTERS, occlusion: 0.1 }, origins));
  assert.ok(!passes(box(), { ...NO_FILTERS, range_m: [0, 9] }, origins));
  assert.ok(!passes(box({ ignored: "unseen" }), { ...NO_FILTERS, ignored: false }, origins));
  assert.ok(passes(box({ track: 412 }), { ...NO_FILTERS, text: " CAR 41" }, origins));
  assert.ok(!passes(box({ track: 412 }), { ...NO_FILTERS, text: "bus" }, origins));
});

test("the order is by what is asked, what says nothing comes last in both directions", () => {
  const boxes = [
    box({ points: 5 }),
    box({ points: null }),
    box({ points: 80 }),
    box({ points: 5 }),
  ];
  const by = (descending: boolean): number[] =>
    listed(boxes, { ...NO_FILTERS, sort: "points", descending }, []);
  assert.deepEqual(by(false), [0, 3, 2, 1]);
  assert.deepEqual(by(true), [2, 0, 3, 1]);
});

// A camera at the origin that looks along −z, 90° wide, as OpenGL's textbook matrix has it.
const near = 0.1;
const far = 100;
const perspective = [
  1,
  0,
  0,
  0,
  0,
  1,
  0,
  0,
  0,
  0,
  -(far + near) / (far - near),
  -1,
  0,
  0,
  (-2 * far * near) / (far - near),
  0,
];

test("the point under the pointer is the nearest to the eye, hidden ones and those behind are not", () => {
  const frame = new PointFrame();
  frame.count = 4;
  frame.position = Float32Array.from([0, 0, -20, 0.05, 0, -10, 0, 0, 5, 3, 0, -10]);
  const pick = (x: number, y: number, hidden = (_: number): boolean => false): number =>
    pickPoint(frame, perspective, 200, 200, x, y, 6, hidden);
  assert.equal(pick(100, 100), 1);
  assert.equal(
    pick(100, 100, (k) => k === 1),
    0,
  );
  assert.equal(pick(130, 100), 3, "3 m aside at 10 m: 30 of 100 pixels");
  assert.equal(pick(20, 20), -1);
});

test("a click takes the nearest box, not the one that the eye is in", () => {
  const boxes = [box(), box({ box: [20, 0, 1, 4, 2, 2, 0] }), box({ box: [0, 0, 1, 4, 2, 2, 0] })];
  assert.equal(
    pickBox(boxes, [0, 0, 1], [1, 0, 0], () => false),
    0,
  );
  assert.equal(
    pickBox(boxes, [0, 0, 1], [1, 0, 0], (_, k) => k === 0),
    1,
  );
  assert.equal(
    pickBox(boxes, [0, 0, 1], [0, 1, 0], () => false),
    -1,
  );
});

test("a point belongs to the box of its instance, else to the one that it lies in", () => {
  const frame = new PointFrame();
  frame.count = 2;
  frame.position = Float32Array.from([10, 0, 1, 40, 0, 1]);
  const boxes = [box({ track: 70000 }), box({ track: 9, box: [40, 0, 1, 4, 2, 2, 0] })];
  assert.equal(boxOfPoint(boxes, frame, 0), 0);
  frame.fields.set("instance", Uint16Array.from([9, 70000 & 0xffff]));
  assert.equal(boxOfPoint(boxes, frame, 0), 1);
  assert.equal(boxOfPoint(boxes, frame, 1), 0);
});

test("with a higher threshold hits become misses and false alarms vanish", () => {
  const boxes = [
    box({ verdict: "hit" }),
    box({ track: 2, box: [30, 0, 1, 4, 2, 2, 0], verdict: "miss" }),
    box({ track: -1, box: [10.3, 0, 1, 4, 2, 2, 0], score: 0.6, verdict: "hit" }),
    box({ track: -1, box: [50, 9, 1, 4, 2, 2, 0], score: 0.4, verdict: "false alarm" }),
  ];
  const at = (score: number): object => countVerdicts(boxes, verdictsAt(boxes, score));
  assert.deepEqual(at(0.3), { hits: 1, misses: 1, falseAlarms: 1 });
  assert.deepEqual(at(0.5), { hits: 1, misses: 1, falseAlarms: 0 });
  assert.deepEqual(at(0.7), { hits: 0, misses: 2, falseAlarms: 0 });
});
