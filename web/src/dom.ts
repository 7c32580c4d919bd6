// Elements of the page: built here, kept up to date by the functions that `bind` collects.

type Child = Node | string | null | undefined | false;
type Properties = Record<string, unknown>;

/** Builds an element; `on…` are listeners, `aria…`, `data…` and `role` attributes, the rest properties. */
export function el<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (value === undefined || value === null) continue;
    if (key.startsWith("on")) {
      element.addEventListener(key.slice(2), value as EventListener);
    } else if (key.includes("-") || ["role", "for", "list"].includes(key)) {
      element.setAttribute(key, String(value));
    } else {
      (element as unknown as Properties)[key] = value;
    }
  }
  for (const child of children) if (child) element.append(child);
  return element;
}

const SVG = "http://www.w3.org/2000/svg";
// Strokes in a square of 16.
const ICONS: Record<string, string> = {
  play: "M5 3.2v9.6l7.6-4.8z",
  pause: "M5.5 3.5v9M10.5 3.5v9",
  back: "M10.5 3.5 6 8l4.5 4.5M4 3.5v9",
  next: "M5.5 3.5 10 8l-4.5 4.5M12 3.5v9",
  loop: "M3 7a4.6 4.6 0 0 1 4.6-4H13M13 3l-2-1.8M13 3l-2 1.8M13 9a4.6 4.6 0 0 1-4.6 4H3M3 13l2 1.8M3 13l2-1.8",
  earlier: "M8 3.5 3.5 8 8 12.5M13 3.5 8.5 8l4.5 4.5",
  later: "M8 3.5 12.5 8 8 12.5M3 3.5 7.5 8 3 12.5",
  sliders:
    "M2 4.5h7M12.5 4.5H14M2 11.5h1.5M7 11.5h7M10.7 6.2a1.7 1.7 0 1 0 0-3.4 1.7 1.7 0 0 0 0 3.4ZM5.3 13.2a1.7 1.7 0 1 0 0-3.4 1.7 1.7 0 0 0 0 3.4Z",
  list: "M5.5 4H14M5.5 8H14M5.5 12H14M2.2 4h.6M2.2 8h.6M2.2 12h.6",
  ruler: "M1.8 10.4 10.4 1.8l3.8 3.8-8.6 8.6zM4.4 7.8l1.6 1.6M6.8 5.4l2.2 2.2M9.2 3l1.6 1.6",
  image: "M2 3.5h12v9H2zM2 6.5h12M2 9.5h12M6 3.5v9M10 3.5v9",
  section: "M3 13V5l5-3v8zM8 10l5 3V5L8 2",
  share: "M8 10V2M5 4.8 8 1.8l3 3M3.5 8v5.5h9V8",
  camera: "M2 5h3l1.2-2h3.6L11 5h3v8H2zM8 11.2a2.4 2.4 0 1 0 0-4.8 2.4 2.4 0 0 0 0 4.8Z",
  film: "M2 4h8.5v8H2zM10.5 7 14 5v6l-3.5-2",
  stop: "M4 4h8v8H4z",
  theme: "M8 13.5a5.5 5.5 0 1 0 0-11v11ZM8 2.5a5.5 5.5 0 0 0 0 11",
  help: "M5.8 6a2.2 2.2 0 1 1 3.4 1.9c-.8.5-1.2.9-1.2 1.9M8 12.3v.3",
  close: "M4 4l8 8M12 4l-8 8",
  follow: "M8 2v3M8 11v3M2 8h3M11 8h3M8 10a2 2 0 1 0 0-4 2 2 0 0 0 0 4Z",
  up: "M8 12.5v-9M4.5 7 8 3.5 11.5 7",
  down: "M8 3.5v9M4.5 9 8 12.5 11.5 9",
  flag: "M4 14V2.5h8L10 5.5l2 3H4",
};

export function icon(name: string): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  svg.classList.add("icon");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", ICONS[name] ?? "");
  svg.append(path);
  return svg;
}

export function iconButton(
  name: string,
  label: string,
  onclick: (event: MouseEvent) => void,
  key = "",
): HTMLButtonElement {
  const title = key ? `${label} (${key})` : label;
  return el(
    "button",
    { type: "button", className: "icon-button", title, "aria-label": label, onclick },
    icon(name),
  );
}

/** Changes an icon button's icon and label. */
export function setIcon(button: HTMLButtonElement, name: string, label: string): void {
  if (button.getAttribute("aria-label") === label) return;
  button.setAttribute("aria-label", label);
  button.title = label;
  button.replaceChildren(icon(name));
}

const bound: (() => void)[] = [];

/** Runs a function now and whenever the page is brought up to date. */
export function bind(update: () => void): void {
  bound.push(update);
}

export function updateBound(): void {
  for (const update of bound) update();
}

export function section(title: string, ...children: Child[]): HTMLElement {
  return el("section", { className: "group" }, el("h2", {}, title), ...children);
}

export function checkbox(
  label: string,
  get: () => boolean,
  set: (on: boolean) => void,
  key = "",
): HTMLLabelElement {
  const input = el("input", {
    type: "checkbox",
    onchange: () => set(input.checked),
  });
  bind(() => (input.checked = get()));
  const hint = key ? el("kbd", {}, key) : null;
  return el("label", { className: "check" }, input, el("span", {}, label), hint);
}

export function slider(
  label: string,
  [low, high, step]: [number, number, number],
  get: () => number,
  set: (value: number) => void,
  say: (value: number) => string,
): HTMLLabelElement {
  const said = el("output", {});
  const input = el("input", {
    type: "range",
    min: String(low),
    max: String(high),
    step: String(step),
  });
  input.addEventListener("input", () => set(Number(input.value)));
  bind(() => {
    const value = get();
    input.value = String(value);
    input.style.setProperty("--share", String((Number(input.value) - low) / (high - low || 1)));
    said.textContent = say(value);
    input.setAttribute("aria-valuetext", said.textContent);
  });
  return el("label", { className: "slider" }, el("span", {}, label), said, input);
}

export function choice<T extends string>(
  label: string,
  options: readonly (readonly [T, string])[],
  get: () => T,
  set: (value: T) => void,
): HTMLLabelElement {
  const input = el(
    "select",
    { onchange: () => set(input.value as T) },
    ...options.map(([value, text]) => el("option", { value }, text)),
  ) as HTMLSelectElement;
  bind(() => (input.value = get()));
  return el("label", { className: "choice" }, el("span", {}, label), input);
}

/** Buttons of which one is pressed. */
export function segments<T extends string>(
  label: string,
  options: readonly (readonly [T, string, string?])[],
  get: () => T,
  set: (value: T) => void,
): HTMLDivElement {
  const buttons = options.map(([value, text, title]) => {
    const button = el(
      "button",
      { type: "button", title: title ?? text, onclick: () => set(value) },
      text,
    );
    bind(() => button.setAttribute("aria-pressed", String(get() === value)));
    return button;
  });
  return el("div", { className: "segments", role: "group", "aria-label": label }, ...buttons);
}

/** A toggle that looks like a button. */
export function pressed(button: HTMLButtonElement, get: () => boolean): HTMLButtonElement {
  bind(() => button.setAttribute("aria-pressed", String(get())));
  return button;
}

export const typing = (target: EventTarget | null): boolean =>
  target instanceof HTMLElement &&
  (target.isContentEditable ||
    target instanceof HTMLTextAreaElement ||
    target instanceof HTMLSelectElement ||
    (target instanceof HTMLInputElement && !["checkbox", "range", "button"].includes(target.type)));
