// Bundles the page, or with `tests` the tests, into target/.
import { readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { build, transform } from "esbuild";
import { rollup } from "rollup";

const common = {
  bundle: true,
  format: "esm",
  target: "es2022",
  logLevel: "warning",
  sourcemap: true,
  jsx: "automatic",
  jsxImportSource: "preact",
};

const SMALL = { minify: true, target: common.target };

/** How the page is bundled. Code behind an `import()` is a file of its own. */
export const PAGE = {
  ...common,
  entryPoints: ["src/main.ts"],
  outdir: "target/page",
  platform: "browser",
  splitting: true,
};

/** Bundles the page. What `main.js` needs at once is all in it: esbuild makes some twenty files of that. */
async function bundlePage() {
  const parts = "target/parts";
  for (const folder of [parts, PAGE.outdir]) {
    rmSync(folder, { recursive: true, force: true });
  }
  await build({ ...PAGE, outdir: parts, sourcemap: false });
  const minify = { name: "minify", renderChunk: (code) => transform(code, { ...SMALL, format: "esm" }) };
  const bundle = await rollup({ input: `${parts}/main.js`, treeshake: false, plugins: [minify] });
  await bundle.write({ dir: PAGE.outdir });
  const css = await transform(readFileSync(`${parts}/main.css`), { ...SMALL, loader: "css" });
  writeFileSync(`${PAGE.outdir}/main.css`, css.code);
  for (const name of readdirSync(PAGE.outdir)) {
    // The program has them in it, and sends what a browser reads.
    const file = `${PAGE.outdir}/${name}`;
    const bytes = readFileSync(file);
    writeFileSync(`${file}.br`, brotliCompressSync(bytes));
    writeFileSync(`${file}.gz`, gzipSync(bytes, { level: 9 }));
  }
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  if (process.argv[2] === "tests") {
    const tests = readdirSync("tests").filter(
      (name) =>
        name.endsWith(".test.ts") || ["driver.ts", "hardCases.ts", "panel.ts", "sensors.ts"].includes(name),
    );
    await build({
      ...common,
      entryPoints: tests.map((name) => `tests/${name}`),
      outdir: "target/tests",
      outExtension: { ".js": ".mjs" },
      platform: "node",
      packages: "external",
      inject: ["tests/webCrypto.ts"],
    });
  } else {
    await bundlePage();
  }
}
