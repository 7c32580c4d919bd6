import assert from "node:assert/strict";
import { test } from "node:test";

import * as THREE from "three";

import type { Point3, Sensor } from "../src/document";
import { arrowsAlong, strip } from "../src/lanes";
import { SectionPlane } from "../src/section";
import { frustumOf } from "../src/sensors";
import { DEFAULT_VIEW } from "../src/view_state";

const triangles = (corners: number[]): THREE.Triangle[] =>
  Array.from({ length: corners.length / 9 }, (_, t) => {
    const at = (k: number): THREE.Vector3 =>
      new THREE.Vector3(...(corners.slice(9 * t + 3 * k, 9 * t + 3 * k + 3) as Point3));
    return new THREE.Triangle(at(0), at(1), at(2));
  });

test("a lane's surface covers it once, also where its borders have different numbers of places", () => {
  const left: Point3[] = [[0, 3, 0], [10, 3, 0], [20, 3, 0], [30, 3, 0], [40, 3, 0]]; // prettier-ignore
  const right: Point3[] = [[0, 0, 0], [40, 0, 0]]; // prettier-ignore
  for (const [a, b] of [
    [left, right],
    [right, left],
    [left, left.map(([x]): Point3 => [x, 0, 0])],
  ]) {
    // prettier-ignore
    const corners: number[] = [];
    strip(corners, a!, b!);
    const area = triangles(corners).reduce((sum, one) => sum + one.getArea(), 0);
    assert.ok(Math.abs(area - 120) < 1e-9, `${area}`);
  }
});

test("arrows point the way of traffic, lie on the lane, and every lane of some length has one", () => {
  const line: Point3[] = [[0, 0, 0], [0, 50, 5], [-30, 50, 5]]; // prettier-ignore
  const corners: number[] = [];
  arrowsAlong(corners, line);
  const each = triangles(corners);
  assert.equal(each.length % 2, 0);
  assert.ok(each.length / 2 >= 5);
  for (const { a, b, c } of each) {
    const middle = b.clone().add(c).multiplyScalar(0.5);
    const way = a.clone().sub(middle);
    const first = a.y < 49;
    assert.ok(first ? way.y > 0.5 : way.x < -0.5, `${a.toArray()}`);
    assert.ok(Math.abs(first ? a.x : a.y - 50) < 1.2);
    if (first) assert.ok(Math.abs(a.z - 0.1 * a.y) < 0.3, "on the slope");
  }
  const short: number[] = [];
  arrowsAlong(short, [[0, 0, 0], [4, 0, 0]]); // prettier-ignore
  assert.equal(short.length, 18);
});

test("a frustum's places lie within the sensor's elevations and azimuths, at its reach", () => {
  const sensor: Sensor = {
    name: "corner",
    model: "made up",
    pose: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
    elevation_deg: [-25, 15],
    azimuth_deg: [150, -150], // backwards, across the seam
    range_m: 100,
    channels: 64,
    columns: 1024,
  };
  const { triangles: corners } = frustumOf(sensor, 12);
  assert.ok(corners.length > 0);
  for (let k = 0; k < corners.length; k += 3) {
    const [x, y, z] = corners.slice(k, k + 3) as Point3;
    const range = Math.hypot(x, y, z);
    if (range < 1e-9) continue;
    assert.ok(Math.abs(range - 12) < 1e-9);
    const elevation = (Math.asin(z / range) * 180) / Math.PI;
    assert.ok(elevation > -25.001 && elevation < 15.001);
    assert.ok(Math.abs((Math.atan2(y, x) * 180) / Math.PI) > 149.999);
  }
});

test("the section hides the same places from the pointer as three.js cuts from the twin", () => {
  const section = new SectionPlane();
  for (const level of [false, true]) {
    const view = {
      ...DEFAULT_VIEW,
      section: true,
      section_level: level,
      section_turn_deg: 37,
      section_at_m: 4,
      section_thick_m: 3,
    };
    section.update(view, new THREE.Vector3(5, 6, 0), new THREE.Vector3(30, 30, 30));
    for (let k = 0; k < 200; k++) {
      const place = new THREE.Vector3((k % 7) - 2, ((k * 3) % 11) - 3, (k % 13) - 4);
      const cut = section.clipping.some((plane) => plane.distanceToPoint(place) < 0);
      assert.equal(section.hides(place.x, place.y, place.z, 3), cut);
    }
  }
});

test("a drag of the handle moves the plane to where the pointer is along its normal", () => {
  const section = new SectionPlane();
  const view = { ...DEFAULT_VIEW, section: true, section_at_m: 2 };
  section.update(view, new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, -20, 5));
  const eye = new THREE.Vector3(0, -20, 5);
  const wanted = new THREE.Vector3(7.5, 0, 0); // on the line through the handle, along +x
  const ray = new THREE.Ray(eye, wanted.clone().sub(eye).normalize());
  assert.ok(Math.abs(section.draggedTo(ray) - 7.5) < 1e-6);
});
