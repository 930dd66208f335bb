// Bundles the page, or with `tests` the tests, into target/.
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { build } from "esbuild";

const common = {
  bundle: true,
  format: "esm",
  target: "es2022",
  logLevel: "warning",
  sourcemap: true,
  jsx: "automatic",
  jsxImportSource: "preact",
};

/** How the page is bundled. */
export const PAGE = {
  ...common,
  entryPoints: ["src/main.ts"],
  outdir: "target/page",
  platform: "browser",
  minify: true,
};

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
    await build(PAGE);
    for (const name of ["main.js", "main.css"]) {
      // The program has them in it, and sends what a browser reads.
      const file = `${PAGE.outdir}/${name}`;
      const bytes = readFileSync(file);
      writeFileSync(`${file}.br`, brotliCompressSync(bytes));
      writeFileSync(`${file}.gz`, gzipSync(bytes, { level: 9 }));
    }
  }
}
