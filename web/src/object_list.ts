// The list of objects: filtered, sorted, and only as many rows as are seen.

import type { App } from "./app";
import { rangeOf } from "./box_geometry";
import { boxColours, cssColour } from "./colour";
import { bind, checkbox, choice, el, icon, segments, slider } from "./dom";
import { listed, speedOf, SORTS, type Sort } from "./filters";
import type { Box } from "./frame_data";
import { sensorOrigins } from "./quantity";
import { keyOf } from "./side_view";

const SORT_NAMES: Record<Sort, string> = {
  range: "Range",
  points: "Points",
  class: "Class",
  track: "Track",
  speed: "Speed",
  occlusion: "Occlusion",
  score: "Score",
};

export function objectList(app: App): HTMLElement[] {
  const { store, scene } = app;
  const origins = sensorOrigins(scene);
  const search = el("input", {
    type: "search",
    placeholder: "Find: car, 412, unseen …",
    "aria-label": "Find objects",
    className: "search",
  });
  search.addEventListener("input", () => store.filter({ text: search.value }));
  bind(() => {
    if (document.activeElement !== search) search.value = app.view.filters.text;
  });

  const rows = el("div", { className: "rows", role: "presentation" });
  const scroller = el(
    "div",
    {
      className: "scroller",
      role: "listbox",
      tabIndex: 0,
      "aria-label": "Objects in this frame",
    },
    rows,
  );
  const said = el("p", { className: "count" });
  let order: number[] = [];
  const pool: Row[] = [];
  const current = (): Box[] => app.sides[sideShown(app)]?.boxes ?? [];

  const fill = (): void => {
    const boxes = current();
    const height = rowHeight();
    rows.style.height = `${order.length * height}px`;
    const first = Math.max(0, Math.floor(scroller.scrollTop / height) - 2);
    const count = Math.ceil(scroller.clientHeight / height) + 4;
    while (pool.length < count) {
      const row = new Row(app, `object-row-${pool.length}`);
      pool.push(row);
      rows.append(row.element);
    }
    const colourOf = boxColours(scene, app.theme);
    pool.forEach((row, k) => {
      const at = first + k;
      const index = k < count ? order[at] : undefined;
      row.show(
        index === undefined ? null : boxes[index]!,
        index ?? -1,
        at * height,
        colourOf,
        origins,
      );
    });
    const chosen = pool.find(({ element }) => !element.hidden && element.ariaSelected === "true");
    if (chosen === undefined) scroller.removeAttribute("aria-activedescendant");
    else scroller.setAttribute("aria-activedescendant", chosen.element.id);
  };
  scroller.addEventListener("scroll", fill, { passive: true });
  new ResizeObserver(fill).observe(scroller);
  scroller.addEventListener("keydown", (event) => {
    const move = event.key === "ArrowDown" ? 1 : event.key === "ArrowUp" ? -1 : 0;
    if (move === 0 || order.length === 0) return;
    event.preventDefault();
    event.stopPropagation();
    const boxes = current();
    const at = order.findIndex((k) => keyOf(boxes[k]!, k) === app.view.selected);
    const next = Math.max(0, Math.min(order.length - 1, at + move));
    app.select(keyOf(boxes[order[next]!]!, order[next]!), sideShown(app));
    reveal(next);
  });
  const reveal = (at: number): void => {
    const [top, height] = [at * rowHeight(), rowHeight()];
    if (top < scroller.scrollTop) scroller.scrollTop = top;
    else if (top + height > scroller.scrollTop + scroller.clientHeight) {
      scroller.scrollTop = top + height - scroller.clientHeight;
    }
  };

  let selected: number | null = null;
  bind(() => {
    const boxes = current();
    const { layers, score } = app.view;
    const counts = (k: number): boolean =>
      boxes[k]!.score === null || (layers.detections && boxes[k]!.score! >= score);
    order = listed(boxes, app.view.filters, origins).filter(counts);
    const all = boxes.filter((_, k) => counts(k)).length;
    said.textContent =
      all === 0
        ? "No objects in this frame."
        : order.length === all
          ? `${all} ${all === 1 ? "object" : "objects"}`
          : `${order.length} of ${all} objects`;
    if (app.view.selected !== selected) {
      selected = app.view.selected;
      const at = order.findIndex((k) => keyOf(boxes[k]!, k) === selected);
      if (at >= 0) reveal(at);
    }
    fill();
  });

  const sides =
    scene.sides.length > 1
      ? segments(
          "Objects of which side",
          scene.sides.map((side, k) => [String(k), side.name] as const),
          () => String(sideShown(app)),
          (side) => store.set({ selected: null, selected_side: Number(side) }),
        )
      : null;
  return [el("div", { className: "list-head" }, sides, search, filterBox(app), said), scroller];
}

const rowHeight = (): number => (window.matchMedia("(pointer: coarse)").matches ? 44 : 32);

const sideShown = (app: App): number => app.view.selected_side;

