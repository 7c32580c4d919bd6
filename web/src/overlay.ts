// What is written over the picture: names of boxes, distances that were measured, marks.

import * as THREE from "three";

import type { Viewport } from "./stage";

export interface Label {
  at: [number, number, number];
  text: string;
  colour: string;
  strong: boolean;
  side: number; // -1: in every view
}

export interface MeasuredLine {
  from: [number, number, number];
  to: [number, number, number] | null;
  text: string;
}

export interface OverlayLook {
  paper: string;
  ink: string;
  accent: string;
}

export class Overlay {
  private readonly brush: CanvasRenderingContext2D;
  private ratio = 1;
  private readonly place = new THREE.Vector4();

  constructor(readonly canvas: HTMLCanvasElement) {
    this.brush = canvas.getContext("2d")!;
  }

  resize(width: number, height: number, ratio: number): void {
    this.ratio = ratio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
  }

  draw(
    viewports: { viewport: Viewport; matrix: THREE.Matrix4; title: string }[],
    labels: Label[],
    line: MeasuredLine | null,
    mark: [number, number, number] | null,
    look: OverlayLook,
  ): void {
    const { brush } = this;
    brush.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    brush.clearRect(0, 0, this.canvas.width, this.canvas.height);
    for (const { viewport, matrix, title } of viewports) {
      brush.save();
      brush.beginPath();
      brush.rect(viewport.x, viewport.y, viewport.width, viewport.height);
      brush.clip();
      brush.font = "500 11px ui-sans-serif, system-ui, sans-serif";
      brush.textBaseline = "middle";
      brush.textAlign = "center";
      for (const label of labels) {
        if (label.side >= 0 && viewport.side >= 0 && label.side !== viewport.side) continue;
        this.label(label, viewport, matrix, look);
      }
      if (mark !== null) this.mark(mark, viewport, matrix, look);
      if (line !== null) this.line(line, viewport, matrix, look);
      if (title !== "" && viewports.length > 1) this.title(title, viewport, look);
      brush.restore();
    }
    if (viewports.length === 2) this.border(viewports[1]!.viewport, look);
  }

  private project(
    at: [number, number, number],
    viewport: Viewport,
    matrix: THREE.Matrix4,
  ): [number, number] | null {
    const p = this.place.set(at[0], at[1], at[2], 1).applyMatrix4(matrix);
    if (p.w <= 0.05) return null;
    return [
      viewport.x + ((p.x / p.w + 1) * viewport.width) / 2,
      viewport.y + ((1 - p.y / p.w) * viewport.height) / 2,
    ];
  }

  private label(label: Label, viewport: Viewport, matrix: THREE.Matrix4, look: OverlayLook): void {
    const at = this.project(label.at, viewport, matrix);
    if (at === null) return;
    this.tag(label.text, at[0], at[1] - 12, look.paper, label.strong ? look.ink : label.colour);
  }

  private tag(text: string, x: number, y: number, paper: string, ink: string): void {
    const { brush } = this;
    const width = brush.measureText(text).width + 10;
    brush.globalAlpha = 0.86;
    brush.fillStyle = paper;
    brush.beginPath();
    brush.roundRect(x - width / 2, y - 9, width, 18, 4);
    brush.fill();
    brush.globalAlpha = 1;
    brush.fillStyle = ink;
    brush.fillText(text, x, y + 0.5);
  }

  private mark(
    at: [number, number, number],
    viewport: Viewport,
    matrix: THREE.Matrix4,
    look: OverlayLook,
  ): void {
    const place = this.project(at, viewport, matrix);
    if (place === null) return;
    const { brush } = this;
    brush.lineWidth = 2;
    for (const [colour, radius] of [
      [look.paper, 8],
      [look.accent, 6.5],
    ] as const) {
      brush.strokeStyle = colour;
      brush.beginPath();
      brush.arc(place[0], place[1], radius, 0, 2 * Math.PI);
      brush.stroke();
    }
  }

  private line(
    line: MeasuredLine,
    viewport: Viewport,
    matrix: THREE.Matrix4,
    look: OverlayLook,
  ): void {
    const { brush } = this;
    const from = this.project(line.from, viewport, matrix);
    const to = line.to === null ? null : this.project(line.to, viewport, matrix);
    if (from !== null && to !== null) {
      for (const [colour, width] of [
        [look.paper, 4],
        [look.accent, 2],
      ] as const) {
        brush.strokeStyle = colour;
        brush.lineWidth = width;
        brush.beginPath();
        brush.moveTo(...from);
        brush.lineTo(...to);
        brush.stroke();
      }
    }
    for (const end of [from, to]) {
      if (end === null) continue;
      brush.fillStyle = look.accent;
      brush.strokeStyle = look.paper;
      brush.lineWidth = 2;
      brush.beginPath();
      brush.arc(end[0], end[1], 4.5, 0, 2 * Math.PI);
      brush.fill();
      brush.stroke();
    }
    if (from !== null && to !== null) {
      this.tag(line.text, (from[0] + to[0]) / 2, (from[1] + to[1]) / 2 - 14, look.paper, look.ink);
    }
  }

  private title(title: string, viewport: Viewport, look: OverlayLook): void {
    this.brush.font = "600 12px ui-sans-serif, system-ui, sans-serif";
    this.tag(title, viewport.x + viewport.width / 2, viewport.y + 20, look.paper, look.ink);
  }

  private border(second: Viewport, look: OverlayLook): void {
    const { brush } = this;
    brush.strokeStyle = look.ink;
    brush.globalAlpha = 0.25;
    brush.lineWidth = 1;
    brush.beginPath();
    if (second.x > 0) {
      brush.moveTo(second.x + 0.5, second.y);
      brush.lineTo(second.x + 0.5, second.y + second.height);
    } else {
      brush.moveTo(0, second.y + 0.5);
      brush.lineTo(second.width, second.y + 0.5);
    }
    brush.stroke();
    brush.globalAlpha = 1;
  }
}
