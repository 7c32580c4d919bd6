// The pointer over the picture: a click selects or measures, a drag of the handle moves the section.

import * as THREE from "three";

import type { App } from "./app";
import type { Point3 } from "./document";
import { MARK } from "./points";
import { rayHits } from "./box_geometry";
import { boxOfPoint, pickBox, pickPoint } from "./pick";
import { keyOf, type SideView } from "./side_view";
import type { Viewport } from "./stage";

const CLICK_PX = 6;
const HANDLE_PX = 18;
const PAST_POLES_PX = 12;
const BEHIND_WALL_M = 0.8; // points scatter about the surfaces that they lie on

export class Pointer {
  private down: { x: number; y: number; id: number } | null = null;
  private dragging = false;
  private readonly active = new Set<number>();

  constructor(
    private readonly app: App,
    private readonly surface: HTMLElement,
  ) {
    // Before the camera's own listeners: a drag of the handle is none of its business.
    surface.addEventListener("pointerdown", (event) => this.start(event), { capture: true });
    surface.addEventListener("pointermove", (event) => this.move(event), { capture: true });
    surface.addEventListener("pointerup", (event) => this.end(event), { capture: true });
    surface.addEventListener("pointercancel", (event) => this.cancel(event), { capture: true });
    surface.addEventListener("dblclick", () => app.lookAtSelected());
  }

