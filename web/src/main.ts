// Builds the page: reads what there is to look at, lays out the panels, starts the picture.

import "./page.css";

import { App } from "./app";
import { bind, el, updateBound } from "./dom";
import { readDocument, type Scene } from "./document";
import { Help, listenToKeys } from "./help";
import { placeInWindow } from "./labels";
import { legend } from "./legend";
import { emptyState, Messages } from "./messages";
import { objectList } from "./object_list";
import { objectPanel, pointCard } from "./object_panel";
import { Pointer } from "./pointer";
import { rangePanel } from "./range_panel";
import { settingsPanel } from "./settings_panel";
import { openSource } from "./source";
import { eventList, timelineBar, worstList } from "./timeline_bar";
import { Toolbar, type Panels } from "./toolbar";

declare global {
  interface Window {
    urbantwin?: {
      ready: Promise<void>;
      state(): Record<string, unknown>;
      memory(): Record<string, number>;
      place?(track: number): [number, number] | null;
      errors: string[];
      app?: App;
    };
  }
}

async function fetchDocument(): Promise<Scene> {
  const tag = document.getElementById("document");
  if (tag !== null && tag.textContent?.trim()) return readDocument(JSON.parse(tag.textContent));
  const answer = await fetch("document.json", { credentials: "omit" });
  if (!answer.ok) throw new Error(`The server has no document (${answer.status}).`);
  return readDocument(await answer.json());
}

function layout(scene: Scene): App {
  const canvas = el("canvas", { className: "picture" });
  const over = el("canvas", { className: "over" });
  const surface = el("div", {
    className: "surface",
    tabIndex: 0,
    role: "application",
    "aria-label": "The scene: drag to turn, wheel to come nearer, click to select",
  });
  const messages = new Messages();
  const stage = el("div", { className: "stage" }, canvas, over, surface);
  const main = el("main", { className: "main" }, stage);
  document.body.append(main);
  const app = new App(scene, openSource(document), canvas, over, surface);
  app.onMessage = (sentence, bad) => messages.say(sentence, bad);
  new Pointer(app, surface);
  canvas.addEventListener("webglcontextlost", () => {
    messages.say("The graphics card dropped the picture. It comes back, or load the page again.");
  });
  canvas.addEventListener("webglcontextrestored", () => app.refreshAll());

  const narrow = window.matchMedia("(max-width: 760px)");
  const open = { settings: !narrow.matches, objects: !narrow.matches };
  const hasObjects = scene.sides.some((side) => side.box_packet);
  open.objects &&= hasObjects || scene.worst !== null || scene.events.length > 0;
  const panels: Panels = {
    shown: (which) => open[which],
    toggle: (which) => {
      open[which] = !open[which];
      // On a phone a sheet takes the lower half: one at a time.
      if (narrow.matches && open[which])
        open[which === "settings" ? "objects" : "settings"] = false;
      app.invalidate();
      requestAnimationFrame(() => app.resize());
    },
  };
  const help = new Help();
  const toolbar = new Toolbar(app, help, panels, (sentence) => messages.say(sentence));
  const settings = el(
    "aside",
    { className: "panel settings", "aria-label": "Settings" },
    ...settingsPanel(app),
  );
  const { element: objects, search } = objectsPanel(app, hasObjects);
  bind(() => {
    settings.hidden = !open.settings;
    objects.hidden = !open.objects;
    document.body.classList.toggle("sheet-open", narrow.matches && (open.settings || open.objects));
  });
  const damaged = el("div", { className: "damaged", role: "alert" });
  bind(() => {
    const error = app.loader.error(app.step);
    const text = error === null ? "" : `Frame ${frameName(app)} cannot be read: ${error}`;
    damaged.hidden = text === "";
    if (damaged.textContent !== text) damaged.textContent = text;
  });
  const waiting = el("div", { className: "waiting", hidden: true }, "Loading …");
  bind(() => (waiting.hidden = app.steps.length === 0 || app.loader.ready(app.step)));
  stage.append(
    el("div", { className: "corner" }, pointCard(app), legend(app)),
    damaged,
    waiting,
    messages.element,
  );
  const nothing = nothingToSee(scene);
  if (nothing !== null) stage.append(nothing);
  main.append(rangePanel(app));
  document.body.prepend(toolbar.element, settings);
  document.body.append(objects);
  if (app.steps.length > 0) document.body.append(timelineBar(app));
  document.body.append(help.element);

  listenToKeys(app, help, {
    measure: () => toolbar.measure(),
    picture: () => void toolbar.picture(),
    film: () => toolbar.film(),
    theme: () => toolbar.theme(),
    search: () => {
      if (!open.objects) panels.toggle("objects");
      requestAnimationFrame(search);
    },
    escape: () => {
      if (app.measure.on) toolbar.measure();
      else if (app.picked !== null || app.place !== null) {
        app.picked = app.place = null;
        app.invalidate();
      } else app.select(null);
    },
  });
  acceptDroppedViews(toolbar);
  new ResizeObserver(() => app.resize()).observe(stage);
  app.onUpdate = updateBound;
  return app;
}

