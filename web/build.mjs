// Bundles the page: one script and one style sheet, which the Python package serves and saves.
import { mkdirSync, readFileSync, statSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const folder = join(here, "..", "src", "urbantwin", "web", "page");
// The licence goes where the code goes: into the wheel and into every saved page.
const licence = readFileSync(join(here, "node_modules", "three", "LICENSE"), "utf8").trim().replace("\u00a9", "(c)");
mkdirSync(folder, { recursive: true });
await build({
  entryPoints: { page: join(here, "src", "main.ts") },
  outdir: folder,
  bundle: true,
  minify: true,
  format: "iife",
  target: ["es2022"],
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/*! three.js\n\n${licence}\n*/` },
  logLevel: "warning",
});
for (const name of ["page.js", "page.css"]) {
  console.log(`${name}: ${Math.round(statSync(join(folder, name)).size / 1024)} KiB`);
}
