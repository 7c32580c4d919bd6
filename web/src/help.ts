// The card of keyboard shortcuts, and what the keys do.

import type { App } from "./app";
import { el, iconButton, typing } from "./dom";
import { toggleChase } from "./object_panel";
import { offered } from "./quantity";
import { toggleSection } from "./settings_panel";
import { jumpToEvent } from "./timeline_bar";
import type { Layer } from "./view_state";

interface Actions {
  measure(): void;
  picture(): void;
  film(): void;
  theme(): void;
  search(): void;
  escape(): void;
}

type Shortcut = [keys: string, what: string];

const SHORTCUTS: [string, Shortcut[]][] = [
  [
    "Time",
    [
      ["Space", "Play, pause"],
      ["← →", "One frame; with Shift ten"],
      ["Home End", "First, last frame"],
      ["[ ]", "Event before, next event"],
      ["L", "Loop"],
    ],
  ],
  [
    "Eyes",
    [
      ["O", "Orbit"],
      ["T", "From above"],
      ["S", "From the sensor; again: the next"],
      ["C", "Chase the selected object"],
      ["F", "Follow it"],
      ["Enter", "Look at it"],
      ["H", "Where the page began"],
    ],
  ],
  [
    "What is seen",
    [
      ["1 … 9", "Colour by"],
      ["G", "Ground"],
      ["P B N", "Points, boxes, names"],
      ["I", "Ignored objects"],
      ["W", "Twin"],
      ["R", "Range image"],
      ["X", "Section plane"],
      ["D", "Light, dark"],
    ],
  ],
  [
    "Tools",
    [
      ["M", "Measure: click two places"],
      ["/", "Find objects"],
      ["K", "Save a picture"],
      ["V", "Record a film, stop"],
      ["Esc", "Close, deselect"],
      ["?", "This card"],
    ],
  ],
];

export class Help {
  readonly element: HTMLDialogElement;

  constructor() {
    this.element = el(
      "dialog",
      { className: "help", "aria-label": "Keyboard shortcuts" },
      el(
        "div",
        { className: "object-head" },
        el("h1", {}, "Keys and gestures"),
        iconButton("close", "Close", () => this.element.close(), "Esc"),
      ),
      el(
        "div",
        { className: "help-columns" },
        ...SHORTCUTS.map(([title, keys]) =>
          el(
            "section",
            {},
            el("h2", {}, title),
            el(
              "dl",
              {},
              ...keys.map(([key, what]) =>
                el(
                  "div",
                  {},
                  el("dt", {}, ...key.split(" ").map((one) => el("kbd", {}, one))),
                  el("dd", {}, what),
                ),
              ),
            ),
          ),
        ),
      ),
      el(
        "p",
        { className: "hint" },
        "Drag to turn, right drag or two fingers to move, wheel or pinch to come nearer. Click a box or a point of it to select it; double click to look at it.",
      ),
    );
    this.element.addEventListener("click", (event) => {
      if (event.target === this.element) this.element.close();
    });
  }

  toggle(): void {
    if (this.element.open) this.element.close();
    else this.element.showModal();
  }
}

export function listenToKeys(app: App, help: Help, actions: Actions): void {
  const flip = (layer: Layer): void => app.store.layer(layer, !app.view.layers[layer]);
  const keys: Record<string, (event: KeyboardEvent) => void> = {
    " ": () => app.play(),
    ArrowLeft: (event) => app.go(app.step - (event.shiftKey ? 10 : 1)),
    ArrowRight: (event) => app.go(app.step + (event.shiftKey ? 10 : 1)),
    Home: () => app.go(0),
    End: () => app.go(app.steps.length - 1),
    "[": () => jumpToEvent(app, -1),
    "]": () => jumpToEvent(app, 1),
    l: () => app.store.set({ loop: !app.view.loop }),
    o: () => app.store.set({ eye: "orbit" }),
    t: () => app.store.set({ eye: "above" }),
    s: () => nextSensor(app),
    c: () => toggleChase(app),
    f: () => app.store.set({ follow: !app.view.follow && app.selected() !== null }),
    Enter: () => app.lookAtSelected(),
    h: () => app.home(),
    g: () => app.store.set({ ground: !app.view.ground }),
    p: () => flip("points"),
    b: () => flip("boxes"),
    n: () => flip("names"),
    i: () => flip("ignored"),
    w: () => flip("twin"),
    r: () => app.store.set({ range_image: !app.view.range_image }),
    x: () => toggleSection(app, !app.view.section),
    d: () => actions.theme(),
    m: () => actions.measure(),
    "/": () => actions.search(),
    k: () => actions.picture(),
    v: () => actions.film(),
    Escape: () => actions.escape(),
    "?": () => help.toggle(),
  };
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.element.open) return;
    if (typing(event.target)) {
      if (event.key === "Escape") (event.target as HTMLElement).blur();
      return;
    }
    const onButton =
      event.target instanceof HTMLElement && ["BUTTON", "SUMMARY"].includes(event.target.tagName);
    if (onButton && (event.key === " " || event.key === "Enter")) return;
    const onSlider = event.target instanceof HTMLInputElement && event.target.type === "range";
    if (onSlider && /^(Arrow|Home|End)/.test(event.key)) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const number = /^[1-9]$/.test(key) ? Number(key) - 1 : -1;
    const quantity = number >= 0 ? offered(app.scene)[number] : undefined;
    const action = quantity
      ? () => app.store.set({ colour: quantity, from: null, to: null })
      : keys[key];
    if (action === undefined) return;
    event.preventDefault();
    action(event);
  });
}

function nextSensor(app: App): void {
  const { sensors } = app.scene;
  if (sensors.length === 0) {
    app.hint("No sensor is known: there is no eye of one.");
    return;
  }
  const at = sensors.findIndex((sensor) => sensor.name === app.view.sensor);
  const next = app.view.eye === "sensor" ? (at + 1) % sensors.length : Math.max(0, at);
  app.store.set({ eye: "sensor", sensor: sensors[next]!.name });
}
