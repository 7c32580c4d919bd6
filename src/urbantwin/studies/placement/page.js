"use strict";
(() => {
  const P = PLACEMENT, root = document.getElementById("placement");
  const SVG = "http://www.w3.org/2000/svg";
  const svg = (name, attributes, parent) => {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    if (parent) parent.appendChild(one);
    return one;
  };
  const html = (name, text, parent, kind) => {
    const one = document.createElement(name);
    if (text !== undefined) one.textContent = text;
    if (kind) one.className = kind;
    if (parent) parent.appendChild(one);
    return one;
  };
  const shown = (name, value) => {
    if (name === "cost" || P.measures[name].unit === "m2") return Math.round(value).toLocaleString("en");
    if (P.measures[name].unit === "" && name !== "nuc") return (100 * value).toFixed(1) + " %";
    return value.toFixed(value < 10 ? 2 : 1);
  };
  // Round values between two, about five.
  const ticks = (low, high) => {
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const by = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999);
    const found = [];
    for (let k = Math.ceil(low / by); k * by <= high; k++) found.push(k * by);
    return [found, by];
  };
  const tick = (name, value, by) => {
    const share = P.measures[name].unit === "" && name !== "nuc" && name !== "cost";
    const size = share ? 100 * by : by, digits = Math.max(0, -Math.floor(Math.log10(size) + 1e-9));
    return (share ? 100 * value : value).toLocaleString("en", { maximumFractionDigits: digits }) + (share ? " %" : "");
  };
  const front = new Map(P.front.map((one) => [one.layout, one]));
  let chosen = P.front.length ? P.front[Math.floor(P.front.length / 2)].layout : 0;

  const left = html("div", undefined, root), right = html("div", undefined, root);
  const axes = html("div", undefined, left);
  const picker = (label, start) => {
    const box = html("label", label + " ", axes), list = html("select", undefined, box);
    for (const name of Object.keys(P.measures)) {
      const option = html("option", name, list);
      option.value = name;
    }
    list.value = start;
    list.addEventListener("change", draw);
    return list;
  };
  const others = P.objectives.filter((name) => name !== "cost");
  const across = picker("across", "cost"), up = picker("up", others[0] || "seen_20");
  const chart = svg("svg", { viewBox: "0 0 560 420", role: "img" }, left);
  const steps = html("div", undefined, left);
  const step = (text, by) => html("button", text, steps).addEventListener("click", () => {
    const at = P.front.findIndex((one) => one.layout === chosen);
    chosen = P.front[(at + by + P.front.length) % P.front.length].layout;
    draw();
  });
  step("◀ cheaper", -1);
  step("dearer ▶", 1);
  const title = html("span", "", steps);
  const plan = svg("svg", { viewBox: "0 0 560 560", role: "img" }, right);
  const keys = html("div", undefined, right);
  const details = html("div", undefined, root, "wide");

  function drawChart() {
    chart.replaceChildren();
    const x = across.value, y = up.value;
    const span = (name) => {
      const all = P.layouts.map((one) => one.values[name]);
      const sure = P.layouts[chosen].intervals[name];
      if (sure) all.push(...sure);
      const low = Math.min(...all), high = Math.max(...all), pad = (high - low || 1) * 0.05;
      return [low - pad, high + pad];
    };
    const [x0, x1] = span(x), [y0, y1] = span(y);
    const at = (v) => 62 + (486 * (v - x0)) / (x1 - x0), above = (v) => 372 - (352 * (v - y0)) / (y1 - y0);
    const [alongX, byX] = ticks(x0, x1), [alongY, byY] = ticks(y0, y1);
    for (const w of alongY) {
      svg("line", { x1: 62, x2: 548, y1: above(w), y2: above(w), stroke: "#e3e8ed" }, chart);
      svg("text", { x: 56, y: above(w) + 4, "font-size": 11, "text-anchor": "end" }, chart).textContent = tick(y, w, byY);
    }
    for (const v of alongX) {
      svg("text", { x: Math.min(at(v), 530), y: 388, "font-size": 11, "text-anchor": "middle" }, chart).textContent = tick(x, v, byX);
    }
    const unit = (name) => name + (P.measures[name].unit ? ", " + P.measures[name].unit : "");
    svg("text", { x: 305, y: 410, "font-size": 12, "text-anchor": "middle" }, chart).textContent = unit(x);
    svg("text", { x: 62, y: 13, "font-size": 12 }, chart).textContent = unit(y);
    const order = P.layouts.map((_, n) => n).sort((a, b) => front.has(a) - front.has(b));
    for (const n of order) {
      const one = P.layouts[n], cx = at(one.values[x]), cy = above(one.values[y]);
      const between = one.intervals[y];
      if (n === chosen && between) svg("line", { x1: cx, x2: cx, y1: above(between[0]), y2: above(between[1]), stroke: "#1769e0" }, chart);
      const dot = svg("circle", {
        cx, cy, r: n === chosen ? 8 : front.has(n) ? 5 : 3, class: "dot", tabindex: front.has(n) ? 0 : -1,
        fill: n === chosen ? "#1769e0" : front.has(n) ? "#1d2733" : "#c3ccd6", "fill-opacity": front.has(n) ? 0.9 : 0.6,
      }, chart);
      svg("title", {}, dot).textContent = "layout " + n;
      const pick = () => { chosen = n; draw(); };
      dot.addEventListener("click", pick);
      dot.addEventListener("keydown", (event) => { if (event.key === "Enter") pick(); });
    }
  }

  function drawPlan(marked) {
    plan.replaceChildren();
    const size = 560, scale = size / (2 * P.reach);
    const px = (x) => (x - P.middle[0] + P.reach) * scale, py = (y) => (P.middle[1] + P.reach - y) * scale;
    const colours = { road: "#e9edf1", crossing: "#cfd8e3", building: "#b9c1ca" };
    for (const [name, colour] of Object.entries(colours)) {
      const d = P.plan[name].map((ring) => "M" + ring.map(([x, y]) => px(x).toFixed(1) + " " + py(y).toFixed(1)).join("L") + "Z").join("");
      svg("path", { d, fill: colour, "fill-rule": "evenodd" }, plan);
    }
    const layout = P.layouts[chosen], used = new Set(layout.sensors.map((one) => one.place));
    P.places.forEach((place, n) => {
      if (used.has(n)) return;
      const dot = svg("circle", { cx: px(place.x), cy: py(place.y), r: 2.5, fill: "#7b8794" }, plan);
      svg("title", {}, dot).textContent = place.name;
    });
    const told = front.get(chosen);
    if (told) for (const row of told.hidden) {
      const dot = svg("circle", { cx: px(row[4]), cy: py(row[5]), r: 4, fill: "#d11f3a", "fill-opacity": 0.75 }, plan);
      svg("title", {}, dot).textContent = row[1] + " " + row[0] + ": " + row[3] + " s not seen";
    }
    layout.sensors.forEach((one, n) => {
      const place = P.places[one.place], colour = P.models[one.model].colour;
      if (marked) svg("line", { x1: px(place.x), y1: py(place.y), x2: px(marked[4]), y2: py(marked[5]), stroke: colour, "stroke-dasharray": "5 4" }, plan);
      svg("circle", { cx: px(place.x), cy: py(place.y), r: 8, fill: colour, stroke: "#fff", "stroke-width": 2 }, plan);
      svg("text", { x: px(place.x) + 11, y: py(place.y) + 4, "font-size": 12 }, plan).textContent = (n + 1) + " " + place.name;
    });
    svg("line", { x1: 16, x2: 16 + 20 * scale, y1: 545, y2: 545, stroke: "#1d2733", "stroke-width": 2 }, plan);
    svg("text", { x: 16, y: 538, "font-size": 11 }, plan).textContent = "20 m";
  }

  function table(head, rows, parent, pick) {
    const one = html("table", undefined, parent), top = html("tr", undefined, one);
    head.forEach((text) => html("th", text, top, "text"));
    for (const row of rows) {
      const line = html("tr", undefined, one, pick ? "pick" : "");
      row.cells.forEach((text) => html("td", text, line, "text"));
      if (pick) line.addEventListener("click", () => pick(row.of));
    }
  }

  function drawDetails() {
    details.replaceChildren();
    keys.replaceChildren();
    for (const model of P.models) {
      const label = html("span", undefined, keys);
      const key = html("span", undefined, label, "key");
      key.style.background = model.colour;
      label.append(model.name + "   ");
    }
    html("span", "red: not seen for a while", keys);
    const layout = P.layouts[chosen], told = front.get(chosen);
    title.textContent = " layout " + chosen + (told ? ", on the front" : "");
    html("h2", "Layout " + chosen, details);
    if (told) html("p", "rigs/layout-" + String(chosen).padStart(4, "0") + ".yaml is its rig.", details);
    table(["sensor", "place", "model", "height, m", "down, deg", "turned, deg"], layout.sensors.map((one, n) => ({
      cells: [String(n + 1), P.places[one.place].name, P.models[one.model].name, String(one.height), String(one.tilt), String(one.yaw)],
    })), details);
    html("h3", "Figures", details);
    table(["measure", "value", "95 %", "meaning"], Object.entries(P.measures).map(([name, measure]) => {
      const between = layout.intervals[name];
      return { cells: [name, shown(name, layout.values[name]) + (measure.unit ? " " + measure.unit : ""), between ? shown(name, between[0]) + " to " + shown(name, between[1]) : "", measure.meaning] };
    }), details);
    if (!told) {
      html("p", "Some other layout is as good in every objective and better in one: what hides whom is told of the front.", details);
      return;
    }
    html("h3", "Who is not seen, and why", details);
    html("p", told.unseen + " actors have fewer than 5 points at some moment" + (told.unseen > told.hidden.length ? "; those missed longest" : "") + ". Click a row to see it in the plan.", details);
    table(["actor", "from, s", "for, s", ...layout.sensors.map((one, n) => "behind, from " + (n + 1) + " (" + P.places[one.place].name + ")")],
      told.hidden.map((row) => ({ cells: [row[1] + " " + row[0], String(row[2]), String(row[3]), ...row[6]], of: row })),
      details, drawPlan);
    html("h3", "Points by class and range", details);
    table(["class", "from the nearest sensor, m", "actor-seconds", "points", "5 or more", "20 or more", "50 or more"],
      told.classes.map((row) => ({
        cells: [row[0], row[1] + (row[2] === null ? " and more" : " to " + row[2]), String(row[3]), String(row[4]), ...row.slice(5).map((share) => (100 * share).toFixed(0) + " %")],
      })), details);
  }

  function draw() {
    drawChart();
    drawPlan();
    drawDetails();
  }
  draw();
})();
