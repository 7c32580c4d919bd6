// What is known of the selected object, and of the point that was clicked.

import type { App } from "./app";
import { rangeOf } from "./box_geometry";
import { boxColours, cssColour } from "./colour";
import { bind, el, icon, iconButton, pressed } from "./dom";
import { speedOf } from "./filters";
import type { Box } from "./frame_data";
import { momentOf } from "./paths";
import { DESCRIPTIONS, sensorOrigins, sayQuantity } from "./quantity";
import type { SideView } from "./side_view";

type Row = [string, string];

export function objectPanel(app: App): HTMLElement {
  const body = el("div", {});
  const follow = pressed(
    el(
      "button",
      {
        type: "button",
        className: "button",
        title: "Follow (F)",
        onclick: () => app.store.set({ follow: !app.view.follow }),
      },
      icon("follow"),
      "Follow",
    ),
    () => app.view.follow,
  );
  const chase = pressed(
    el(
      "button",
      { type: "button", className: "button", title: "Chase (C)", onclick: () => toggleChase(app) },
      "Chase",
    ),
    () => app.view.eye === "chase",
  );
  const look = el(
    "button",
    { type: "button", className: "button", onclick: () => app.lookAtSelected() },
    "Look at",
  );
  const actions = el("div", { className: "actions" }, look, follow, chase);
  const title = el("h2", {});
  const panel = el(
    "section",
    { className: "object", "aria-label": "Selected object", "aria-live": "polite" },
    el(
      "div",
      { className: "object-head" },
      title,
      iconButton("close", "Deselect", () => app.select(null), "Esc"),
    ),
    body,
    actions,
  );
  bind(() => {
    const { selected } = app.view;
    panel.hidden = selected === null;
    if (selected === null) return;
    const found = app.selected();
    actions.hidden = found === null;
    if (found === null) {
      title.replaceChildren(selected >= 0 ? `Track ${selected}` : "Object");
      body.replaceChildren(...absent(app, selected));
      return;
    }
    const { box, side, index } = found;
    const dot = el("i", { className: "dot" });
    dot.style.background = cssColour(boxColours(app.scene, app.theme)(box.class));
    title.replaceChildren(
      dot,
      box.track >= 0 && box.score === null ? `${box.class} ${box.track}` : box.class,
    );
    body.replaceChildren(
      ...told(app, box, side, index),
      table(rowsOf(app, box)),
      ...hiders(app, box),
      ...lifeOf(app, box),
    );
  });
  return panel;
}

export function toggleChase(app: App): void {
  if (app.view.eye === "chase") app.store.set({ eye: "orbit" });
  else if (app.selected() === null) app.hint("Select an object first: the eye then chases it.");
  else app.store.set({ eye: "chase" });
}

function table(rows: Row[]): HTMLElement {
  return el(
    "dl",
    { className: "facts" },
    ...rows.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))),
  );
}

/** Sentences first: why it is not seen, what became of it as a detection. */
function told(app: App, box: Box, side: SideView, index: number): HTMLElement[] {
  const sentences: [string, string][] = [];
  const verdict = side.verdicts[index];
  if (app.scene.detections && app.view.layers.detections && verdict) {
    const said = {
      hit: box.score === null ? "A detection hits it." : "Hits a label.",
      miss: "No detection hits it at this score.",
      "false alarm": "A false alarm: there is no such label.",
    }[verdict];
    sentences.push([verdict.replace(" ", "-"), said]);
  }
  if (box.why) sentences.push(["why", box.why]);
  else if (box.ignored) sentences.push(["why", `Ignored: ${box.ignored}.`]);
  return sentences.map(([kind, text]) => el("p", { className: `told ${kind}` }, text));
}

function rowsOf(app: App, box: Box): Row[] {
  const [x, y, z, l, w, h, yaw] = box.box;
  const percent = (value: number | null | undefined): string =>
    value === null || value === undefined ? "not known" : `${Math.round(100 * value)} %`;
  const speed = speedOf(box);
  const rows: (Row | null)[] = [
    box.score === null ? null : ["Score", box.score.toFixed(3)],
    ["Size", `${l.toFixed(2)} × ${w.toFixed(2)} × ${h.toFixed(2)} m`],
    [
      "Speed",
      speed === null ? "not known" : `${speed.toFixed(1)} m/s (${(3.6 * speed).toFixed(0)} km/h)`,
    ],
    ["Range", `${rangeOf(box.box, sensorOrigins(app.scene)).toFixed(1)} m`],
    box.score === null ? ["Points", box.points === null ? "not known" : String(box.points)] : null,
    box.score === null ? ["Occlusion", percent(box.occlusion)] : null,
    box.truncation === null || box.score !== null ? null : ["Truncation", percent(box.truncation)],
    box.score === null ? ["Difficulty", box.difficulty ?? "not graded"] : null,
    box.ignored ? ["Ignored", box.ignored] : null,
    ["Place", `${x.toFixed(2)}, ${y.toFixed(2)}, ${z.toFixed(2)} m`],
    ["Heading", `${((yaw * 180) / Math.PI).toFixed(0)}°`],
  ];
  return rows.filter((row): row is Row => row !== null);
}

