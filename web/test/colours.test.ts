import assert from "node:assert/strict";
import { test } from "node:test";

import { calm, gradientTable, instanceTable, oklabOf, readable, rgbOfOklab } from "../src/colour";
import type { Rgb, Scene } from "../src/document";
import { readDocument } from "../src/document";
import { PointFrame } from "../src/frame_data";
import { GroundFinder } from "../src/ground";
import { domainOf, fillQuantity, instanceEntry, offered } from "../src/quantity";

const scene = (over: object = {}): Scene =>
  readDocument({
    format: 1,
    kind: "dataset",
    classes: [
      { id: 10, name: "car", colour: [100, 150, 245] },
      { id: 40, name: "road", colour: [255, 0, 255] },
    ],
    sides: [{ name: "a", role: "only", fields: ["semantic"], frames: [], rate_hz: 10 }],
    ...over,
  });

// Relative luminance and contrast as WCAG 2 defines them.
const luminance = (colour: Rgb): number => {
  const [r, g, b] = colour.map((c) => {
    const v = c / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  }) as Rgb;
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const contrast = (a: Rgb, b: Rgb): number => {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x) as [number, number];
  return (high + 0.05) / (low + 0.05);
};

test("OKLab of colours that its author published", () => {
  // https://bottosson.github.io/posts/oklab/: white is (1, 0, 0); sRGB red as CSS Color 4 gives it.
  const close = (a: number[], b: number[]): void =>
    a.forEach((v, k) => assert.ok(Math.abs(v - b[k]!) < 2e-3, `${a} ${b}`));
  close(oklabOf([255, 255, 255]), [1, 0, 0]);
  close(oklabOf([0, 0, 0]), [0, 0, 0]);
  close(oklabOf([255, 0, 0]), [0.628, 0.2249, 0.1258]);
  for (const colour of [
    [12, 200, 77],
    [255, 0, 255],
    [3, 3, 9],
  ] as Rgb[]) {
    rgbOfOklab(oklabOf(colour)).forEach((v, k) => assert.ok(Math.abs(v - colour[k]!) <= 1));
  }
});

test("every colour that points are drawn in stands out from its background", () => {
  const dark: Rgb = [14, 18, 22];
  const light: Rgb = [238, 241, 244];
  for (const colour of [
    [0, 0, 0],
    [75, 0, 75],
    [0, 0, 255],
    [255, 255, 255],
    [255, 240, 150],
  ] as Rgb[]) {
    assert.ok(contrast(readable(colour, "dark"), dark) > 3, `${colour} on dark`);
    assert.ok(contrast(readable(colour, "light"), light) > 2, `${colour} on light`);
    assert.ok(contrast(calm(colour, "dark", true), dark) > 2.5);
  }
  for (const name of ["viridis", "turbo", "away"]) {
    for (const theme of ["dark", "light"] as const) {
      const table = gradientTable(name, theme);
      for (let k = 0; k < 256; k += 15) {
        const colour: Rgb = [table[4 * k]!, table[4 * k + 1]!, table[4 * k + 2]!];
        assert.ok(contrast(colour, theme === "dark" ? dark : light) > 1.8, `${name} ${theme} ${k}`);
      }
    }
  }
});

test("neighbouring instances differ, the same instance does not", () => {
  const table = instanceTable("dark");
  const at = (instance: number): number[] => [
    ...table.slice(4 * instanceEntry(instance), 4 * instanceEntry(instance) + 3),
  ];
  assert.equal(instanceEntry(0), 0);
  for (let k = 1; k < 400; k++) {
    const [a, b] = [at(k), at(k + 1)];
    assert.ok(Math.hypot(a[0]! - b[0]!, a[1]! - b[1]!, a[2]! - b[2]!) > 40, `${k}`);
  }
  assert.deepEqual(at(30001), at(30001));
});

function frameOf(points: number[][], fields: Record<string, number[]> = {}): PointFrame {
  const frame = new PointFrame();
  frame.count = points.length;
  frame.position = Float32Array.from(points.flat());
  for (const [name, values] of Object.entries(fields))
    frame.fields.set(name, Uint16Array.from(values));
  return frame;
}

test("range is measured from the sensor that saw the point, height from the ground", () => {
  const frame = frameOf(
    [
      [3, 4, 0],
      [3, 4, 12],
      [10, 0, 0],
    ],
    { sensor: [0, 0, 1] },
  );
  const values = new Float32Array(3);
  fillQuantity(
    values,
    frame,
    "range",
    0,
    [
      [0, 0, 0],
      [10, 0, 2],
    ],
    0,
  );
  assert.deepEqual([...values], [5, 13, 2]);
  fillQuantity(values, frame, "height", 0, [], -2);
  assert.deepEqual([...values], [2, 14, 2]);
  fillQuantity(values, frame, "ring", 0, [], 0);
  assert.deepEqual([...values], [-1, -1, -1], "no such field");
});

test("the domain leaves out a few wild values", () => {
  const values = Float32Array.from({ length: 1000 }, (_, k) => k / 1000);
  values[500] = 1e9;
  const [low, high] = domainOf(values, 1000);
  assert.ok(low >= 0 && low < 0.03 && high > 0.97 && high < 1);
  assert.deepEqual(domainOf(values, 0), [0, 1]);
});

test("only quantities that the data holds are offered", () => {
  assert.deepEqual(offered(scene()), ["class", "height", "range"]);
  const side = { name: "a", fields: ["intensity"], frames: [], rate_hz: 10 };
  const pair = scene({ kind: "pair", sides: [side, side] });
  assert.deepEqual(offered(pair), ["intensity", "height", "range", "side", "away"]);
});

test("ground is told by class, else by height over the lowest nearby, also on a slope", () => {
  const finder = new GroundFinder(scene());
  const marks = new Uint8Array(400);
  finder.mark(
    marks,
    frameOf(
      [
        [0, 0, 0],
        [0, 0, 5],
        [1, 0, 0],
      ],
      { semantic: [40, 10, 10] },
    ),
  );
  assert.deepEqual([...marks.slice(0, 3)], [1, 0, 0]);
  // No classes: a road that rises 8 m over 100 m, and a car's roof on it.
  const slope = Array.from({ length: 200 }, (_, k) => [k / 2, 0.3, 0.08 * (k / 2)]);
  const roof = [[60.5, 0.4, 0.08 * 60.5 + 1.5]];
  finder.mark(marks, frameOf([...slope, ...roof]));
  assert.equal(marks.slice(0, 200).indexOf(0), -1, "all of the road is ground");
  assert.equal(marks[200], 0, "the roof is not");
});
