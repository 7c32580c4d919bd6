// The section plane: what lies beyond it is cut away; it is dragged by its handle.

import * as THREE from "three";

import type { View } from "./view_state";

const SIZE_M = 40;

export class SectionPlane {
  readonly object = new THREE.Group();
  readonly handle: THREE.Mesh;
  /** normal · p = w: beyond it is cut. */
  readonly cut = new THREE.Vector4(0, 0, 0, 1);
  readonly normal = new THREE.Vector3(1, 0, 0);
  readonly clipping: THREE.Plane[] = [];
  private readonly frame: THREE.LineLoop;
  private readonly material = new THREE.LineBasicMaterial();
  private readonly knob = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });

  constructor() {
    const h = SIZE_M / 2;
    const corners = [-h, -h, 0, h, -h, 0, h, h, 0, -h, h, 0];
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    this.frame = new THREE.LineLoop(geometry, this.material);
    this.handle = new THREE.Mesh(new THREE.ConeGeometry(0.5, 1.4, 20), this.knob);
    this.handle.rotation.x = Math.PI / 2;
    this.handle.renderOrder = 3;
    this.object.add(this.frame, this.handle);
    this.object.visible = false;
  }

  setColour(colour: THREE.Color): void {
    this.material.color.copy(colour);
    this.knob.color.copy(colour);
  }

  /** Places the plane as the view says; `middle` is what people look at. */
  update(view: View, middle: THREE.Vector3, eye: THREE.Vector3): void {
    this.object.visible = view.section;
    if (view.section_level) this.normal.set(0, 0, 1);
    else {
      const turn = (view.section_turn_deg * Math.PI) / 180;
      this.normal.set(Math.cos(turn), Math.sin(turn), 0);
    }
    this.clipping.length = 0;
    if (!view.section) {
      this.cut.set(0, 0, 0, 1);
      return;
    }
    this.cut.set(this.normal.x, this.normal.y, this.normal.z, view.section_at_m);
    this.clipping.push(new THREE.Plane(this.normal.clone().negate(), view.section_at_m));
    if (view.section_thick_m > 0) {
      const back = view.section_thick_m - view.section_at_m;
      this.clipping.push(new THREE.Plane(this.normal.clone(), back));
    }
    // The frame stands around what people look at, moved along the normal onto the plane.
    const off = view.section_at_m - this.normal.dot(middle);
    this.object.position.copy(middle).addScaledVector(this.normal, off);
    this.object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), this.normal);
    const scale = Math.max(0.4, eye.distanceTo(this.object.position) / 40);
    this.handle.scale.setScalar(scale);
  }

  /** How far the plane is after a drag: where a ray comes nearest to the line through the handle. */
  draggedTo(ray: THREE.Ray): number {
    const from = this.object.position;
    const w = new THREE.Vector3().subVectors(from, ray.origin);
    const b = this.normal.dot(ray.direction);
    const denominator = 1 - b * b;
    if (denominator < 1e-4) return this.cut.w;
    const along = (b * ray.direction.dot(w) - this.normal.dot(w)) / denominator;
    return this.normal.dot(from) + along;
  }

  /** Whether a place is cut away. */
  hides(x: number, y: number, z: number, thick: number): boolean {
    const { cut } = this;
    const beyond = cut.x * x + cut.y * y + cut.z * z - cut.w;
    return beyond > 0 || (thick > 0 && beyond < -thick);
  }
}
