// What is written over the picture: names of boxes, the point that was clicked, a measured distance.

import * as THREE from "three";

import type { App } from "./app";
import { boxColours, cssColour } from "./colour";
import type { Point3 } from "./document";
import type { Label } from "./overlay";
import { keyOf } from "./side_view";
import type { Viewport } from "./stage";

/** Draws names, marks and measured lines over the picture. */
export function drawOver(app: App): void {
  const { view, stage, sides } = app;
  const colourOf = boxColours(app.scene, app.theme);
  const labels: Label[] = [];
  for (const side of sides) {
    side.boxes.forEach((box, k) => {
      const chosen = keyOf(box, k) === view.selected && view.selected_side === side.number;
      if (!chosen && (!view.layers.names || !side.shows(box, k, view))) return;
      const [x, y, z, , , h] = box.box;
      const name = box.track >= 0 ? `${box.class} ${box.track}` : box.class;
      labels.push({
        at: [x, y, z + h / 2],
        text: box.score === null ? name : `${name} ${box.score.toFixed(2)}`,
        colour: cssColour(colourOf(box.class)),
        strong: chosen,
        side: side.number,
      });
    });
  }
  const viewports = stage.viewports.map((viewport: Viewport) => ({
    viewport,
    matrix: stage.matrixOf(viewport, app.eyes.camera),
    title: app.scene.sides[viewport.side]?.name ?? "",
  }));
  const { measure } = app;
  const line = measure.from ? { from: measure.from, to: measure.to, text: measure.text } : null;
  app.overlay.draw(viewports, labels, line, markedPlace(app), {
    paper: app.token("--panel"),
    ink: app.token("--text"),
    accent: app.token("--accent"),
  });
}

function markedPlace(app: App): Point3 | null {
  if (app.picked === null) return app.place;
  const { position } = app.sides[app.picked.side]!.frame;
  const at = 3 * app.picked.index;
  return [position[at]!, position[at + 1]!, position[at + 2]!];
}

/** Where a box's centre is drawn in the window, or null when it is not in this frame. */
export function placeInWindow(app: App, track: number): [number, number] | null {
  const viewport = app.stage.viewports.find((v) => v.side <= 0) ?? app.stage.viewports[0]!;
  const box = app.sides[Math.max(0, viewport.side)]?.boxes.find((one) => one.track === track);
  if (box === undefined) return null;
  const matrix = app.stage.matrixOf(viewport, app.eyes.camera);
  const p = new THREE.Vector4(box.box[0], box.box[1], box.box[2], 1).applyMatrix4(matrix);
  const canvas = app.stage.canvas.getBoundingClientRect();
  return [
    canvas.left + viewport.x + ((p.x / p.w + 1) * viewport.width) / 2,
    canvas.top + viewport.y + ((1 - p.y / p.w) * viewport.height) / 2,
  ];
}
