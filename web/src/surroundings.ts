// What stands still around the frames: the twin, its lanes and signals, the sensors, coverage, a grid.

import * as THREE from "three";

import type { Theme } from "./colour";
import { CoverageDrawing } from "./coverage";
import type { Scene } from "./document";
import { LaneDrawing } from "./lanes";
import type { Packet } from "./packet";
import type { PacketCache } from "./packet_cache";
import { SensorDrawing } from "./sensors";
import { SignalDrawing } from "./signals";
import { groundGrid } from "./stage";
import { TwinDrawing } from "./twin";
import type { Layer, View } from "./view_state";

export class Surroundings {
  readonly object = new THREE.Group();
  twin: TwinDrawing | null = null;
  signals: SignalDrawing | null = null;
  coverage: CoverageDrawing | null = null;
  readonly sensors: SensorDrawing;
  private readonly grid: THREE.GridHelper;
  private lanes: LaneDrawing | null = null;
  private readonly asked = new Set<string>();
  private theme: Theme = "dark";

  constructor(
    private readonly scene: Scene,
    private readonly cache: PacketCache,
    private readonly changed: () => void,
    private readonly tell: (sentence: string) => void,
  ) {
    this.sensors = new SensorDrawing(scene.sensors);
    this.grid = groundGrid(scene.ground_z);
    this.object.add(this.sensors.object, this.grid);
  }

  /** The layers that there is something for. */
  get offered(): Layer[] {
    const { twin } = this.scene;
    const layers: Layer[] = [];
    if (twin !== null) layers.push("twin");
    if (twin?.lanes) layers.push("lanes");
    if (twin?.lanes && twin.signals) layers.push("signals");
    if (this.scene.sensors.length > 0) layers.push("sensors");
    if (twin?.coverage) layers.push("coverage");
    return [...layers, "grid"];
  }

  /** Shows what the view asks for; fetches it the first time. */
  show(view: View, time_s: number): void {
    const { layers } = view;
    const { twin } = this.scene;
    this.grid.visible = layers.grid && !layers.twin;
    this.sensors.object.visible = layers.sensors && view.eye !== "sensor";
    if (twin !== null && layers.twin) {
      this.fetch(twin.packet, (packet) => {
        this.twin = new TwinDrawing(packet);
        return this.twin.object;
      });
    }
    if (twin?.lanes && (layers.lanes || (layers.signals && twin.signals))) {
      this.fetch(twin.lanes, (packet) => {
        this.lanes = new LaneDrawing(packet);
        this.signals = new SignalDrawing(packet);
        return [this.lanes.object, this.signals.object];
      });
    }
    if (twin?.coverage && layers.coverage) {
      this.fetch(twin.coverage.packet, (packet) => {
        this.coverage = new CoverageDrawing(packet);
        this.coverage.setTheme(this.theme);
        return this.coverage.object;
      });
    }
    if (this.twin) this.twin.object.visible = layers.twin;
    if (this.lanes) this.lanes.object.visible = layers.lanes;
    if (this.signals) {
      this.signals.object.visible = layers.signals;
      if (layers.signals) this.signals.show(time_s);
    }
    if (this.coverage) this.coverage.object.visible = layers.coverage;
  }

  /** Cuts the twin and what lies on its ground by planes. */
  cut(planes: THREE.Plane[]): void {
    for (const part of [this.twin, this.lanes, this.coverage]) {
      part?.object.traverse((one: THREE.Object3D) => {
        const { material } = one as THREE.Mesh;
        for (const each of [material ?? []].flat()) each.clippingPlanes = planes;
      });
    }
  }

  setTheme(theme: Theme, line: THREE.Color, accent: THREE.Color): void {
    this.theme = theme;
    (this.grid.material as THREE.LineBasicMaterial).color.copy(line);
    this.sensors.setColour(accent);
    this.coverage?.setTheme(theme);
  }

  private fetch(name: string, make: (packet: Packet) => THREE.Object3D | THREE.Object3D[]): void {
    if (this.asked.has(name)) return;
    this.asked.add(name);
    this.cache
      .get(name)
      .then((packet) => {
        this.object.add(...[make(packet)].flat());
        this.changed();
      })
      .catch((error: Error) => this.tell(error.message));
  }
}
