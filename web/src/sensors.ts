// Sensors: where they stand, which way they look, and what their field of view takes in.

import * as THREE from "three";

import type { Sensor } from "./document";

const ROUND = 72;

export class SensorDrawing {
  readonly object = new THREE.Group();
  private readonly lines = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.32 });
  private readonly faces = new THREE.MeshBasicMaterial({
    transparent: true,
    opacity: 0.035,
    side: THREE.DoubleSide,
    depthWrite: false,
  });
  private readonly bodies = new THREE.MeshLambertMaterial();

  constructor(sensors: Sensor[]) {
    for (const sensor of sensors) this.object.add(this.one(sensor));
  }

  setColour(colour: THREE.Color): void {
    for (const material of [this.lines, this.faces, this.bodies]) material.color.copy(colour);
  }

  private one(sensor: Sensor): THREE.Group {
    const group = new THREE.Group();
    const matrix = new THREE.Matrix4();
    // prettier-ignore
    matrix.set(...(sensor.pose.slice(0, 16) as Parameters<THREE.Matrix4["set"]>));
    group.matrixAutoUpdate = false;
    group.matrix.copy(matrix);
    group.name = sensor.name;
    const body = new THREE.Mesh(new THREE.CylinderGeometry(0.16, 0.16, 0.26, 24), this.bodies);
    body.rotation.x = Math.PI / 2;
    group.add(body);
    const reach = Math.min(12, sensor.range_m || 12);
    const frustum = frustumOf(sensor, reach);
    const outline = new THREE.BufferGeometry();
    outline.setAttribute("position", new THREE.Float32BufferAttribute(frustum.lines, 3));
    group.add(new THREE.LineSegments(outline, this.lines));
    const surface = new THREE.BufferGeometry();
    surface.setAttribute("position", new THREE.Float32BufferAttribute(frustum.triangles, 3));
    group.add(new THREE.Mesh(surface, this.faces));
    return group;
  }
}

/**
 * The field of view in the sensor's frame out to a reach: the band between the lowest and the
 * highest elevation on a sphere, the cones to it, and the sides where it is not all round.
 */
export function frustumOf(sensor: Sensor, reach: number): { lines: number[]; triangles: number[] } {
  const [low, high] = sensor.elevation_deg.map((deg) => (deg * Math.PI) / 180) as [number, number];
  const turn = sensor.azimuth_deg === null;
  const [from, to] = (sensor.azimuth_deg ?? [-180, 180]).map((deg) => (deg * Math.PI) / 180) as [
    number,
    number,
  ];
  const span = to > from ? to - from : to - from + 2 * Math.PI;
  const steps = Math.max(4, Math.round((ROUND * span) / (2 * Math.PI)));
  const at = (k: number, elevation: number): [number, number, number] => {
    const azimuth = from + (span * k) / steps;
    return [
      reach * Math.cos(elevation) * Math.cos(azimuth),
      reach * Math.cos(elevation) * Math.sin(azimuth),
      reach * Math.sin(elevation),
    ];
  };
  const lines: number[] = [];
  const triangles: number[] = [];
  for (let k = 0; k < steps; k++) {
    for (const elevation of [low, high]) {
      lines.push(...at(k, elevation), ...at(k + 1, elevation));
      triangles.push(0, 0, 0, ...at(k, elevation), ...at(k + 1, elevation));
    }
  }
  const spokes = turn ? [0, 1, 2, 3].map((q) => (q * steps) / 4) : [0, steps];
  for (const k of spokes) {
    lines.push(...at(k, low), ...at(k, high));
    for (const elevation of [low, high]) lines.push(0, 0, 0, ...at(k, elevation));
    if (!turn) triangles.push(0, 0, 0, ...at(k, low), ...at(k, high));
  }
  // Forward, twice as far: which way x points.
  lines.push(0, 0, 0, 1.25 * reach, 0, 0);
  return { lines, triangles };
}
