// The static scene as triangles in the colours of their materials.

import * as THREE from "three";

import type { Rgb } from "./document";
import type { Packet } from "./packet";

interface Group {
  class: string;
  material: string;
  colour: Rgb;
  first: number;
  count: number;
}

/** Returns the positions of a packet with its origin added. */
export function placed(packet: Packet, name = "position"): Float32Array {
  const data = packet.arrays.get(name)?.data;
  if (data === undefined) throw new Error(`The packet has no array “${name}”.`);
  const position = Float32Array.from(data);
  const origin = (packet.header["origin"] as number[] | undefined) ?? [0, 0, 0];
  const step = (packet.header["step"] as number | undefined) ?? 1;
  for (let k = 0; k < position.length; k++) position[k] = origin[k % 3]! + step * position[k]!;
  return position;
}

export class TwinDrawing {
  readonly object: THREE.Mesh;
  readonly triangles: number;

  constructor(packet: Packet) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(placed(packet), 3));
    const index = packet.arrays.get("index");
    if (index === undefined) throw new Error("The twin has no triangles.");
    geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(index.data), 1));
    this.triangles = index.data.length / 3;
    const materials: THREE.MeshLambertMaterial[] = [];
    const numbers = new Map<string, number>();
    for (const group of (packet.header["groups"] ?? []) as Group[]) {
      const key = group.colour.join();
      let number = numbers.get(key);
      if (number === undefined) {
        number = materials.length;
        numbers.set(key, number);
        const [r, g, b] = group.colour;
        materials.push(
          new THREE.MeshLambertMaterial({
            color: new THREE.Color().setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace),
            side: THREE.DoubleSide,
            flatShading: true,
            // Points that lie on a surface are seen, not lost in it.
            polygonOffset: true,
            polygonOffsetFactor: 2,
            polygonOffsetUnits: 4,
          }),
        );
      }
      geometry.addGroup(3 * group.first, 3 * group.count, number);
    }
    this.object = new THREE.Mesh(geometry, materials);
  }

  get bounds(): THREE.Box3 {
    this.object.geometry.computeBoundingBox();
    return this.object.geometry.boundingBox!;
  }
}
