// Colours as tables of 256 entries: what the shader looks up, and the range image and legends, too.

import type { Rgb, Scene } from "./document";

/** Names of the classes that are ground. */
export const GROUND_CLASSES =
  /^(road|parking|sidewalk|other-ground|terrain|lane-marking|marking|ground|curb|crossing|water)$/;

export type Theme = "light" | "dark";

/** sRGB, 0..255, to OKLab (Ottosson 2020): lightness 0..1, a, b. */
export function oklabOf([r, g, b]: Rgb): [number, number, number] {
  const linear = (c: number): number => {
    const v = c / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  };
  const [lr, lg, lb] = [linear(r), linear(g), linear(b)];
  const l = Math.cbrt(0.4122214708 * lr + 0.5363325363 * lg + 0.0514459929 * lb);
  const m = Math.cbrt(0.2119034982 * lr + 0.6806995451 * lg + 0.1073969566 * lb);
  const s = Math.cbrt(0.0883024619 * lr + 0.2817188376 * lg + 0.6299787005 * lb);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

/** OKLab to sRGB, 0..255, cut at the gamut. */
export function rgbOfOklab([L, a, b]: [number, number, number]): Rgb {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const byte = (c: number): number => {
    const v = c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055;
    return Math.round(255 * Math.min(1, Math.max(0, v)));
  };
  return [
    byte(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
    byte(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
    byte(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
  ];
}

/** The colour with its lightness brought to where it is seen on the theme's background. */
export function readable(colour: Rgb, theme: Theme): Rgb {
  const [L, a, b] = oklabOf(colour);
  const [low, high] = theme === "dark" ? [0.56, 0.95] : [0.3, 0.68];
  if (L >= low && L <= high) return colour;
  return rgbOfOklab([Math.min(high, Math.max(low, L)), a, b]);
}

const GROUND_CHROMA = 0.055;
const CLASS_CHROMA = 0.15;

/**
 * The colour of a class as points are drawn in it: its own hue, less loud. What covers most of a
 * picture, the ground, is the calmest, so that what stands on it is seen.
 */
export function calm(colour: Rgb, theme: Theme, ground: boolean): Rgb {
  const [L, a, b] = oklabOf(readable(colour, theme));
  const chroma = Math.hypot(a, b);
  const most = ground ? GROUND_CHROMA : CLASS_CHROMA;
  const share = chroma > most ? most / chroma : 1;
  const level = ground ? (theme === "dark" ? Math.min(L, 0.6) : Math.max(L, 0.6)) : L;
  return rgbOfOklab([level, share * a, share * b]);
}

export const cssColour = ([r, g, b]: Rgb): string => `rgb(${r} ${g} ${b})`;

// Anchors of the tables: viridis and turbo as matplotlib has them; "away" from calm to alarming.
const ANCHORS: Record<string, string[]> = {
  viridis: [
    "440154",
    "472d7b",
    "3b528b",
    "2c728e",
    "21918c",
    "28ae80",
    "5ec962",
    "addc30",
    "fde725",
  ],
  turbo: ["30123b", "4662d7", "36aaf9", "1ae4b6", "72fe5e", "c8ef34", "faba39", "f66b19", "ca2a04"],
  away: ["6f8796", "8aa08f", "cdbf5a", "f0a63a", "ee6c2f", "d92f5c", "b0179e"],
};

export type Table = Uint8Array<ArrayBuffer>; // 256 × RGBA

/** A continuous table of 256 colours, readable in the theme. */
export function gradientTable(name: string, theme: Theme): Table {
  const anchors = (ANCHORS[name] ?? ANCHORS["viridis"]!).map((hex): Rgb => {
    const n = parseInt(hex, 16);
    return [n >> 16, (n >> 8) & 255, n & 255];
  });
  return tableOf((k) => {
    const at = (k / 255) * (anchors.length - 1);
    const below = Math.min(anchors.length - 2, Math.floor(at));
    const [from, to] = [anchors[below]!, anchors[below + 1]!];
    const mix = (c: number): number => Math.round(from[c]! + (at - below) * (to[c]! - from[c]!));
    return readable([mix(0), mix(1), mix(2)], theme);
  });
}

/** The colours of the semantic classes at their numbers; grey where there is no class. */
export function classTable(scene: Scene, theme: Theme): Table {
  const grey: Rgb = theme === "dark" ? [128, 136, 144] : [128, 134, 140];
  const classes = new Map(scene.classes.map((one) => [one.id & 255, one]));
  classes.delete(0);
  return tableOf((k) => {
    const one = classes.get(k);
    return one ? calm(one.colour, theme, GROUND_CLASSES.test(one.name)) : grey;
  });
}

/** Colours that tell neighbours apart: hues a golden angle apart, grey at 0 (no object). */
export function instanceTable(theme: Theme): Table {
  const lightness = theme === "dark" ? 0.76 : 0.55;
  return tableOf((k) => {
    if (k === 0) return theme === "dark" ? [92, 100, 108] : [170, 176, 182];
    const hue = k * 2.399963229728653;
    return rgbOfOklab([lightness, 0.13 * Math.cos(hue), 0.13 * Math.sin(hue)]);
  });
}

/** The two sides of a pair: real, synthetic. */
export function sideColours(theme: Theme): [Rgb, Rgb] {
  return theme === "dark"
    ? [
        [255, 178, 84],
        [92, 182, 255],
      ]
    : [
        [201, 104, 0],
        [0, 112, 214],
      ];
}

/** A table of a few colours that repeat: sensors, sides. */
export function listTable(colours: Rgb[]): Table {
  return tableOf((k) => colours[k % colours.length]!);
}

export function entry(table: Table, k: number): Rgb {
  const at = 4 * Math.min(255, Math.max(0, k));
  return [table[at]!, table[at + 1]!, table[at + 2]!];
}

/** The colours of boxes by class, readable in the theme; one of its own for a class without any. */
export function boxColours(scene: Scene, theme: Theme): (name: string) => Rgb {
  const colours = new Map<string, Rgb>();
  for (const one of scene.classes) colours.set(one.name, calm(one.colour, theme, false));
  for (const one of scene.box_classes) colours.set(one.name, calm(one.colour, theme, false));
  const spare = instanceTable(theme);
  return (name) => {
    let colour = colours.get(name);
    if (colour === undefined) {
      let hash = 1;
      for (const letter of name) hash = (hash * 31 + letter.charCodeAt(0)) & 0xff;
      colour = entry(spare, hash || 1);
      colours.set(name, colour);
    }
    return colour;
  };
}

function tableOf(colourAt: (k: number) => Rgb): Table {
  const table = new Uint8Array(1024);
  for (let k = 0; k < 256; k++) {
    const [r, g, b] = colourAt(k);
    table.set([r, g, b, 255], 4 * k);
  }
  return table;
}
