// The left panel: how points look, which layers are seen, the section plane, detections.

import type { App } from "./app";
import { bind, checkbox, choice, el, section, segments, slider } from "./dom";
import { DESCRIPTIONS, offered } from "./quantity";
import { countVerdicts } from "./verdicts";
import type { Layer } from "./view_state";

const LAYER_NAMES: Record<Layer, [string, string]> = {
  points: ["Points", "P"],
  boxes: ["Boxes", "B"],
  ignored: ["Ignored objects", "I"],
  names: ["Names", "N"],
  path: ["Path of the selected", ""],
  detections: ["Detections", ""],
  twin: ["Twin", "W"],
  lanes: ["Lanes", ""],
  signals: ["Signals", ""],
  sensors: ["Sensors and fields of view", ""],
  coverage: ["Coverage", ""],
  grid: ["Grid, 10 m", ""],
};

export function settingsPanel(app: App): HTMLElement[] {
  const { store, scene } = app;
  const groups: (HTMLElement | null)[] = [
    scene.sides.length > 1 ? sidesGroup(app) : null,
    scene.sides.some((side) => side.point_packet) ? pointsGroup(app) : null,
    layersGroup(app),
    scene.detections ? detectionsGroup(app) : null,
    sectionGroup(app),
    section(
      "Look",
      slider(
        "Fog of distance",
        [0, 1, 0.01],
        () => app.view.fog,
        (fog) => store.set({ fog }),
        (value) => (value === 0 ? "off" : `${Math.round(100 * value)} %`),
      ),
      segments(
        "Light or dark",
        [
          ["auto", "Auto", "As the system is"],
          ["light", "Light"],
          ["dark", "Dark"],
        ],
        () => app.view.theme,
        (theme) => store.set({ theme }),
      ),
    ),
    scene.attribution.length > 0
      ? el("p", { className: "attribution" }, scene.attribution.join(" · "))
      : null,
  ];
  return groups.filter((group) => group !== null);
}

function sidesGroup(app: App): HTMLElement {
  const [first, second] = app.scene.sides;
  return section(
    "Sides",
    segments(
      "How the sides are arranged",
      [
        ["beside", "Beside", "Side by side"],
        ["over", "Over", "One over the other"],
        ["first", "Left", `Only ${first!.name}`],
        ["second", "Right", `Only ${second!.name}`],
      ],
      () => app.view.arrangement,
      (arrangement) => app.store.set({ arrangement }),
    ),
  );
}

function pointsGroup(app: App): HTMLElement {
  const { store } = app;
  const quantities = offered(app.scene);
  return section(
    "Points",
    choice(
      "Colour by",
      quantities.map((quantity) => [quantity, DESCRIPTIONS[quantity].label] as const),
      () => app.view.colour,
      (colour) => store.set({ colour, from: null, to: null }),
    ),
    slider(
      "Size",
      [0.25, 4, 0.05],
      () => app.view.size,
      (size) => store.set({ size }),
      (value) => `${value.toFixed(2)}×`,
    ),
    checkbox(
      "Ground",
      () => app.view.ground,
      (ground) => store.set({ ground }),
      "G",
    ),
  );
}

function layersGroup(app: App): HTMLElement {
  const { scene } = app;
  const has = (what: "point_packet" | "box_packet"): boolean =>
    scene.sides.some((side) => side[what]);
  const layers: Layer[] = [
    ...(has("point_packet") ? (["points"] as const) : []),
    ...(has("box_packet") ? (["boxes", "ignored", "names"] as const) : []),
    ...(scene.tracks !== null ? (["path"] as const) : []),
    ...app.surroundings.offered,
  ];
  return section(
    "Layers",
    ...layers.map((layer) =>
      checkbox(
        LAYER_NAMES[layer][0],
        () => app.view.layers[layer],
        (on) => app.store.layer(layer, on),
        LAYER_NAMES[layer][1],
      ),
    ),
  );
}

