// Bundles the page: one script and one style sheet, which the Python package serves and saves.
import { existsSync, mkdirSync, readFileSync, statSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const folder = join(here, "..", "src", "urbantwin", "web", "page");
const options = {
  absWorkingDir: here,
  entryPoints: { page: join(here, "src", "main.ts") },
  outdir: folder,
  bundle: true,
  minify: true,
  format: "iife",
  target: ["es2022"],
  charset: "ascii",
  legalComments: "none",
  logLevel: "warning",
};

// The licence of every bundled package goes where its code goes: into the wheel and into every saved page.
function licences(inputs) {
  const found = Object.keys(inputs).map((path) => /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(path)?.[1]);
  return [...new Set(found)].filter((name) => name !== undefined).sort().map((name) => {
    const file = ["LICENSE", "LICENSE.md", "LICENSE.txt", "LICENCE"]
      .map((each) => join(here, "node_modules", name, each)).find(existsSync);
    if (file === undefined) throw new Error(`${name} is bundled and has no licence file`);
    const text = readFileSync(file, "utf8").trim().replaceAll("\u00a9", "(c)");
    return `/*! ${name === "three" ? "three.js" : name}\n\n${text}\n*/`;
  });
}

const { metafile } = await build({ ...options, write: false, metafile: true });
mkdirSync(folder, { recursive: true });
await build({ ...options, banner: { js: licences(metafile.inputs).join("\n") } });
for (const name of ["page.js", "page.css"]) {
  console.log(`${name}: ${Math.round(statSync(join(folder, name)).size / 1024)} KiB`);
}
