// The bar at the top: what is shown, the eyes, the tools.

import type { App } from "./app";
import { bind, choice, el, icon, iconButton, pressed, segments, setIcon } from "./dom";
import { saveBlob, savePicture } from "./film";
import type { Help } from "./help";
import { toggleSection } from "./settings_panel";
import { fileOf, viewOfFile, type EyeMode } from "./view_state";

export interface Panels {
  toggle(which: "settings" | "objects"): void;
  shown(which: "settings" | "objects"): boolean;
}

export class Toolbar {
  readonly element: HTMLElement;
  private readonly share: HTMLDialogElement;

  constructor(
    private readonly app: App,
    help: Help,
    panels: Panels,
    private readonly say: (sentence: string) => void,
  ) {
    this.share = this.shareCard();
    document.body.append(this.share);
    const { store } = app;
    const settings = pressed(
      iconButton("sliders", "Settings", () => panels.toggle("settings")),
      () => panels.shown("settings"),
    );
    const objects = pressed(
      iconButton("list", "Objects", () => panels.toggle("objects")),
      () => panels.shown("objects"),
    );
    const measure = pressed(
      iconButton("ruler", "Measure a distance", () => this.measure(), "M"),
      () => app.measure.on,
    );
    const section = pressed(
      iconButton("section", "Section plane", () => toggleSection(app, !app.view.section), "X"),
      () => app.view.section,
    );
    const range = pressed(
      iconButton(
        "image",
        "Range image",
        () => store.set({ range_image: !app.view.range_image }),
        "R",
      ),
      () => app.view.range_image,
    );
    const film = iconButton("film", "Record a film", () => this.film(), "V");
    bind(() => {
      setIcon(
        film,
        app.film.recording ? "stop" : "film",
        app.film.recording ? "Stop recording" : "Record a film",
      );
      film.classList.toggle("recording", app.film.recording);
    });
    const sides = app.scene.sides;
    this.element = el(
      "header",
      { className: "bar" },
      settings,
      el(
        "div",
        { className: "title" },
        el("h1", { title: app.scene.title }, app.scene.title),
        el(
          "small",
          {},
          sides.length > 1 ? sides.map((side) => side.name).join(" · ") : app.scene.kind,
        ),
      ),
      el("div", { className: "eyes" }, this.eyes(), this.sensors()),
      el(
        "div",
        { className: "tools", role: "toolbar", "aria-label": "Tools" },
        measure,
        section,
        range,
        iconButton("camera", "Save a picture", () => void this.picture(), "K"),
        film,
        iconButton("share", "Save or open a view", () => this.share.showModal()),
        iconButton("theme", "Light or dark", () => this.theme(), "D"),
        iconButton("help", "Keys and gestures", () => help.toggle(), "?"),
      ),
      objects,
    );
  }

  measure(): void {
    const { measure } = this.app;
    measure.on = !measure.on;
    measure.clear();
    if (measure.on) this.say("Click two places to measure between them.");
    this.app.invalidate();
  }

  theme(): void {
    this.app.store.set({ theme: this.app.theme === "dark" ? "light" : "dark" });
  }

  async picture(): Promise<void> {
    const { app } = this;
    try {
      app.render();
      const name = `${fileName(app.scene.title)}-${String(app.step + 1).padStart(4, "0")}.png`;
      await savePicture([app.stage.canvas, app.overlay.canvas], name);
      this.say(`Saved ${name}.`);
    } catch (error) {
      app.tell((error as Error).message);
    }
  }

  film(): void {
    const { app } = this;
    if (app.film.recording) {
      app.film.stop();
      app.play(false);
      return;
    }
    try {
      app.render();
      app.film.start([app.stage.canvas, app.overlay.canvas], (blob, ending) => {
        const name = `${fileName(app.scene.title)}.${ending}`;
        saveBlob(blob, name);
        this.say(`Saved ${name}, ${(blob.size / 1e6).toFixed(1)} MB.`);
      });
      app.play(true);
      this.say("Recording: press the button again to stop and save.");
    } catch (error) {
      app.tell((error as Error).message);
    }
    app.invalidate();
  }

  private eyes(): HTMLElement {
    const options: [EyeMode, string, string][] = [
      ["orbit", "Orbit", "Orbit (O)"],
      ["above", "Above", "From above (T)"],
    ];
    if (this.app.scene.sensors.length > 0)
      options.push(["sensor", "Sensor", "From the sensor (S)"]);
    if (this.app.scene.sides.some((side) => side.box_packet)) {
      options.push(["chase", "Chase", "Chase the selected object (C)"]);
    }
    return segments(
      "Eye",
      options,
      () => this.app.view.eye,
      (eye) => this.app.store.set({ eye }),
    );
  }

  private sensors(): HTMLElement | null {
    const { sensors } = this.app.scene;
    if (sensors.length < 2) return null;
    return choice(
      "Sensor",
      sensors.map((sensor) => [sensor.name, sensor.name] as const),
      () => this.app.sensor()?.name ?? "",
      (sensor) => this.app.store.set({ sensor }),
    );
  }

  private shareCard(): HTMLDialogElement {
    const file = el("input", { type: "file", accept: ".json,application/json", hidden: true });
    file.addEventListener("change", () => {
      const [chosen] = file.files ?? [];
      if (chosen !== undefined) void this.loadView(chosen);
      file.value = "";
    });
    const button = (text: string, name: string, onclick: () => void): HTMLElement =>
      el("button", { type: "button", className: "button", onclick }, icon(name), text);
    const dialog = el(
      "dialog",
      { className: "share", "aria-label": "Save or open a view" },
      el(
        "div",
        { className: "object-head" },
        el("h1", {}, "This view"),
        iconButton("close", "Close", () => dialog.close(), "Esc"),
      ),
      el(
        "p",
        {},
        "The file holds the frame, the camera, colours, layers, filters and the selection.",
      ),
      el(
        "div",
        { className: "actions" },
        button("Save as a file", "down", () => {
          this.app.remember();
          const name = `${fileName(this.app.scene.title)}-view.json`;
          saveBlob(new Blob([fileOf(this.app.view)], { type: "application/json" }), name);
        }),
        button("Open a file", "up", () => file.click()),
        file,
      ),
    );
    return dialog;
  }

  async loadView(file: File): Promise<void> {
    try {
      this.app.restore(viewOfFile(await file.text(), this.app.base));
      this.share.close();
      this.say(`The view of ${file.name} is shown.`);
    } catch (error) {
      this.app.tell((error as Error).message);
    }
  }
}

const fileName = (title: string): string =>
  title
    .normalize("NFKD")
    .replace(/[^\w]+/g, "-")
    .replace(/^-+|-+$/g, "")
    .toLowerCase() || "view";
