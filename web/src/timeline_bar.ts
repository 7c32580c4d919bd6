// The bar of the time line: play, step, loop, speed; what is loaded, what is damaged, what happens.

import type { App } from "./app";
import { bind, el, icon, iconButton, pressed, setIcon } from "./dom";
import { stepOfFrame } from "./document";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

export function timelineBar(app: App): HTMLElement {
  const { store, steps } = app;
  const play = iconButton("play", "Play", () => app.play(), "Space");
  play.classList.add("play");
  const back = iconButton("back", "One frame back", () => app.go(app.step - 1), "←");
  const next = iconButton("next", "One frame on", () => app.go(app.step + 1), "→");
  const loop = pressed(
    iconButton("loop", "Play again from the start", () => store.set({ loop: !app.view.loop }), "L"),
    () => app.view.loop,
  );
  const speed = el(
    "select",
    {
      title: "Speed",
      "aria-label": "Speed",
      onchange: () => store.set({ speed: Number(speed.value) }),
    },
    ...SPEEDS.map((value) => el("option", { value: String(value) }, `${value}×`)),
  ) as HTMLSelectElement;

  const said = el("output", { className: "now" });
  const input = el("input", {
    type: "range",
    min: "0",
    max: String(Math.max(0, steps.length - 1)),
    step: "1",
    className: "track",
    "aria-label": "Frame",
  });
  input.addEventListener("input", () => app.go(Number(input.value)));
  const marks = el("canvas", { className: "marks" });
  marks.setAttribute("aria-hidden", "true");
  const track = el("div", { className: "track-box" }, marks, input, eventMarks(app));

  let drawn = "";
  let states: string[] = [];
  let looked_ms = -Infinity;
  bind(() => {
    setIcon(play, app.clock.playing ? "pause" : "play", app.clock.playing ? "Pause" : "Play");
    input.value = String(app.step);
    const step = steps[app.step];
    const entry = app.scene.sides[0]?.frames[step?.frames[0] ?? -1];
    const error = app.loader.error(app.step);
    const time = step === undefined ? "" : `${(step.time_s - steps[0]!.time_s).toFixed(2)} s`;
    said.textContent = `${time} · ${entry?.name ?? app.step} · ${app.step + 1}/${steps.length}`;
    input.setAttribute(
      "aria-valuetext",
      `${said.textContent}${error === null ? "" : `, cannot be read: ${error}`}`,
    );
    if (![...speed.options].some((option) => option.value === String(app.view.speed))) {
      speed.append(el("option", { value: String(app.view.speed) }, `${app.view.speed}×`));
    }
    speed.value = String(app.view.speed);
    // Of thousands of frames not more often than people notice.
    const now = performance.now();
    if (!app.clock.playing || now - looked_ms > 300) {
      looked_ms = now;
      states = steps.map((_, k) =>
        app.loader.error(k) !== null ? "e" : app.loader.ready(k) ? "r" : "-",
      );
    }
    const wanted = `${states.join("")}${marks.clientWidth}${app.theme}${app.step}`;
    if (wanted !== drawn) {
      drawn = wanted;
      drawMarks(marks, states, app);
    }
  });
  return el(
    "footer",
    { className: "time", "aria-label": "Time line" },
    el("div", { className: "buttons" }, back, play, next),
    track,
    said,
    el("div", { className: "buttons" }, eventButtons(app), loop, speed),
  );
}

function drawMarks(canvas: HTMLCanvasElement, states: string[], app: App): void {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const brush = canvas.getContext("2d")!;
  brush.scale(ratio, ratio);
  const inset = 8; // half the thumb: where the slider's first and last places are
  const span = width - 2 * inset;
  const last = Math.max(1, states.length - 1);
  const x = (k: number): number => inset + (k / last) * span;
  const unit = Math.max(2, span / last);
  const middle = height / 2;
  brush.fillStyle = app.token("--line");
  brush.beginPath();
  brush.roundRect(inset, middle - 2, span, 4, 2);
  brush.fill();
  states.forEach((state, k) => {
    if (state === "-") return;
    const damaged = state === "e";
    brush.fillStyle = app.token(damaged ? "--bad" : "--loaded");
    const left = Math.max(inset, x(k) - unit / 2);
    const right = Math.min(inset + span, x(k) + unit / 2);
    if (damaged) brush.fillRect(x(k) - Math.max(1.5, unit / 2), middle - 6, Math.max(3, unit), 12);
    else brush.fillRect(left, middle - 2, right - left, 4);
  });
  brush.fillStyle = app.token("--accent");
  brush.fillRect(inset, middle - 2, x(app.step) - inset, 4);
}