function detectionsGroup(app: App): HTMLElement {
  const counts = el("dl", { className: "counts" });
  bind(() => {
    const side = app.sides.find(({ boxes }) => boxes.some((box) => box.score !== null));
    const { hits, misses, falseAlarms } = countVerdicts(side?.boxes ?? [], side?.verdicts ?? []);
    const share = (of: number, all: number): string =>
      all > 0 ? `${Math.round((100 * of) / all)} %` : "–";
    const rows: [string, string, string][] = [
      ["hit", "Hits", String(hits)],
      ["miss", "Misses", String(misses)],
      ["false-alarm", "False alarms", String(falseAlarms)],
      ["", "Precision", share(hits, hits + falseAlarms)],
      ["", "Recall", share(hits, hits + misses)],
    ];
    counts.replaceChildren(
      ...rows.map(([kind, name, value]) =>
        el(
          "div",
          {},
          el("dt", {}, kind ? el("i", { className: `dot ${kind}` }) : null, name),
          el("dd", {}, value),
        ),
      ),
    );
  });
  return section(
    "Detections",
    checkbox(
      "Over the labels",
      () => app.view.layers.detections,
      (on) => app.store.layer("detections", on),
    ),
    slider(
      "Score at least",
      [0, 1, 0.01],
      () => app.view.score,
      (score) => app.store.set({ score }),
      (value) => value.toFixed(2),
    ),
    el("p", { className: "hint" }, "This frame at this score:"),
    counts,
  );
}

function sectionGroup(app: App): HTMLElement {
  const { store } = app;
  const on = checkbox(
    "Cut by a plane",
    () => app.view.section,
    (value) => toggleSection(app, value),
    "X",
  );
  const inner = el(
    "div",
    { className: "inner" },
    segments(
      "Direction of the plane",
      [
        ["east", "East", "Cuts what is further east"],
        ["north", "North", "Cuts what is further north"],
        ["up", "Up", "Cuts what is higher"],
        ["eye", "Facing", "Faces the eye as it is now"],
      ],
      () => {
        const { section_level, section_turn_deg } = app.view;
        if (section_level) return "up";
        return section_turn_deg === 0 ? "east" : section_turn_deg === 90 ? "north" : "eye";
      },
      (way) => turnSection(app, way),
    ),
    slider(
      "At",
      [-120, 120, 0.1],
      () => app.view.section_at_m,
      (section_at_m) => store.set({ section_at_m }),
      (value) => `${value.toFixed(1)} m`,
    ),
    slider(
      "Thickness",
      [0, 30, 0.1],
      () => app.view.section_thick_m,
      (section_thick_m) => store.set({ section_thick_m }),
      (value) => (value === 0 ? "all behind" : `${value.toFixed(1)} m`),
    ),
    el("p", { className: "hint" }, "Or drag the arrow in the picture."),
  );
  bind(() => (inner.hidden = !app.view.section));
  return section("Section", on, inner);
}

/** Switches the section on where the eye looks, or off. */
export function toggleSection(app: App, on: boolean): void {
  app.store.set({ section: on });
  if (on) turnSection(app, app.view.section_level ? "up" : "east");
}

function turnSection(app: App, way: "east" | "north" | "up" | "eye"): void {
  const { target } = app.eyes;
  const toEye = app.eyes.camera.position.clone().sub(target);
  const turn =
    way === "east" ? 0 : way === "north" ? 90 : (Math.atan2(toEye.y, toEye.x) * 180) / Math.PI;
  const radians = (turn * Math.PI) / 180;
  const at =
    way === "up" ? target.z + 3 : Math.cos(radians) * target.x + Math.sin(radians) * target.y;
  app.store.set({
    section_level: way === "up",
    section_turn_deg: Math.round(turn * 10) / 10,
    section_at_m: Math.round(at * 10) / 10,
  });
}
