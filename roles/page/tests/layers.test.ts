/** Folders of the page import only from folders below them. */

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, normalize } from "node:path";
import { test } from "node:test";

/** From the lowest to the highest. `main` is the page's own file. */
const FOLDERS = [
  "space",
  "controls",
  "proto",
  "draw",
  "service",
  "navigate",
  "display",
  "viewer",
  "tools",
  "objects",
  "notes",
  "clearance",
  "embedding",
  "drive",
  "panels",
  "main",
];

test("imports point down, types included", () => {
  const folderOf = (path: string) => FOLDERS.indexOf(path.split(/[/.]/)[0] ?? "");
  const names = readdirSync("src", { recursive: true, encoding: "utf8" });
  const upward = names
    .filter((name) => /\.tsx?$/.test(name) && !name.endsWith(".d.ts"))
    .flatMap((name) => {
      assert.ok(folderOf(name) >= 0, `${name} is in a folder without a place`);
      const paths = readFileSync(join("src", name), "utf8").matchAll(/(?:from|import\(?) ?"(\..+\.tsx?)"/g);
      const imported = [...paths].map(([, path = ""]) => normalize(join(dirname(name), path)));
      return imported.filter((path) => folderOf(path) > folderOf(name)).map((path) => `${name} -> ${path}`);
    });
  assert.deepEqual(upward, []);
});
