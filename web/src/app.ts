// The page's heart: the view, the frames that are shown, and the picture of them.

import * as THREE from "three";

import { Eyes } from "./camera";
import type { Rgb, Scene, Sensor, Step } from "./document";
import { stepsOf } from "./document";
import { FilmRecorder } from "./film";
import type { Box } from "./frame_data";
import { Measure } from "./measure";
import { drawOver } from "./labels";
import { Overlay } from "./overlay";
import { PacketCache } from "./packet_cache";
import { PathDrawing, tracksOf, type Track } from "./paths";
import { isCategorical } from "./quantity";
import { SectionPlane } from "./section";
import { SideView } from "./side_view";
import type { Theme } from "./colour";
import { Stage } from "./stage";
import type { Source } from "./source";
import { StepLoader } from "./step_loader";
import { Surroundings } from "./surroundings";
import { PlayClock } from "./timeline";
import { homeOf } from "./home";
import { baseView } from "./base_view";
import { ViewStore, type View } from "./view_state";

export interface PickedPoint {
  side: number;
  index: number;
}

export class App {
  readonly steps: Step[];
  readonly base: View;
  readonly store: ViewStore;
  readonly cache: PacketCache;
  readonly clock: PlayClock;
  readonly loader: StepLoader;
  readonly sides: SideView[];
  readonly stage: Stage;
  readonly overlay: Overlay;
  readonly eyes: Eyes;
  readonly surroundings: Surroundings;
  readonly sectionPlane = new SectionPlane();
  readonly paths = new PathDrawing();
  readonly measure = new Measure();
  readonly film = new FilmRecorder();
  readonly errors: string[] = [];
  tracks = new Map<number, Track>();
  shownStep = -1;
  framesShown = 0; // data frames since the start
  picked: PickedPoint | null = null;
  place: [number, number, number] | null = null; // marked in the picture: a worst place
  theme: Theme = "dark";
  /** Called when what the panels say may have changed. */
  onUpdate: () => void = () => {};
  onMessage: (sentence: string, bad: boolean) => void = () => {};
  /** Fulfilled when the first frame (or, without frames, the first picture) is drawn. */
  readonly firstPicture: Promise<void>;
  private tellFirst: () => void = () => {};
  private dirty = true;
  private stale = true;
  private before_ms = 0;
  private homed = false;
  private readonly dark = window.matchMedia("(prefers-color-scheme: dark)");

  constructor(
    readonly scene: Scene,
    source: Source,
    canvas: HTMLCanvasElement,
    overlayCanvas: HTMLCanvasElement,
    surface: HTMLElement,
  ) {
    this.firstPicture = new Promise((done) => (this.tellFirst = done));
    this.steps = stepsOf(scene);
    this.base = baseView(scene);
    this.store = new ViewStore(this.base);
    this.cache = new PacketCache(source);
    this.clock = new PlayClock(this.steps, scene.sides[0]?.rate_hz ?? 10);
    this.sides = scene.sides.slice(0, 2).map((side, k) => new SideView(scene, side, k));
    this.loader = new StepLoader(this.steps, this.sides, this.cache, () => this.arrived());
    this.stage = new Stage(canvas);
    this.overlay = new Overlay(overlayCanvas);
    this.eyes = new Eyes(surface, () => this.redraw());
    this.surroundings = new Surroundings(
      scene,
      this.cache,
      () => this.refreshAll(),
      (sentence) => this.tell(sentence),
    );
    this.stage.scene.add(this.surroundings.object, this.paths.object, this.sectionPlane.object);
    for (const side of this.sides) this.stage.scene.add(side.object);
    this.store.listen((view, before) => this.changed(view, before));
    this.dark.addEventListener("change", () => this.setTheme());
  }

  get view(): View {
    return this.store.view;
  }

  get step(): number {
    return Math.min(this.view.step, Math.max(0, this.steps.length - 1));
  }

  get time_s(): number {
    return this.steps[this.step]?.time_s ?? 0;
  }

