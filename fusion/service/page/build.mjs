// Bundles src/ into static/: scripts with a digest in their names, one style sheet, index.html.
import { build } from "esbuild";
import { mkdir, readdir, readFile, rename, rm, writeFile } from "node:fs/promises";
import { basename, dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const made = join(here, "static.new");
await rm(made, { recursive: true, force: true });
await mkdir(made);

// Workers are files of their own; their addresses stand in the scripts as WORKER_NAME.
const files = await readdir(join(here, "src"), { recursive: true });
const workers = await build({
  absWorkingDir: here,
  entryPoints: files.filter((path) => path.endsWith(".worker.ts")).map((path) => join("src", path)),
  outdir: made,
  entryNames: "[name]-[hash]",
  bundle: true,
  format: "esm",
  target: "es2022",
  minify: true,
  metafile: true,
});
const addresses = {};
for (const [path, output] of Object.entries(workers.metafile.outputs)) {
  const name = basename(output.entryPoint, ".worker.ts").toUpperCase();
  addresses[`WORKER_${name}`] = JSON.stringify(`/static/${basename(path)}`);
}

const result = await build({
  define: addresses,
  absWorkingDir: here,
  entryPoints: ["src/main.ts", "src/style.css"],
  outdir: made,
  entryNames: "[name]-[hash]",
  chunkNames: "[name]-[hash]",
  assetNames: "[name]-[hash]",
  bundle: true,
  splitting: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "none",
  metafile: true,
  logLevel: "warning",
});

const entries = {};
for (const [path, output] of Object.entries(result.metafile.outputs)) {
  if (output.entryPoint) entries[basename(output.entryPoint)] = basename(path);
}
// All files of a view are asked for at once, not each when the one that imports it has come.
const filesOf = (path) => {
  const inner = result.metafile.outputs[path].imports.filter(({ kind }) => kind === "import-statement");
  return [path, ...inner.flatMap((one) => filesOf(one.path))];
};
const needed = (path) => [...new Set(filesOf(path))].map((one) => `/static/${basename(one)}`);
const outputs = Object.entries(result.metafile.outputs);
const [main] = outputs.find(([, { entryPoint }]) => entryPoint === "src/main.ts");
const views = {};
for (const [path, { entryPoint }] of outputs) {
  const name = /^src\/views\/(\w+)(\/index)?\.ts$/.exec(entryPoint ?? "")?.[1];
  if (name) views[name] = needed(path).filter((one) => !needed(main).includes(one));
}
const preloads = needed(main).slice(1).map((href) => `<link rel="modulepreload" href="${href}">`);

let index = await readFile(join(here, "src", "index.html"), "utf8");
for (const [source, file] of Object.entries(entries)) index = index.replace(`{${source}}`, file);
index = index.replace("{preloads}", preloads.join("\n    ")).replace("{views}", JSON.stringify(views));
await writeFile(join(made, "index.html"), index);

// The licences of the libraries ask that their texts go with them.
const sources = { ...workers.metafile.inputs, ...result.metafile.inputs };
const inputs = Object.keys(sources).map((path) => /node_modules\/((@[^/]+\/)?[^/]+)\//.exec(path)?.[1]);
let licences = "";
for (const name of [...new Set(inputs.filter(Boolean))].sort()) {
  const folder = join(here, "node_modules", name);
  const file = (await readdir(folder)).find((one) => /^licen[sc]e/i.test(one));
  if (!file) throw new Error(`${name} has no licence text`);
  licences += `${name}\n\n${await readFile(join(folder, file), "utf8")}\n\n`;
}
await writeFile(join(made, "LICENSES.txt"), licences);

// Swapped at the end: a build that fails leaves the page as it was.
await rm(join(here, "static"), { recursive: true, force: true });
await rename(made, join(here, "static"));
const bytes = Object.values(result.metafile.outputs).reduce((sum, one) => sum + one.bytes, 0);
console.log(`page: ${Object.keys(result.metafile.outputs).length} files, ${(bytes / 1e6).toFixed(2)} MB`);
