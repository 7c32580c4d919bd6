// The range image under the picture: the same colours, the same selection.

import type { App } from "./app";
import { contains } from "./box_geometry";
import { bind, choice, el, iconButton } from "./dom";
import type { Point3 } from "./document";
import { boxOfPoint } from "./pick";
import { MARK } from "./points";
import { isCategorical } from "./quantity";
import { nearPixel, RangeProjector, type RangeImage } from "./range_image";
import { keyOf, type SideView } from "./side_view";

export function rangePanel(app: App): HTMLElement {
  const { scene } = app;
  const images = app.sides.map((side) => new SideImage(app, side));
  const sensor =
    scene.sensors.length > 1
      ? choice(
          "Sensor",
          scene.sensors.map((one) => [one.name, one.name] as const),
          () => app.sensor()?.name ?? "",
          (name) => app.store.set({ sensor: name }),
        )
      : null;
  const panel = el(
    "section",
    { className: "range", "aria-label": "Range image" },
    el(
      "div",
      { className: "range-head" },
      el("h2", {}, "Range image"),
      sensor,
      el("span", { className: "hint" }, "Forward in the middle, the sensor's left on the left"),
      iconButton(
        "close",
        "Close the range image",
        () => app.store.set({ range_image: false }),
        "R",
      ),
    ),
    el("div", { className: "range-images" }, ...images.map((image) => image.element)),
  );
  bind(() => {
    panel.hidden = !app.view.range_image;
    if (!panel.hidden) for (const image of images) image.update();
  });
  return panel;
}

class SideImage {
  readonly element: HTMLElement;
  private readonly canvas = el("canvas", { className: "range-canvas" });
  private readonly projector = new RangeProjector();
  private readonly said = el("span", { className: "range-said" });
  private image: RangeImage | null = null;
  private pixels: ImageData | null = null;

  constructor(
    private readonly app: App,
    private readonly side: SideView,
  ) {
    this.canvas.addEventListener("click", (event) => this.click(event));
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `Range image of ${side.side.name}`);
    this.element = el("div", { className: "range-image" }, this.canvas, this.said);
  }

  update(): void {
    const { app, side, canvas } = this;
    const sensor = app.sensor();
    const { arrangement } = app.view;
    const alone = app.sides.length > 1 && (arrangement === "first" || arrangement === "second");
    this.element.hidden = alone && side.number !== (arrangement === "first" ? 0 : 1);
    if (sensor === undefined || side.frame.count === 0) {
      this.said.textContent =
        sensor === undefined
          ? "No sensor is known: there is no place to draw a range image from."
          : "No points in this frame.";
      this.image = null;
      canvas.width = canvas.width; // cleared
      return;
    }
    const image = this.projector.project(side.frame, sensor, app.scene.sensors.indexOf(sensor));
    const seen = image.index.some((k) => k >= 0);
    const name = app.sides.length > 1 ? side.side.name : "";
    this.said.textContent = seen ? name : "No points of this sensor in this frame.";
    this.image = image;
    if (canvas.width !== image.width || canvas.height !== image.height) {
      canvas.width = image.width;
      canvas.height = image.height;
      this.pixels = null;
    }
    const brush = canvas.getContext("2d")!;
    this.pixels ??= brush.createImageData(image.width, image.height);
    this.paint(image, this.pixels.data);
    brush.putImageData(this.pixels, 0, 0);
  }

  private paint(image: RangeImage, data: Uint8ClampedArray): void {
    const { app, side } = this;
    const categorical = isCategorical(app.view.colour);
    const selected = side.selectedBox(app.view);
    const accent = app.rgbToken("--accent");
    const { mark } = side.cloud;
    const { position } = side.frame;
    for (let p = 0, at = 0; p < image.index.length; p++, at += 4) {
      const k = image.index[p]!;
      if (k < 0 || mark[k] === MARK.hidden) {
        data[at + 3] = 0;
        continue;
      }
      const inside =
        selected !== undefined &&
        contains(selected.box, position[3 * k]!, position[3 * k + 1]!, position[3 * k + 2]!);
      const [r, g, b] = inside ? accent : side.colourOfPoint(k, categorical);
      data[at] = r;
      data[at + 1] = g;
      data[at + 2] = b;
      data[at + 3] = selected === undefined || inside ? 255 : 130;
    }
  }

  private click(event: MouseEvent): void {
    const { app, side, image, canvas } = this;
    if (image === null) return;
    const box = canvas.getBoundingClientRect();
    const column = Math.floor(((event.clientX - box.left) / box.width) * image.width);
    const row = Math.floor(((event.clientY - box.top) / box.height) * image.height);
    const k = nearPixel(image, column, row);
    if (k < 0) {
      app.picked = null;
      app.select(null);
      app.invalidate();
      return;
    }
    if (app.measure.on) {
      const { position } = side.frame;
      app.measure.take([0, 1, 2].map((c) => position[3 * k + c]!) as Point3);
      app.invalidate();
      return;
    }
    app.picked = { side: side.number, index: k };
    const own = boxOfPoint(side.boxes, side.frame, k);
    app.select(own >= 0 ? keyOf(side.boxes[own]!, own) : null, side.number);
    app.invalidate();
  }
}