function objectsPanel(app: App, hasObjects: boolean): { element: HTMLElement; search: () => void } {
  type Tab = "objects" | "events" | "worst";
  const tabs: [Tab, string, HTMLElement][] = [];
  const list = el("div", { className: "tab-body list" }, ...(hasObjects ? objectList(app) : []));
  if (app.scene.worst !== null) {
    tabs.push(["worst", "Worst places", el("div", { className: "tab-body" }, worstList(app))]);
  }
  if (hasObjects) tabs.push(["objects", "Objects", list]);
  if (app.scene.events.length > 0) {
    tabs.push(["events", "Events", el("div", { className: "tab-body" }, eventList(app))]);
  }
  let shown: Tab = tabs[0]?.[0] ?? "objects";
  const buttons = tabs.map(([tab, name]) => {
    const button = el(
      "button",
      { type: "button", role: "tab", onclick: () => ((shown = tab), app.invalidate()) },
      name,
    );
    bind(() => button.setAttribute("aria-selected", String(shown === tab)));
    return button;
  });
  bind(() => tabs.forEach(([tab, , body]) => (body.hidden = tab !== shown)));
  const element = el(
    "aside",
    { className: "panel objects", "aria-label": "Objects and events" },
    objectPanel(app),
    tabs.length > 0
      ? el("div", { className: "tabs", role: "tablist" }, ...buttons)
      : el("p", { className: "empty" }, "There are no objects in what is shown."),
    ...tabs.map(([, , body]) => body),
  );
  const search = (): void => {
    shown = "objects";
    updateBound();
    list.querySelector<HTMLInputElement>(".search")?.focus();
  };
  return { element, search };
}

function nothingToSee(scene: Scene): HTMLElement | null {
  const frames = scene.sides.reduce((sum, side) => sum + side.frames.length, 0);
  if (frames > 0 || scene.twin !== null) return null;
  return emptyState(
    "There is nothing to look at here",
    scene.sides.length > 0
      ? "The recording has no frames: it may have been stopped before its first one, or every frame was left out."
      : "The document names neither frames nor a twin.",
    "“urbantwin view PATH” opens a twin, a motion, a dataset, a folder of real frames, or two of them side by side.",
  );
}

function acceptDroppedViews(toolbar: Toolbar): void {
  window.addEventListener("dragover", (event) => event.preventDefault());
  window.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer?.files ?? [];
    if (file !== undefined) void toolbar.loadView(file);
  });
}

const frameName = (app: App): string =>
  app.scene.sides[0]?.frames[app.steps[app.step]?.frames[0] ?? -1]?.name ?? String(app.step);

function failed(error: unknown): void {
  const sentence = error instanceof Error ? error.message : String(error);
  window.urbantwin?.errors.push(sentence);
  document.body.replaceChildren(
    emptyState("This page could not be opened", sentence, "Make it anew with “urbantwin view”."),
  );
}

async function start(): Promise<void> {
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset["theme"] = dark ? "dark" : "light";
  const scene = await fetchDocument().catch((error: unknown) => {
    throw error instanceof SyntaxError
      ? new Error("The document of this page is damaged: it is not JSON.")
      : error;
  });
  document.title = `${scene.title} · UrbanTwin`;
  let app: App;
  try {
    app = layout(scene);
  } catch (error) {
    if (/WebGL/i.test(String(error))) {
      throw new Error(
        "This browser has no WebGL 2, which the picture is drawn with; switch on hardware acceleration or use another browser.",
      );
    }
    throw error;
  }
  const api = window.urbantwin!;
  api.app = app;
  api.errors = app.errors;
  api.state = () => ({
    ...app.view,
    step: app.step,
    shown_step: app.shownStep,
    frames_shown: app.framesShown,
    playing: app.clock.playing,
    points: app.sides.map((side) => side.frame.count),
    boxes: app.sides.map((side) => side.boxes.length),
    selected_box: app.selected()?.box ?? null,
    picked: app.picked,
    error: app.loader.error(app.step),
    theme_shown: app.theme,
    camera: app.eyes.camera.position.toArray(),
    target: app.eyes.target.toArray(),
    measured: app.measure.text,
  });
  api.place = (track) => placeInWindow(app, track);
  api.memory = () => ({
    packets_bytes: app.cache.size,
    packets_limit_bytes: app.cache.limit,
    heap_bytes:
      (performance as { memory?: { usedJSHeapSize: number } }).memory?.usedJSHeapSize ?? 0,
    geometries: app.stage.renderer.info.memory.geometries,
    textures: app.stage.renderer.info.memory.textures,
  });
  app.start();
  await app.firstPicture;
}

let opened: () => void = () => {};
let refused: (error: unknown) => void = () => {};
const ready = new Promise<void>((done, fail) => ([opened, refused] = [done, fail]));
ready.catch(failed);
window.urbantwin = {
  ready,
  state: () => ({}),
  memory: () => ({}),
  errors: [],
};
window.addEventListener("error", (event) => {
  window.urbantwin?.app?.tell(`Something went wrong in this page: ${event.message}`);
});
window.addEventListener("unhandledrejection", (event) => {
  window.urbantwin?.app?.tell(`Something went wrong in this page: ${String(event.reason)}`);
});
const begin = (): void => void start().then(opened, refused);
if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", begin);
else begin();
