// Boxes of one side: edges, the way they face, and faces of the one that is selected.

import * as THREE from "three";

import { cornersOf, EDGES } from "./box_geometry";
import type { Point3, Rgb } from "./document";
import { FatLines } from "./fat_lines";
import type { Box } from "./frame_data";

const CUBE = new THREE.BoxGeometry(1, 1, 1);
const MAX_FACES = 512;

interface BoxLook {
  colour: Rgb;
  shown: boolean;
  pale: boolean;
  selected: boolean;
  filled: boolean;
}

export class BoxDrawing {
  readonly object = new THREE.Group();
  private readonly lines = new FatLines(1.6, 4096);
  private readonly strong = new FatLines(3, 64);
  private readonly faces: THREE.InstancedMesh;
  private readonly matrix = new THREE.Matrix4();
  private readonly turn = new THREE.Quaternion();
  private readonly colour = new THREE.Color();

  constructor() {
    this.faces = new THREE.InstancedMesh(
      CUBE,
      new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.14, depthWrite: false }),
      MAX_FACES,
    );
    this.faces.frustumCulled = false;
    this.faces.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    this.strong.object.renderOrder = 2;
    this.object.add(this.lines.object, this.strong.object, this.faces);
  }

  draw(boxes: Box[], lookOf: (box: Box, k: number) => BoxLook, background: Rgb): void {
    this.lines.begin();
    this.strong.begin();
    let filled = 0;
    boxes.forEach((box, k) => {
      const look = lookOf(box, k);
      if (!look.shown) return;
      const colour = look.pale ? mixed(look.colour, background, 0.68) : look.colour;
      const lines = look.selected ? this.strong : this.lines;
      outline(lines, box.box, colour);
      if ((look.filled || look.selected) && filled < MAX_FACES) {
        const [x, y, z, l, w, h, yaw] = box.box;
        this.turn.setFromAxisAngle(UP, yaw);
        this.matrix.compose(new THREE.Vector3(x, y, z), this.turn, new THREE.Vector3(l, w, h));
        this.faces.setMatrixAt(filled, this.matrix);
        this.colour.setRGB(colour[0] / 255, colour[1] / 255, colour[2] / 255, THREE.SRGBColorSpace);
        this.faces.setColorAt(filled, this.colour);
        filled++;
      }
    });
    this.lines.end();
    this.strong.end();
    this.faces.count = filled;
    this.faces.visible = filled > 0;
    this.faces.instanceMatrix.needsUpdate = true;
    if (this.faces.instanceColor) this.faces.instanceColor.needsUpdate = true;
  }
}

const UP = new THREE.Vector3(0, 0, 1);

function outline(lines: FatLines, box: Box["box"], colour: Rgb): void {
  const corners = cornersOf(box);
  for (const [a, b] of EDGES) lines.add(corners[a]!, corners[b]!, colour);
  // A line on the floor from the middle to beyond the front tells which way it faces.
  const [x, y, z, l, , h, yaw] = box;
  const floor = z - h / 2;
  const at = (d: number): Point3 => [x + d * Math.cos(yaw), y + d * Math.sin(yaw), floor];
  lines.add(at(0), at(l / 2 + Math.min(1.2, 0.4 * l)), colour);
}

function mixed(a: Rgb, b: Rgb, share: number): Rgb {
  return [
    Math.round(a[0] + share * (b[0] - a[0])),
    Math.round(a[1] + share * (b[1] - a[1])),
    Math.round(a[2] + share * (b[2] - a[2])),
  ];
}