  start(): void {
    this.setTheme();
    this.resize();
    if (this.scene.tracks !== null) {
      this.cache
        .get(this.scene.tracks)
        .then((packet) => {
          this.tracks = tracksOf(packet);
          this.drawPath();
          this.invalidate();
        })
        .catch((error: Error) => this.tell(error.message));
    }
    this.applyEye();
    this.refreshAll();
    this.showWanted();
    requestAnimationFrame((now) => this.tick(now));
  }

  tell(sentence: string): void {
    if (this.errors[this.errors.length - 1] !== sentence) this.errors.push(sentence);
    this.onMessage(sentence, true);
  }

  /** Says what people may want to do instead: nothing went wrong. */
  hint(sentence: string): void {
    this.onMessage(sentence, false);
  }

  /** The picture must be drawn again. */
  redraw(): void {
    this.dirty = true;
  }

  /** The picture and the panels must be brought up to date. */
  invalidate(): void {
    this.dirty = this.stale = true;
  }

  play(on = !this.clock.playing): void {
    if (on && this.steps.length > 1) {
      if (this.step === this.steps.length - 1 && !this.view.loop) this.store.set({ step: 0 });
      this.clock.start();
    } else this.clock.stop();
    this.showWanted();
    this.invalidate();
  }

  go(step: number): void {
    this.store.set({ step: Math.max(0, Math.min(this.steps.length - 1, Math.round(step))) });
  }

  select(key: number | null, side = 0): void {
    const follow = key !== null && this.view.follow;
    this.store.set({ selected: key, selected_side: side, follow });
  }

  selected(): { box: Box; side: SideView; index: number } | null {
    const side = this.sides[this.view.selected_side];
    const index = side?.selectedIndex(this.view) ?? -1;
    return side !== undefined && index >= 0 ? { box: side.boxes[index]!, side, index } : null;
  }

  /** Moves the camera to the selected object. */
  lookAtSelected(): void {
    const found = this.selected();
    if (found === null) return;
    const [x, y, z, l, w, h] = found.box.box;
    this.eyes.goTo(new THREE.Vector3(x, y, z), 6 + 2.5 * Math.max(l, w, h));
  }

  lookAtPlace(at: [number, number, number]): void {
    this.place = at;
    if (this.view.eye === "sensor") this.store.set({ eye: "orbit" });
    this.eyes.goTo(new THREE.Vector3(...at), 18);
    this.invalidate();
  }

  /** Shows a whole view, the camera where it was. */
  restore(view: View): void {
    this.store.set({ ...view });
    this.settled = false;
    this.applyEye();
    this.refreshAll();
  }

  sensor(): Sensor | undefined {
    return (
      this.scene.sensors.find((sensor) => sensor.name === this.view.sensor) ?? this.scene.sensors[0]
    );
  }

  home(): void {
    const { position, target } = homeOf(this.scene, this.sides, this.surroundings.twin?.bounds);
    if (this.view.eye === "sensor") this.applyEye();
    else {
      this.eyes.place(position, target, this.eyes.camera.fov);
      if (this.view.eye === "above") this.eyes.above();
    }
  }

  resize(): void {
    const box = this.stage.canvas.parentElement!.getBoundingClientRect();
    this.stage.resize(Math.round(box.width), Math.round(box.height));
    this.stage.arrange(this.sides.length, this.view.arrangement);
    this.overlay.resize(this.stage.width, this.stage.height, this.stage.ratio);
    if (this.homed) this.render(); // at once: a resized canvas is empty
    this.redraw();
  }

  /** Writes where the camera is into the view. */
  remember(): void {
    const { position } = this.eyes.camera;
    const { target } = this.eyes;
    this.store.set({
      position: [position.x, position.y, position.z],
      target: [target.x, target.y, target.z],
      fov: this.eyes.camera.fov,
    });
  }