function eventMarks(app: App): HTMLElement {
  const box = el("div", { className: "event-marks" });
  const last = Math.max(1, app.steps.length - 1);
  for (const event of app.scene.events) {
    const step = stepOfFrame(app.steps, event.frame);
    const mark = el("button", {
      type: "button",
      title: `${event.kind}: ${event.text}`,
      "aria-label": `${event.kind}: ${event.text}`,
      tabIndex: -1, // the list of events and the keys reach them, too
      onclick: () => jump(app, step, event.track),
    });
    mark.dataset["kind"] = event.kind;
    mark.style.setProperty("--at", String(step / last));
    box.append(mark);
  }
  return box;
}

/** Shows an event: its frame, and whom it is about. */
function jump(app: App, step: number, track: number | null): void {
  app.play(false);
  app.go(step);
  if (track !== null) {
    app.select(track);
    // The frame may still be on its way.
    const wait = (left: number): void => {
      if (app.shownStep === step) app.lookAtSelected();
      else if (left > 0) window.setTimeout(() => wait(left - 1), 60);
    };
    wait(50);
  }
}

export function jumpToEvent(app: App, direction: 1 | -1): void {
  const steps = app.scene.events
    .map((event) => ({ step: stepOfFrame(app.steps, event.frame), track: event.track }))
    .sort((a, b) => a.step - b.step);
  const found =
    direction > 0
      ? steps.find(({ step }) => step > app.step)
      : steps.reverse().find(({ step }) => step < app.step);
  if (found !== undefined) jump(app, found.step, found.track);
}

function eventButtons(app: App): HTMLElement | null {
  if (app.scene.events.length === 0) return null;
  return el(
    "span",
    { className: "buttons event-buttons" },
    iconButton("earlier", "The event before", () => jumpToEvent(app, -1), "["),
    iconButton("later", "The next event", () => jumpToEvent(app, 1), "]"),
  );
}

/** Events as a list to go through. */
export function eventList(app: App): HTMLElement {
  const items = app.scene.events.map((event) => {
    const step = stepOfFrame(app.steps, event.frame);
    const button = el(
      "button",
      { type: "button", className: "place", onclick: () => jump(app, step, event.track) },
      icon("flag"),
      el(
        "span",
        {},
        el("b", {}, event.text),
        el("small", {}, `${event.kind} · ${event.time_s.toFixed(1)} s`),
      ),
    );
    bind(() => button.setAttribute("aria-current", String(app.step === step)));
    return el("li", {}, button);
  });
  return items.length > 0
    ? el("ul", { className: "places" }, ...items)
    : el("p", { className: "empty" }, "No events are known for what is shown.");
}

/** The worst places of a comparison as a list to click through. */
export function worstList(app: App): HTMLElement {
  const items = (app.scene.worst ?? []).map((place, k) => {
    const step = stepOfFrame(app.steps, place.frame);
    const button = el(
      "button",
      {
        type: "button",
        className: "place",
        onclick: () => {
          app.play(false);
          app.go(step);
          app.lookAtPlace(place.at);
        },
      },
      el("span", { className: "rank" }, String(k + 1)),
      el(
        "span",
        {},
        el("b", {}, place.text),
        el(
          "small",
          {},
          `frame ${app.scene.sides[0]?.frames[place.frame]?.name ?? place.frame} · ${place.at.map((v) => v.toFixed(1)).join(", ")} m`,
        ),
      ),
    );
    bind(() => button.setAttribute("aria-current", String(app.place === place.at)));
    return el("li", {}, button);
  });
  return items.length > 0
    ? el("ol", { className: "places" }, ...items)
    : el("p", { className: "empty" }, "The report names no worst places.");
}
