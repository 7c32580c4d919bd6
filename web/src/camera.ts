// The eyes: round a place, from above, from a sensor, behind an actor.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

import type { Sensor } from "./document";
import type { Box } from "./frame_data";
import type { EyeMode } from "./view_state";

const ABOVE_FOV = 12; // nearly parallel, so that a plan looks like a plan

export class Eyes {
  readonly camera = new THREE.PerspectiveCamera(50, 1, 0.1, 4000);
  readonly controls: OrbitControls;
  mode: EyeMode = "orbit";
  private yaw = 0; // where one looks, from a sensor
  private pitch = 0;
  private sensorTurn = new THREE.Quaternion();
  private last: { position: THREE.Vector3; yaw: number; track: number } | null = null;
  private glide: { position: THREE.Vector3; target: THREE.Vector3 } | null = null;
  private dragged: { x: number; y: number } | null = null;

  constructor(
    private readonly surface: HTMLElement,
    readonly changed: () => void,
  ) {
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, surface);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.16;
    this.controls.zoomToCursor = true;
    this.controls.screenSpacePanning = false;
    this.controls.maxPolarAngle = Math.PI * 0.97;
    this.controls.maxDistance = 2500;
    this.controls.addEventListener("change", changed);
    this.controls.addEventListener("start", () => (this.glide = null));
    surface.addEventListener("pointerdown", (event) => this.lookStart(event));
    surface.addEventListener("pointermove", (event) => this.lookMove(event));
    for (const name of ["pointerup", "pointercancel"]) {
      surface.addEventListener(name, () => (this.dragged = null));
    }
    surface.addEventListener("wheel", (event) => this.lookZoom(event), { passive: false });
  }

  get target(): THREE.Vector3 {
    return this.controls.target;
  }

  place(position: [number, number, number], target: [number, number, number], fov: number): void {
    this.glide = null;
    this.camera.position.set(...position);
    this.controls.target.set(...target);
    this.camera.fov = fov;
    this.camera.updateProjectionMatrix();
    if (this.mode === "sensor") this.lookAtTarget();
    else this.controls.update();
    this.changed();
  }

  /** Looks at a place from a distance, moving there within a moment. */
  goTo(target: THREE.Vector3, distance: number): void {
    if (this.mode === "sensor") return;
    const direction = new THREE.Vector3().subVectors(this.camera.position, this.controls.target);
    if (direction.lengthSq() < 1e-6) direction.set(-1, -1, 1);
    const factor = this.mode === "above" ? 4 : 1;
    direction.setLength(distance * factor);
    this.glide = { position: target.clone().add(direction), target: target.clone() };
    this.changed();
  }

  orbit(fov = 50): void {
    const leaving = this.mode;
    this.mode = "orbit";
    this.last = null;
    this.camera.up.set(0, 0, 1);
    this.controls.enabled = true;
    this.controls.enableRotate = true;
    this.controls.mouseButtons.LEFT = THREE.MOUSE.ROTATE;
    this.controls.touches.ONE = THREE.TOUCH.ROTATE;
    this.setFov(fov);
    if (leaving === "above" || leaving === "sensor") {
      const distance = leaving === "above" ? this.distance() * 0.22 : 30;
      if (leaving === "sensor") this.controls.target.copy(this.ahead(25));
      const back = new THREE.Vector3(-0.62, -0.62, 0.48).multiplyScalar(Math.max(8, distance));
      this.camera.position.copy(this.controls.target).add(back);
    }
    this.controls.update();
    this.changed();
  }

  above(): void {
    const height = this.mode === "above" ? this.distance() : Math.max(160, this.distance() * 4.4);
    if (this.mode === "sensor") this.controls.target.copy(this.ahead(20));
    this.mode = "above";
    this.glide = null;
    this.controls.enabled = true;
    this.controls.enableRotate = false;
    this.controls.mouseButtons.LEFT = THREE.MOUSE.PAN;
    this.controls.touches.ONE = THREE.TOUCH.PAN;
    this.setFov(ABOVE_FOV);
    const { target } = this.controls;
    // A hair south of overhead, so that north is up.
    this.camera.position.set(target.x, target.y - height * 1e-4, target.z + height);
    this.controls.update();
    this.changed();
  }

  fromSensor(sensor: Sensor, fov = 70): void {
    this.mode = "sensor";
    this.glide = null;
    this.controls.enabled = false;
    const p = sensor.pose;
    const matrix = new THREE.Matrix4();
    // prettier-ignore
    matrix.set(...(p.slice(0, 16) as Parameters<THREE.Matrix4["set"]>));
    this.camera.position.setFromMatrixPosition(matrix);
    this.sensorTurn.setFromRotationMatrix(matrix);
    this.yaw = this.pitch = 0;
    this.setFov(fov);
    this.look();
  }

  /** Stands behind an actor; from then on `carry` keeps the camera there. */
  chase(box: Box): void {
    if (this.mode === "sensor") this.orbit();
    this.mode = "chase";
    this.controls.enabled = true;
    this.controls.enableRotate = true;
    this.controls.mouseButtons.LEFT = THREE.MOUSE.ROTATE;
    this.controls.touches.ONE = THREE.TOUCH.ROTATE;
    this.setFov(60);
    const [x, y, z, l, , h, yaw] = box.box;
    const back = Math.max(7, 2.2 * l);
    this.controls.target.set(x, y, z + h / 2);
    this.camera.position.set(
      x - back * Math.cos(yaw),
      y - back * Math.sin(yaw),
      z + h / 2 + 0.45 * back,
    );
    this.last = { position: new THREE.Vector3(x, y, z), yaw, track: box.track };
    this.controls.update();
    this.changed();
  }

  /** Moves with an actor from frame to frame; turns with it, too, when the eye chases it. */
  carry(box: Box | undefined): void {
    if (box === undefined || this.mode === "sensor") {
      this.last = null;
      return;
    }
    const [x, y, z, , , , yaw] = box.box;
    const now = new THREE.Vector3(x, y, z);
    if (this.last !== null && this.last.track === box.track) {
      const move = new THREE.Vector3().subVectors(now, this.last.position);
      this.camera.position.add(move);
      this.controls.target.add(move);
      if (this.mode === "chase") {
        const turn = Math.atan2(Math.sin(yaw - this.last.yaw), Math.cos(yaw - this.last.yaw));
        const arm = new THREE.Vector3().subVectors(this.camera.position, this.controls.target);
        arm.applyAxisAngle(this.camera.up, turn);
        this.camera.position.copy(this.controls.target).add(arm);
      }
      this.changed();
    }
    this.last = { position: now, yaw, track: box.track };
  }

  /** Called for every picture; returns whether the camera still moves. */
  update(elapsed_s: number): boolean {
    if (this.glide !== null) {
      const share = 1 - Math.exp(-9 * elapsed_s);
      this.camera.position.lerp(this.glide.position, share);
      this.controls.target.lerp(this.glide.target, share);
      if (this.camera.position.distanceTo(this.glide.position) < 0.02) this.glide = null;
      this.controls.update();
      return true;
    }
    return this.mode === "sensor" ? false : this.controls.update();
  }

  setFov(fov: number): void {
    this.camera.fov = fov;
    this.camera.updateProjectionMatrix();
  }

  distance(): number {
    return this.camera.position.distanceTo(this.controls.target);
  }

  private ahead(distance: number): THREE.Vector3 {
    const direction = this.camera.getWorldDirection(new THREE.Vector3());
    return this.camera.position.clone().addScaledVector(direction, distance);
  }

  /** Turns the camera from the sensor's x axis by yaw and pitch, its horizon as the sensor's. */
  private look(): void {
    const local = new THREE.Vector3(
      Math.cos(this.pitch) * Math.cos(this.yaw),
      Math.cos(this.pitch) * Math.sin(this.yaw),
      Math.sin(this.pitch),
    );
    const direction = local.applyQuaternion(this.sensorTurn);
    this.controls.target.copy(this.camera.position).add(direction);
    this.camera.up.set(0, 0, 1);
    this.camera.lookAt(this.controls.target);
    this.changed();
  }

  private lookAtTarget(): void {
    const direction = new THREE.Vector3().subVectors(this.controls.target, this.camera.position);
    direction.normalize().applyQuaternion(this.sensorTurn.clone().invert());
    this.yaw = Math.atan2(direction.y, direction.x);
    this.pitch = Math.asin(Math.max(-1, Math.min(1, direction.z)));
    this.look();
  }

  private lookStart(event: PointerEvent): void {
    if (this.mode === "sensor") this.dragged = { x: event.clientX, y: event.clientY };
  }

  private lookMove(event: PointerEvent): void {
    if (this.dragged === null || this.mode !== "sensor") return;
    const perPixel = ((this.camera.fov / 180) * Math.PI) / this.surface.clientHeight;
    this.yaw += (event.clientX - this.dragged.x) * perPixel;
    this.pitch += (event.clientY - this.dragged.y) * perPixel;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch));
    this.dragged = { x: event.clientX, y: event.clientY };
    this.look();
  }

  private lookZoom(event: WheelEvent): void {
    if (this.mode !== "sensor") return;
    event.preventDefault();
    this.setFov(Math.max(8, Math.min(110, this.camera.fov * Math.exp(event.deltaY * 0.001))));
    this.changed();
  }
}
