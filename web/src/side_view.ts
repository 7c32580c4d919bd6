// One side as it is seen: its points and boxes of the frame that is shown.

import * as THREE from "three";

import { contains } from "./box_geometry";
import { BoxDrawing } from "./boxes";
import { boxColours, sideColours, type Table, type Theme } from "./colour";
import type { Point3, Rgb, Scene, Side } from "./document";
import { passes } from "./filters";
import { PointFrame, type Box } from "./frame_data";
import { GroundFinder } from "./ground";
import type { Packet } from "./packet";
import { MARK, PointCloud } from "./points";
import {
  domainFor,
  fillQuantity,
  isCategorical,
  sensorOrigins,
  tableFor,
  type Quantity,
} from "./quantity";
import { inLayer, layerOf } from "./stage";
import { verdictsAt, type Verdict } from "./verdicts";
import type { View } from "./view_state";

const VERDICT_COLOURS: Record<Theme, Record<Verdict, Rgb>> = {
  dark: { hit: [72, 207, 134], miss: [255, 110, 150], "false alarm": [255, 168, 66] },
  light: { hit: [16, 140, 78], miss: [200, 28, 92], "false alarm": [196, 98, 0] },
};

/** What a selection names a box by: its track, or its place among boxes that have none. */
export const keyOf = (box: Box, k: number): number =>
  box.score === null && box.track >= 0 ? box.track : -2 - k;

export class SideView {
  readonly frame = new PointFrame();
  readonly cloud = new PointCloud();
  readonly drawing = new BoxDrawing();
  readonly object = new THREE.Group();
  boxes: Box[] = [];
  verdicts: (Verdict | null)[] = [];
  table: Table = new Uint8Array(1024);
  domain: [number, number] = [0, 1];
  private readonly ground: GroundFinder;
  private readonly grounds = { bytes: new Uint8Array(0), known: false };
  private readonly origins: Point3[];

  constructor(
    readonly scene: Scene,
    readonly side: Side,
    readonly number: number,
  ) {
    this.ground = new GroundFinder(scene);
    this.origins = sensorOrigins(scene);
    this.object.add(this.cloud.object, this.drawing.object);
    inLayer(this.object, layerOf(number));
  }

  /** The packets that a frame of this side needs. */
  packets(frame: number): string[] {
    const entry = this.side.frames[frame];
    if (entry === undefined || entry.error !== null) return [];
    const names: string[] = [];
    if (this.side.point_packet) names.push(`points/${this.number}/${frame}`);
    if (this.side.box_packet) names.push(`boxes/${this.number}/${frame}`);
    return names;
  }

  load(points: Packet | undefined, boxes: Packet | undefined): void {
    this.grounds.known = false;
    if (points === undefined) this.frame.clear();
    else {
      this.frame.load(points);
      this.cloud.load(this.frame);
    }
    this.boxes = ((boxes?.header["boxes"] ?? []) as Box[]).map((box) => ({
      ...box,
      track: box.track ?? -1,
      score: box.score ?? null,
      points: box.points ?? null,
      occlusion: box.occlusion ?? null,
      verdict: box.verdict ?? null,
      ignored: box.ignored ?? null,
    }));
  }

  /** Fills what the points are coloured by. */
  colour(quantity: Quantity, theme: Theme, domain: [number, number] | null): void {
    if (this.frame.count === 0) return;
    const { cloud, frame } = this;
    fillQuantity(cloud.value, frame, quantity, this.number, this.origins, this.scene.ground_z);
    cloud.valuesChanged(frame.count);
    this.domain = domain ?? domainFor(quantity, this.scene, cloud.value, frame.count);
    this.table = tableFor(quantity, this.scene, theme);
    cloud.setTable(this.table, isCategorical(quantity), this.domain);
  }

  /** Marks what is hidden and what belongs to the selected box. */
  mark(view: View): void {
    const { frame, cloud } = this;
    const { count } = frame;
    const { mark } = cloud;
    if (count === 0) return;
    mark.fill(MARK.plain, 0, count);
    if (!view.ground) {
      const ground = this.groundBytes();
      for (let k = 0; k < count; k++) if (ground[k] === 1) mark[k] = MARK.hidden;
    }
    const semantic = frame.fields.get("semantic");
    if (view.hidden.length > 0 && semantic !== undefined) {
      const hidden = new Uint8Array(256);
      for (const id of view.hidden) hidden[id & 255] = 1;
      for (let k = 0; k < count; k++) if (hidden[semantic[k]! & 255] === 1) mark[k] = MARK.hidden;
    }
    const selected = this.selectedBox(view);
    if (selected !== undefined) {
      const { position } = frame;
      for (let k = 0; k < count; k++) {
        const at = 3 * k;
        if (contains(selected.box, position[at]!, position[at + 1]!, position[at + 2]!)) {
          if (mark[k] === MARK.plain) mark[k] = MARK.bright;
        }
      }
    }
    cloud.marksChanged(count);
  }

  private groundBytes(): Uint8Array {
    if (!this.grounds.known) {
      if (this.grounds.bytes.length < this.frame.count) {
        this.grounds.bytes = new Uint8Array(this.frame.position.length / 3);
      }
      this.ground.mark(this.grounds.bytes, this.frame);
      this.grounds.known = true;
    }
    return this.grounds.bytes;
  }

  selectedIndex(view: View): number {
    if (view.selected === null || view.selected_side !== this.number) return -1;
    return this.boxes.findIndex((box, k) => keyOf(box, k) === view.selected);
  }

  selectedBox(view: View): Box | undefined {
    return this.boxes[this.selectedIndex(view)];
  }

  /** Whether a box is drawn and can be clicked. */
  shows(box: Box, k: number, view: View): boolean {
    if (keyOf(box, k) === view.selected && view.selected_side === this.number) return true;
    if (box.score !== null) {
      return (
        view.layers.detections && box.score >= view.score && passes(box, view.filters, this.origins)
      );
    }
    if (!view.layers.boxes) return false;
    if (box.ignored && !view.layers.ignored) return false;
    return passes(box, view.filters, this.origins);
  }

  drawBoxes(view: View, theme: Theme, background: Rgb, accent: Rgb): void {
    this.verdicts = verdictsAt(this.boxes, view.score);
    const colourOf = boxColours(this.scene, theme);
    const verdictColour = VERDICT_COLOURS[theme];
    const overlaid = view.arrangement === "over" && this.scene.sides.length > 1;
    const sideColour = sideColours(theme)[this.number] ?? [128, 128, 128];
    const judged = this.scene.detections && view.layers.detections;
    const selected = this.selectedIndex(view);
    this.drawing.draw(
      this.boxes,
      (box, k) => {
        const verdict = this.verdicts[k];
        let colour = overlaid ? sideColour : colourOf(box.class);
        if (judged && verdict) colour = verdictColour[verdict];
        const label = box.score === null;
        if (k === selected) colour = accent;
        return {
          colour,
          shown: this.shows(box, k, view),
          pale: k !== selected && (Boolean(box.ignored) || (judged && label && verdict === "hit")),
          selected: k === selected,
          filled: !this.side.point_packet || (judged && verdict === "miss" && label),
        };
      },
      background,
    );
  }

  /** The colour that a point is drawn in. */
  colourOfPoint(k: number, categorical: boolean): Rgb {
    const value = this.cloud.value[k] ?? 0;
    const [low, high] = this.domain;
    const share = categorical ? value / 255 : (value - low) / (high - low);
    const at = 4 * Math.round(255 * Math.min(1, Math.max(0, share)));
    return [this.table[at]!, this.table[at + 1]!, this.table[at + 2]!];
  }
}
