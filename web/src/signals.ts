// Traffic signals: lamps in the colour that they show at a moment.

import * as THREE from "three";

import type { Point3, Rgb } from "./document";
import type { Packet } from "./packet";

export interface Signal {
  at: Point3;
  link: number;
  states: [number, string][];
}

// SUMO's letters: red, yellow, green with and without priority, red with yellow, blinking, off.
const LAMPS: Record<string, Rgb> = {
  r: [235, 60, 60],
  s: [235, 60, 60],
  u: [240, 130, 50],
  y: [245, 190, 50],
  Y: [245, 190, 50],
  g: [64, 190, 110],
  G: [40, 215, 120],
  o: [200, 160, 60],
  O: [120, 120, 120],
};

/** The letter that a signal shows at a time: that of its last change. */
export function stateAt(signal: Signal, time_s: number): string {
  let shown = signal.states[0]?.[1] ?? "O";
  for (const [since, state] of signal.states) {
    if (since > time_s + 1e-6) break;
    shown = state;
  }
  return shown;
}

export class SignalDrawing {
  readonly object: THREE.Points;
  private readonly signals: Signal[];
  private readonly colours: THREE.BufferAttribute;
  private readonly colour = new THREE.Color();

  constructor(packet: Packet) {
    this.signals = (packet.header["signals"] ?? []) as Signal[];
    const geometry = new THREE.BufferGeometry();
    const places = this.signals.flatMap((signal) => signal.at);
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
    this.colours = new THREE.Float32BufferAttribute(new Float32Array(places.length), 3);
    geometry.setAttribute("color", this.colours);
    const material = new THREE.PointsMaterial({
      size: 11,
      sizeAttenuation: false,
      vertexColors: true,
      transparent: true,
    });
    // A disc with a dark rim, as a lamp in its housing.
    material.onBeforeCompile = (shader) => {
      shader.fragmentShader = shader.fragmentShader.replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        float from = length(gl_PointCoord - 0.5);
        if (from > 0.5) discard;
        if (from > 0.36) diffuseColor.rgb = vec3(0.02);`,
      );
    };
    this.object = new THREE.Points(geometry, material);
    this.object.renderOrder = 1;
  }

  get count(): number {
    return this.signals.length;
  }

  show(time_s: number): void {
    this.signals.forEach((signal, k) => {
      const [r, g, b] = LAMPS[stateAt(signal, time_s)] ?? [120, 120, 120];
      this.colour.setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
      this.colours.setXYZ(k, this.colour.r, this.colour.g, this.colour.b);
    });
    this.colours.needsUpdate = true;
  }
}