  private at(event: PointerEvent): [number, number] {
    const box = this.surface.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  private start(event: PointerEvent): void {
    this.active.add(event.pointerId);
    const [x, y] = this.at(event);
    this.down = this.active.size === 1 && event.button === 0 ? { x, y, id: event.pointerId } : null;
    if (this.down !== null && this.app.view.section && this.onHandle(x, y)) {
      this.dragging = true;
      this.app.eyes.controls.enabled = false;
      this.surface.setPointerCapture(event.pointerId);
      event.stopImmediatePropagation();
    }
  }

  private move(event: PointerEvent): void {
    const [x, y] = this.at(event);
    if (this.dragging) {
      const { app } = this;
      const ray = app.stage.rayAt(x, y, app.eyes.camera);
      const at = app.sectionPlane.draggedTo(ray);
      if (Number.isFinite(at)) app.store.set({ section_at_m: Math.round(at * 100) / 100 });
      event.stopImmediatePropagation();
      return;
    }
    const { measure, view } = this.app;
    this.surface.style.cursor = measure.on
      ? "crosshair"
      : view.section && this.onHandle(x, y)
        ? "grab"
        : "";
  }

  private end(event: PointerEvent): void {
    this.active.delete(event.pointerId);
    const [x, y] = this.at(event);
    const { down } = this;
    this.down = null;
    if (this.dragging) {
      this.dragging = false;
      this.app.eyes.controls.enabled = this.app.view.eye !== "sensor";
      event.stopImmediatePropagation();
      return;
    }
    if (down === null || down.id !== event.pointerId) return;
    const reach = event.pointerType === "touch" ? 2 * CLICK_PX : CLICK_PX;
    if (Math.hypot(x - down.x, y - down.y) > reach) return;
    this.click(x, y, event.pointerType === "touch" ? 16 : 8);
  }

  private cancel(event: PointerEvent): void {
    this.active.delete(event.pointerId);
    this.down = null;
    this.dragging = false;
  }

  private onHandle(x: number, y: number): boolean {
    const { stage, eyes, sectionPlane } = this.app;
    const viewport = stage.at(x, y);
    const matrix = stage.matrixOf(viewport, eyes.camera);
    const { x: px, y: py, z: pz } = sectionPlane.object.position;
    const p = new THREE.Vector4(px, py, pz, 1).applyMatrix4(matrix);
    if (p.w <= 0) return false;
    const sx = viewport.x + ((p.x / p.w + 1) * viewport.width) / 2;
    const sy = viewport.y + ((1 - p.y / p.w) * viewport.height) / 2;
    return Math.hypot(sx - x, sy - y) < HANDLE_PX;
  }

  private sidesIn(viewport: Viewport): SideView[] {
    return this.app.sides.filter((side) => viewport.side < 0 || side.number === viewport.side);
  }

  private click(x: number, y: number, radius: number): void {
    const { app } = this;
    const viewport = app.stage.at(x, y);
    const matrix = app.stage.matrixOf(viewport, app.eyes.camera);
    const ray = app.stage.rayAt(x, y, app.eyes.camera);
    const wall = this.wallUnder(ray);
    const reach = this.reachAt(x, y, wall);
    const point = this.pointUnder(viewport, matrix, x, y, radius, reach);
    if (app.measure.on) {
      const place =
        point === null ? this.surfaceUnder(ray, wall) : this.placeOf(point.side, point.index);
      if (place !== null) app.measure.take(place);
      app.invalidate();
      return;
    }
    app.place = null;
    app.picked = point === null ? null : { side: point.side.number, index: point.index };
    if (point !== null) {
      const { side, index } = point;
      const own = boxOfPoint(side.boxes, side.frame, index);
      if (own >= 0) {
        app.select(keyOf(side.boxes[own]!, own), side.number);
        app.invalidate();
        return;
      }
    }
    const origin = ray.origin.toArray() as Point3;
    const direction = ray.direction.toArray() as Point3;
    for (const side of this.sidesIn(viewport)) {
      const hit = pickBox(side.boxes, origin, direction, (box, k) => {
        return !side.shows(box, k, app.view) || rayHits(box.box, origin, direction) > reach;
      });
      if (hit >= 0) {
        app.select(keyOf(side.boxes[hit]!, hit), side.number);
        app.invalidate();
        return;
      }
    }
    app.select(null);
    app.invalidate();
  }

  private pointUnder(
    viewport: Viewport,
    matrix: THREE.Matrix4,
    x: number,
    y: number,
    radius: number,
    reach: number,
  ): { side: SideView; index: number } | null {
    const { view, sectionPlane, eyes } = this.app;
    const eye = eyes.camera.position;
    if (!view.layers.points) return null;
    for (const side of this.sidesIn(viewport)) {
      const { position } = side.frame;
      const { mark } = side.cloud;
      const index = pickPoint(
        side.frame,
        matrix.elements,
        viewport.width,
        viewport.height,
        x - viewport.x,
        y - viewport.y,
        radius,
        (k) =>
          mark[k] === MARK.hidden ||
          Math.hypot(
            position[3 * k]! - eye.x,
            position[3 * k + 1]! - eye.y,
            position[3 * k + 2]! - eye.z,
          ) > reach ||
          (view.section &&
            sectionPlane.hides(
              position[3 * k]!,
              position[3 * k + 1]!,
              position[3 * k + 2]!,
              view.section_thick_m,
            )),
      );
      if (index >= 0) return { side, index };
    }
    return null;
  }

  private placeOf(side: SideView, k: number): Point3 {
    const { position } = side.frame;
    return [position[3 * k]!, position[3 * k + 1]!, position[3 * k + 2]!];
  }

  /** How far one sees at a place of the picture: past poles and twigs, not past walls. */
  private reachAt(x: number, y: number, wall: THREE.Vector3 | null): number {
    const { stage, eyes } = this.app;
    const places = [wall];
    for (const aside of wall === null ? [] : [-PAST_POLES_PX, PAST_POLES_PX]) {
      places.push(this.wallUnder(stage.rayAt(x + aside, y, eyes.camera)));
    }
    const eye = eyes.camera.position;
    return Math.max(
      ...places.map((place) => (place === null ? Infinity : place.distanceTo(eye) + BEHIND_WALL_M)),
    );
  }

  /** Where a ray first meets what is seen of the twin. */
  private wallUnder(ray: THREE.Ray): THREE.Vector3 | null {
    const { surroundings, sectionPlane, view } = this.app;
    const { twin } = surroundings;
    if (twin === null || !twin.object.visible) return null;
    const hits = new THREE.Raycaster(ray.origin, ray.direction).intersectObject(twin.object);
    const seen = hits.find(
      ({ point: { x, y, z } }) =>
        !view.section || !sectionPlane.hides(x, y, z, view.section_thick_m),
    );
    return seen?.point ?? null;
  }

  /** Where a ray meets the twin, else the ground's level. */
  private surfaceUnder(ray: THREE.Ray, wall: THREE.Vector3 | null): Point3 | null {
    const level = new THREE.Plane(new THREE.Vector3(0, 0, 1), -this.app.scene.ground_z);
    const place = wall ?? ray.intersectPlane(level, new THREE.Vector3());
    return place === null ? null : (place.toArray() as Point3);
  }
}
