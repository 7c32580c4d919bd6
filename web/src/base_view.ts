// The view that a page opens with: what suits what there is to look at.

import type { Scene } from "./document";
import { offered } from "./quantity";
import { DEFAULT_VIEW, type View } from "./view_state";

/** The view that a scene opens with. */
export function baseView(scene: Scene): View {
  const quantities = offered(scene);
  const pair = scene.sides.length > 1;
  const still = !scene.sides.some((side) => side.point_packet);
  const first = scene.sides[0]?.fields ?? [];
  const colour =
    pair && quantities.includes("away")
      ? "away"
      : quantities.includes("class")
        ? "class"
        : first.includes("intensity")
          ? "intensity"
          : "height";
  return {
    ...DEFAULT_VIEW,
    colour,
    sensor: scene.sensors[0]?.name ?? "",
    layers: { ...DEFAULT_VIEW.layers, twin: still, lanes: still, ignored: still },
  };
}
