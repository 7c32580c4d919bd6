import assert from "node:assert/strict";
import { test } from "node:test";

import { readDocument, stepsOf, type Step } from "../src/document";
import { sayDistance } from "../src/measure";
import { momentOf } from "../src/paths";
import { stateAt } from "../src/signals";
import { PlayClock, stepsAhead } from "../src/timeline";
import {
  DEFAULT_VIEW,
  fileOf,
  readView,
  viewOfFile,
  type View,
} from "../src/view_state";

const VIEW: View = {
  ...DEFAULT_VIEW,
  step: 12,
  colour: "range",
  selected: 7,
  hidden: [40, 48],
  layers: { ...DEFAULT_VIEW.layers, twin: true },
  filters: {
    ...DEFAULT_VIEW.filters,
    classes: ["Fußgänger & Rad"],
    text: "a+b=c #1",
    range_m: [5, 60],
  },
  position: [1.5, -2.25, 30],
  target: [0, 0, 0],
};

test("a view comes back from its file", () => {
  assert.deepEqual(viewOfFile(fileOf(VIEW)), VIEW);
});

test("what a stranger wrote never breaks the view", () => {
  const bad = [
    null,
    7,
    [],
    { step: "x", colour: "evil", layers: 3, filters: [], position: [1, "b", 3], hidden: "all" },
    { step: -5, size: 1e9, fog: NaN, filters: { range_m: [-1, Infinity], sort: "constructor" } },
    JSON.parse('{"__proto__": {"step": 9}, "layers": {"toString": true}}'),
  ];
  for (const value of bad) {
    const view = readView(value);
    assert.deepEqual(Object.keys(view).sort(), Object.keys(DEFAULT_VIEW).sort());
    assert.deepEqual(Object.keys(view.layers).sort(), Object.keys(DEFAULT_VIEW.layers).sort());
    assert.ok(view.step >= 0 && view.size <= 6 && view.fog === 0);
    assert.equal(view.colour, "class");
    assert.equal(view.filters.sort, "range");
  }
  assert.throws(() => viewOfFile("no json"), /not JSON/);
  assert.throws(() => viewOfFile('{"step": 3}'), /not a view/);
});

const steps = (times: number[]): Step[] =>
  times.map((time_s) => ({ time_s, frames: [0], error: null }));

test("the time line plays at the sensor's rate, whatever the pictures' rate", () => {
  for (const picture_s of [1 / 144, 1 / 60, 0.04]) {
    const clock = new PlayClock(steps(Array.from({ length: 200 }, (_, k) => k / 10)), 10);
    clock.start();
    let step = 0;
    for (let t = 0; t < 5 - 1e-9; t += picture_s)
      step = clock.advance(step, picture_s, 1, true, () => true);
    assert.ok(Math.abs(step - 50) <= 1, `${picture_s}: ${step}`);
  }
});

test("speed, the end, the loop, and a step that is not here yet", () => {
  const all = steps([0, 0.1, 0.2, 0.3]);
  const run = (
    seconds: number,
    speed: number,
    loop: boolean,
    ready = (_: number): boolean => true,
  ): [number, boolean] => {
    const clock = new PlayClock(all, 10);
    clock.start();
    let step = 0;
    for (let t = 0; t < seconds - 1e-9; t += 0.01)
      step = clock.advance(step, 0.01, speed, loop, ready);
    return [step, clock.playing];
  };
  assert.deepEqual(run(0.255, 1, false), [2, true]);
  assert.deepEqual(run(0.255, 0.5, false), [1, true]);
  assert.deepEqual(run(2, 1, false), [3, false]);
  assert.deepEqual(run(0.455, 1, true), [0, true]);
  assert.deepEqual(
    run(2, 1, true, (step) => step < 2),
    [1, true],
    "waits",
  );
});

test("a gap in the recording is not waited for, times that stand still do not stop it", () => {
  const clock = new PlayClock(steps([0, 0.1, 60, 60, 60.1]), 10);
  assert.equal(clock.lengthOf(1), 0.1);
  assert.equal(clock.lengthOf(2), 0.1);
  assert.ok(Math.abs(clock.lengthOf(3) - 0.1) < 1e-9);
});

test("the steps to load ahead go round the loop and never twice", () => {
  assert.deepEqual(stepsAhead(3, 5, 3, true), [4, 0, 1, 2]);
  assert.deepEqual(stepsAhead(3, 5, 3, false), [4, 2]);
  assert.deepEqual(stepsAhead(0, 1, 12, true), []);
  const ahead = stepsAhead(2, 4, 12, true);
  assert.equal(new Set(ahead).size, ahead.length);
});

test("steps of a pair follow its pairs; a damaged frame of either side is told", () => {
  const frame = (name: string, time_s: number, error: string | null = null): object => ({
    name,
    time_s,
    points: 1,
    error,
  });
  const scene = readDocument({
    format: 1,
    kind: "pair",
    sides: [
      { name: "real", frames: [frame("a", 0), frame("b", 0.1)], fields: [], rate_hz: 10 },
      {
        name: "twin",
        frames: [frame("x", 7), frame("y", 7.1, "cut short"), frame("z", 7.2)],
        fields: [],
        rate_hz: 10,
      },
    ],
    pairs: [
      [0, 2],
      [1, 1],
    ],
  });
  assert.deepEqual(
    stepsOf(scene).map((step) => [step.time_s, step.frames, step.error]),
    [
      [0, [0, 2], null],
      [0.1, [1, 1], "cut short"],
    ],
  );
  assert.throws(() => readDocument({ format: 2 }), /format 2/);
  assert.throws(() => readDocument([]), /not an object/);
});

test("signals show their last change, tracks their last moment", () => {
  const signal = {
    at: [0, 0, 0] as [number, number, number],
    link: 0,
    states: [
      [0, "r"],
      [5, "G"],
      [9, "y"],
    ] as [number, string][],
  };
  assert.deepEqual(
    [0, 4.99, 5, 8, 100].map((t) => stateAt(signal, t)),
    ["r", "r", "G", "G", "y"],
  );
  const track = {
    track: 1,
    class: "car",
    time_s: [1, 1.1, 1.2],
    at: [],
    size: [4, 2, 1] as [number, number, number],
  };
  assert.deepEqual(
    [0.5, 1, 1.15, 9].map((t) => momentOf(track, t)),
    [-1, 0, 1, 2],
  );
});

test("a distance is told along, level and in height", () => {
  assert.equal(sayDistance([0, 0, 5], [3, 4, -7]), "13.00 m  (level 5.00, height −12.00)");
});