function filterBox(app: App): HTMLElement {
  const { store } = app;
  const filters = (): App["view"]["filters"] => app.view.filters;
  const classes = el("div", { className: "chips", role: "group", "aria-label": "Classes" });
  let known = "";
  bind(() => {
    const names = new Set(app.scene.box_classes.map((one) => one.name));
    for (const side of app.sides) for (const box of side.boxes) names.add(box.class);
    const here = new Set(app.sides.flatMap((side) => side.boxes.map((box) => box.class)));
    const list = [...names].filter((name) => here.has(name) || filters().classes.includes(name));
    const key = list.join() + filters().classes.join() + app.theme;
    if (key === known) return;
    known = key;
    const colourOf = boxColours(app.scene, app.theme);
    classes.replaceChildren(
      ...list.sort().map((name) => {
        const dot = el("i", { className: "dot" });
        dot.style.background = cssColour(colourOf(name));
        const hidden = filters().classes;
        return el(
          "button",
          {
            type: "button",
            className: "chip",
            "aria-pressed": String(!hidden.includes(name)),
            onclick: () =>
              store.filter({
                classes: hidden.includes(name)
                  ? hidden.filter((one) => one !== name)
                  : [...hidden, name],
              }),
          },
          dot,
          name,
        );
      }),
    );
  });
  const order = el(
    "button",
    {
      type: "button",
      className: "icon-button",
      "aria-label": "Turn the order round",
      title: "Turn the order round",
      onclick: () => store.filter({ descending: !filters().descending }),
    },
    icon("up"),
  );
  bind(() => order.replaceChildren(icon(filters().descending ? "down" : "up")));
  const details = el(
    "details",
    { className: "filters" },
    el("summary", {}, "Filter"),
    classes,
    slider(
      "Range up to",
      [5, 300, 5],
      () => Math.min(300, filters().range_m[1]),
      (to) => store.filter({ range_m: [filters().range_m[0], to >= 300 ? 1000 : to] }),
      (value) => (value >= 300 ? "any" : `${value} m`),
    ),
    slider(
      "Points at least",
      [0, 500, 1],
      () => filters().points,
      (points) => store.filter({ points }),
      (value) => String(value),
    ),
    slider(
      "Occlusion up to",
      [0, 1, 0.05],
      () => filters().occlusion,
      (occlusion) => store.filter({ occlusion }),
      (value) => `${Math.round(100 * value)} %`,
    ),
    checkbox(
      "With ignored ones",
      () => filters().ignored,
      (ignored) => store.filter({ ignored }),
    ),
  );
  return el(
    "div",
    { className: "filter-box" },
    el(
      "div",
      { className: "sort" },
      choice(
        "Sort by",
        SORTS.map((sort) => [sort, SORT_NAMES[sort]] as const),
        () => filters().sort,
        (sort) => store.filter({ sort, descending: ["points", "speed", "score"].includes(sort) }),
      ),
      order,
    ),
    details,
  );
}

class Row {
  readonly element: HTMLElement;
  private readonly dot = el("i", { className: "dot" });
  private readonly name = el("span", { className: "name" });
  private readonly first = el("span", { className: "number" });
  private readonly second = el("span", { className: "number" });
  private index = -1;
  private box: Box | null = null;

  constructor(
    private readonly app: App,
    id: string,
  ) {
    this.element = el(
      "div",
      {
        id,
        className: "row",
        role: "option",
        onclick: () => this.choose(),
        ondblclick: () => app.lookAtSelected(),
      },
      this.dot,
      this.name,
      this.first,
      this.second,
    );
  }

  private choose(): void {
    if (this.box === null) return;
    this.app.select(keyOf(this.box, this.index), sideShown(this.app));
    this.app.lookAtSelected();
  }

  show(
    box: Box | null,
    index: number,
    top: number,
    colourOf: (name: string) => [number, number, number],
    origins: [number, number, number][],
  ): void {
    this.box = box;
    this.index = index;
    this.element.hidden = box === null;
    if (box === null) return;
    const { view } = this.app;
    this.element.style.transform = `translateY(${top}px)`;
    this.element.setAttribute("aria-selected", String(keyOf(box, index) === view.selected));
    this.element.classList.toggle("ignored", Boolean(box.ignored));
    this.dot.style.background = cssColour(colourOf(box.class));
    const label = box.track >= 0 ? `${box.class} ${box.track}` : box.class;
    this.name.textContent = box.score === null ? label : `${box.class}, found`;
    this.first.textContent = `${rangeOf(box.box, origins).toFixed(0)} m`;
    this.second.textContent = this.say(box, view.filters.sort);
  }

  /** The last column: what is sorted by, else the points, or the speed where points are not known. */
  private say(box: Box, sort: Sort): string {
    if (box.score !== null) return box.score.toFixed(2);
    if (sort === "occlusion" && box.occlusion !== null)
      return `${Math.round(100 * box.occlusion)} %`;
    const speed = speedOf(box);
    if (speed !== null && (sort === "speed" || box.points === null))
      return `${speed.toFixed(1)} m/s`;
    return box.points === null ? "" : `${box.points} pts`;
  }
}