/** Whom it is hidden by, each to be selected. */
function hiders(app: App, box: Box): HTMLElement[] {
  if (!box.hidden_by || box.hidden_by.length === 0) return [];
  const links = box.hidden_by.flatMap((track, k) => [
    k > 0 ? ", " : "",
    el(
      "button",
      {
        type: "button",
        className: "link",
        onclick: () => app.select(track, app.view.selected_side),
      },
      String(track),
    ),
  ]);
  return [el("p", { className: "life" }, "Hidden by ", ...links)];
}

/** When the object is there, and ways to its first and last moments. */
function lifeOf(app: App, box: Box): HTMLElement[] {
  const track = app.tracks.get(box.track);
  if (track === undefined || box.score !== null || track.time_s.length === 0) return [];
  const [first, last] = [track.time_s[0]!, track.time_s[track.time_s.length - 1]!];
  return [life(app, first, last)];
}

function life(app: App, first: number, last: number): HTMLElement {
  const start = app.steps[0]?.time_s ?? 0;
  const go = (time_s: number): void => {
    const at = app.steps.findIndex((step) => step.time_s >= time_s - 1e-6);
    app.go(at < 0 ? app.steps.length - 1 : at);
  };
  const button = (text: string, time_s: number): HTMLElement =>
    el("button", { type: "button", className: "link", onclick: () => go(time_s) }, text);
  return el(
    "p",
    { className: "life" },
    "There from ",
    button(`${(first - start).toFixed(1)} s`, first),
    " to ",
    button(`${(last - start).toFixed(1)} s`, last),
  );
}

/** The selected track is not in this frame. */
function absent(app: App, selected: number): HTMLElement[] {
  const track = app.tracks.get(selected);
  if (track === undefined) return [el("p", { className: "told why" }, "It is not in this frame.")];
  const now = momentOf(track, app.time_s);
  const said = now < 0 ? "Not here yet." : "No longer here.";
  return [
    el("p", { className: "told why" }, said),
    life(app, track.time_s[0]!, track.time_s[track.time_s.length - 1]!),
  ];
}

/** The fields of the point that was clicked. */
export function pointCard(app: App): HTMLElement {
  const body = el("div", {});
  const card = el(
    "section",
    { className: "card point-card", "aria-label": "Point" },
    el(
      "div",
      { className: "object-head" },
      el("h2", {}, "Point"),
      iconButton("close", "Close", () => {
        app.picked = null;
        app.invalidate();
      }),
    ),
    body,
  );
  bind(() => {
    card.hidden = app.picked === null;
    if (app.picked !== null) body.replaceChildren(table(pointRows(app)));
  });
  return card;
}

function pointRows(app: App): Row[] {
  const { picked, scene } = app;
  if (picked === null) return [];
  const { frame, side } = app.sides[picked.side]!;
  const k = picked.index;
  const [x, y, z] = [0, 1, 2].map((c) => frame.position[3 * k + c]!) as [number, number, number];
  const sensor = scene.sensors[frame.fields.get("sensor")?.[k] ?? 0];
  const origin = sensor ? [sensor.pose[3]!, sensor.pose[7]!, sensor.pose[11]!] : [0, 0, 0];
  const rows: Row[] = [
    ["Place", `${x.toFixed(3)}, ${y.toFixed(3)}, ${z.toFixed(3)} m`],
    ["Range", `${Math.hypot(x - origin[0]!, y - origin[1]!, z - origin[2]!).toFixed(3)} m`],
    ["Height", `${(z - scene.ground_z).toFixed(2)} m`],
  ];
  if (scene.sides.length > 1) rows.push(["Side", side.name]);
  for (const [name, values] of frame.fields) {
    const value = values[k]!;
    if (name === "semantic") {
      rows.push(["Class", scene.classes.find((one) => one.id === value)?.name ?? String(value)]);
    } else if (name === "sensor") rows.push(["Sensor", sensor?.name ?? String(value)]);
    else if (name === "away") rows.push([DESCRIPTIONS.away.label, sayQuantity("away", value)]);
    else if (name === "time") rows.push(["Time", `${value.toFixed(5)} s`]);
    else if (name === "instance") rows.push(["Instance", value === 0 ? "none" : String(value)]);
    else rows.push([name.charAt(0).toUpperCase() + name.slice(1), String(value)]);
  }
  return rows;
}
