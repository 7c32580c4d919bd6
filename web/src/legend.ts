// What the colours of the points mean; classes are switched on and off here.

import type { App } from "./app";
import { cssColour, entry, sideColours } from "./colour";
import { bind, el } from "./dom";
import { DESCRIPTIONS, sayQuantity } from "./quantity";

export function legend(app: App): HTMLElement {
  const narrow = window.matchMedia("(max-width: 760px)").matches;
  const body = el("div", { className: "legend-body" });
  const summary = el("summary", {});
  const box = el(
    "details",
    { className: "card legend", open: !narrow, "aria-label": "What the colours mean" },
    summary,
    body,
  );
  let drawn = "";
  bind(() => {
    const { view, scene } = app;
    const counts = new Map<number, number>();
    const points = view.layers.points && app.sides.some((side) => side.frame.count > 0);
    const coverage = view.layers.coverage ? app.surroundings.coverage : null;
    box.hidden = !points && coverage === null;
    if (box.hidden) return;
    if (points && view.colour === "class") count(app, counts);
    // While it plays, counts would only flicker: the classes that are there say enough.
    const classes = [...counts.keys()].sort((a, b) => (counts.get(b) ?? 0) - (counts.get(a) ?? 0));
    for (const id of view.hidden) if (!classes.includes(id)) classes.push(id);
    classes.sort((a, b) => a - b);
    const domain = app.sides[0]?.domain ?? [0, 1];
    const key = [
      view.colour,
      app.theme,
      view.hidden,
      classes,
      domain,
      points,
      coverage?.unit,
      view.from,
      view.to,
    ].join();
    if (key === drawn) return;
    drawn = key;
    const parts: (HTMLElement | null)[] = [];
    if (points) {
      const { label } = DESCRIPTIONS[view.colour];
      summary.textContent = label;
      if (view.colour === "class") parts.push(classChips(app, classes));
      else if (view.colour === "side") {
        parts.push(
          ...scene.sides.map((side, k) => swatch(cssColour(sideColours(app.theme)[k]!), side.name)),
        );
      } else if (view.colour === "sensor") {
        parts.push(
          ...scene.sensors.map((sensor, k) =>
            swatch(cssColour(entry(app.sides[0]!.table, k)), sensor.name),
          ),
        );
      } else if (view.colour === "instance") {
        parts.push(el("p", { className: "hint" }, "Each object a colour; grey belongs to none."));
      } else {
        parts.push(gradient(app, app.sides[0]!.table, domain, true));
      }
    }
    if (!points) summary.textContent = "Ground";
    if (coverage !== null) {
      parts.push(el("h2", {}, `Coverage${coverage.unit ? `, ${coverage.unit}` : ""}`));
      parts.push(gradient(app, coverage.table, coverage.domain, false));
    }
    body.replaceChildren(...parts.filter((part) => part !== null));
  });
  return box;
}

function count(app: App, counts: Map<number, number>): void {
  for (const { frame } of app.sides) {
    const semantic = frame.fields.get("semantic");
    if (semantic === undefined) continue;
    for (let k = 0; k < frame.count; k += 3) {
      counts.set(semantic[k]!, (counts.get(semantic[k]!) ?? 0) + 1);
    }
  }
}

function swatch(colour: string, name: string): HTMLElement {
  const dot = el("i", { className: "dot" });
  dot.style.background = colour;
  return el("span", { className: "swatch" }, dot, name);
}

function classChips(app: App, classes: number[]): HTMLElement {
  const names = new Map(app.scene.classes.map((one) => [one.id, one.name]));
  const chips = classes.map((id) => {
    const dot = el("i", { className: "dot" });
    dot.style.background = cssColour(entry(app.sides[0]!.table, id));
    const { hidden } = app.view;
    return el(
      "button",
      {
        type: "button",
        className: "chip",
        "aria-pressed": String(!hidden.includes(id)),
        title: "Show or hide",
        onclick: () =>
          app.store.set({
            hidden: hidden.includes(id) ? hidden.filter((one) => one !== id) : [...hidden, id],
          }),
      },
      dot,
      names.get(id) ?? `class ${id}`,
    );
  });
  return el(
    "div",
    { className: "chips", role: "group", "aria-label": "Classes of points" },
    ...chips,
  );
}

function gradient(
  app: App,
  table: Uint8Array,
  [low, high]: [number, number],
  editable: boolean,
): HTMLElement {
  const canvas = el("canvas", { className: "gradient", width: 256, height: 1 });
  const brush = canvas.getContext("2d")!;
  brush.putImageData(new ImageData(Uint8ClampedArray.from(table), 256, 1), 0, 0);
  const { colour } = app.view;
  const end = (key: "from" | "to", value: number): HTMLElement => {
    if (!editable) return el("span", {}, String(Number(value.toPrecision(3))));
    const input = el("input", {
      type: "number",
      step: "any",
      value: String(Number(value.toPrecision(4))),
      "aria-label": key === "from" ? "Colours from" : "Colours to",
      onchange: () => {
        const typed = Number(input.value);
        app.store.set({ [key]: input.value === "" || !Number.isFinite(typed) ? null : typed });
      },
    });
    input.title = sayQuantity(colour, value);
    return input;
  };
  return el(
    "div",
    { className: "scale" },
    canvas,
    el("div", { className: "ends" }, end("from", low), end("to", high)),
  );
}
