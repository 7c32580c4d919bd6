// Bundles the page: one script and one style sheet, which the Python package serves and saves.
import { mkdirSync, statSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const folder = join(here, "..", "src", "urbantwin", "web", "page");
mkdirSync(folder, { recursive: true });
await build({
  entryPoints: { page: join(here, "src", "main.ts") },
  outdir: folder,
  bundle: true,
  minify: true,
  format: "iife",
  target: ["es2022"],
  charset: "ascii",
  legalComments: "eof",
  logLevel: "warning",
});
for (const name of ["page.js", "page.css"]) {
  console.log(`${name}: ${Math.round(statSync(join(folder, name)).size / 1024)} KiB`);
}
