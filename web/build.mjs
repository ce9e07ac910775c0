// Bundles the page: node build.mjs [FOLDER]. The same sources give the same bytes.

import { build } from 'esbuild';
import { copyFileSync, mkdirSync, readdirSync, rmSync, statSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = fileURLToPath(new URL('.', import.meta.url));
const out = resolve(process.argv[2] ?? join(here, '../coastwatch/operators/web'));
const target = ['chrome120', 'firefox120', 'safari17'];
rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });

const shared = { absWorkingDir: here, bundle: true, minify: true, target };
await build({ ...shared, entryPoints: ['src/main.js'], format: 'esm', outdir: out, legalComments: 'linked' });
await build({
  stdin: { contents: '@import "maplibre-gl/dist/maplibre-gl.css"; @import "./style.css";', loader: 'css', resolveDir: here },
  ...shared, outfile: join(out, 'main.css'),
});
const copies = {
  'index.html': 'index.html',
  // MapLibre 6 starts its worker from a file of its own, which a bundler leaves out.
  'node_modules/maplibre-gl/dist/maplibre-gl-worker.mjs': 'maplibre-gl-worker.mjs',
};
for (const [from, to] of Object.entries(copies)) copyFileSync(join(here, from), join(out, to));
const files = readdirSync(out);
const bytes = files.reduce((sum, name) => sum + statSync(join(out, name)).size, 0);
console.log(`The map is built: ${files.length} files, ${(bytes / 1e6).toFixed(1)} MB.`);