  /** Draws now; what is on the canvas afterwards can be read. */
  render(): void {
    const { view, stage } = this;
    const { camera } = this.eyes;
    camera.updateMatrixWorld();
    this.sectionPlane.update(view, this.eyes.target, camera.position);
    this.surroundings.cut(this.sectionPlane.clipping);
    const fog = view.fog * view.fog * 0.05;
    stage.setBackground(this.token("--scene"), fog);
    const pixels = stage.pixelsPerMetre(camera);
    for (const side of this.sides) {
      side.cloud.object.visible = view.layers.points && side.frame.count > 0;
      side.cloud.setLook(view.size, pixels, stage.ratio, fog, stage.background);
      side.cloud.setSection(this.sectionPlane.cut, view.section ? view.section_thick_m : 0);
    }
    stage.render(camera);
    drawOver(this);
    this.film.frame();
  }

  token(name: string): string {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  rgbToken(name: string): Rgb {
    const colour = new THREE.Color().setStyle(this.token(name)).convertLinearToSRGB();
    return [Math.round(colour.r * 255), Math.round(colour.g * 255), Math.round(colour.b * 255)];
  }

  private tick(now: number): void {
    requestAnimationFrame((next) => this.tick(next));
    const elapsed = this.before_ms === 0 ? 0 : (now - this.before_ms) / 1000;
    this.before_ms = now;
    if (this.clock.playing && this.shownStep === this.step) {
      const { view } = this;
      const due = this.clock.advance(this.step, elapsed, view.speed, view.loop, (step) =>
        this.loader.ready(step),
      );
      if (!this.clock.playing) this.stale = true;
      if (due !== this.step) this.store.set({ step: due });
      else this.loader.want(this.step, view.loop, true);
    }
    if (this.eyes.update(elapsed)) this.dirty = true;
    if (this.stale) {
      this.stale = false;
      this.onUpdate();
    }
    if (this.dirty || this.film.recording) {
      this.dirty = false;
      this.render();
      if (this.homed) this.tellFirst();
    }
  }

  private arrived(): void {
    if (this.shownStep !== this.step) this.showWanted();
    else this.loader.want(this.step, this.view.loop, this.clock.playing);
    this.stale = true;
  }

  /** Shows the step of the view as soon as all of it is here. */
  private showWanted(): void {
    if (this.steps.length === 0) {
      if (!this.homed) this.goHome();
      return;
    }
    this.loader.want(this.step, this.view.loop, this.clock.playing);
    if (!this.loader.ready(this.step) || this.shownStep === this.step) return;
    const frames = this.steps[this.step]!.frames;
    this.sides.forEach((side, k) => {
      const names = side.packets(frames[k] ?? -1);
      const of = (kind: string): ReturnType<StepLoader["packet"]> => {
        const name = names.find((one) => one.startsWith(kind));
        return name === undefined ? undefined : this.loader.packet(name);
      };
      try {
        side.load(of("points/"), of("boxes/"));
      } catch (error) {
        this.tell((error as Error).message);
      }
    });
    const first = this.shownStep < 0;
    this.shownStep = this.step;
    this.picked = null;
    // A box without a track is another one, or none, in the next frame.
    if (!first && (this.view.selected ?? 0) < 0) this.store.set({ selected: null, follow: false });
    this.framesShown++;
    if (!this.homed) this.goHome();
    this.refreshSides();
    const selected = this.view.follow || this.view.eye === "chase" ? this.selected() : null;
    this.eyes.carry(selected?.box);
    this.surroundings.show(this.view, this.time_s);
    this.drawPath();
    this.invalidate();
    this.loader.want(this.step, this.view.loop, this.clock.playing);
  }

  private goHome(): void {
    this.homed = true;
    const { position, target } = this.view;
    if (position === null || target === null) this.home();
    else this.applyEye();
    this.settled = true;
  }

  private changed(view: View, before: View): void {
    const differs = (...keys: (keyof View)[]): boolean =>
      keys.some((key) => view[key] !== before[key]);
    if (differs("theme")) this.setTheme();
    if (differs("arrangement")) this.stage.arrange(this.sides.length, view.arrangement);
    if (differs("eye", "sensor") && !differs("position")) this.applyEye();
    if (differs("step")) this.showWanted();
    if (differs("colour", "from", "to", "arrangement")) this.colourPoints();
    if (differs("ground", "hidden", "selected", "selected_side")) {
      for (const side of this.sides) side.mark(view);
    }
    if (
      differs("filters", "layers", "score", "selected", "selected_side", "arrangement", "colour")
    ) {
      this.drawBoxes();
    }
    if (differs("layers", "eye")) this.surroundings.show(view, this.time_s);
    if (differs("selected", "selected_side", "layers")) {
      this.drawPath();
      this.eyes.carry(view.follow || view.eye === "chase" ? this.selected()?.box : undefined);
    }
    if (differs("follow")) this.eyes.carry(view.follow ? this.selected()?.box : undefined);
    if (differs("range_image")) requestAnimationFrame(() => this.resize());
    this.invalidate();
  }

  refreshAll(): void {
    this.refreshSides();
    this.surroundings.show(this.view, this.time_s);
    this.drawPath();
    this.invalidate();
  }

  private refreshSides(): void {
    this.colourPoints();
    for (const side of this.sides) side.mark(this.view);
    this.drawBoxes();
  }

  private colourPoints(): void {
    const { colour, from, to } = this.view;
    // Both sides share one domain: that of the first, or what the view says.
    let domain: [number, number] | null = null;
    for (const side of this.sides) {
      if (isCategorical(colour)) domain = [0, 1];
      side.colour(colour, this.theme, domain ?? this.fixedDomain(colour));
      if (side.frame.count === 0) continue;
      domain ??= side.domain;
      this.domains.set(colour, domain);
      const shown: [number, number] = [from ?? domain[0], to ?? domain[1]];
      if (shown[0] !== side.domain[0] || shown[1] !== side.domain[1]) {
        side.colour(colour, this.theme, shown);
      }
    }
  }

  private readonly domains = new Map<string, [number, number]>();

  /** A quantity keeps the domain of the first frame, so that colours mean the same while it plays. */
  private fixedDomain(colour: string): [number, number] | null {
    return this.domains.get(colour) ?? null;
  }

  private drawBoxes(): void {
    const background = this.rgbToken("--scene");
    const accent = this.rgbToken("--accent");
    for (const side of this.sides) side.drawBoxes(this.view, this.theme, background, accent);
  }

  private drawPath(): void {
    const { selected, layers } = this.view;
    const track = layers.path && selected !== null ? this.tracks.get(selected) : undefined;
    this.paths.draw(track, this.time_s, this.rgbToken("--accent"), this.rgbToken("--dim"));
  }

  private applyEye(): void {
    const { view, eyes } = this;
    const sensor = this.sensor();
    if (view.eye === "sensor" && sensor !== undefined) eyes.fromSensor(sensor);
    else if (view.eye === "above") eyes.above();
    else if (view.eye === "chase") {
      const found = this.selected();
      if (found !== null) eyes.chase(found.box);
      else if (this.shownStep >= 0) {
        this.store.set({ eye: "orbit" });
        this.hint("Select an object first: the eye then chases it.");
      }
    } else eyes.orbit();
    if (view.position !== null && view.target !== null && !this.settled) {
      eyes.place(view.position, view.target, view.fov);
    }
    this.settled = this.homed;
    this.redraw();
  }

  private settled = false; // whether the view's own camera was taken over once

  private setTheme(): void {
    const { theme } = this.view;
    this.theme = theme === "auto" ? (this.dark.matches ? "dark" : "light") : theme;
    document.documentElement.dataset["theme"] = this.theme;
    const line = new THREE.Color().setStyle(this.token("--grid"));
    const accent = new THREE.Color().setStyle(this.token("--accent"));
    this.surroundings.setTheme(this.theme, line, accent);
    this.sectionPlane.setColour(accent);
    this.refreshAll();
  }
}
