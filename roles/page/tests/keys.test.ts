import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { KEYS } from "../src/navigate/keyList.tsx";

test("the page lists the same keys as the guide, in the same groups", () => {
  const guide = readFileSync("../../docs/guide/keys.md", "utf8");
  const [, section = ""] = guide.split(/^## Keys and mouse$/m);
  const [tables = ""] = section.split(/^(?:## |On a Mac)/m);
  const groups = tables.split(/^### /m).slice(1);
  const listed = groups.map((group) => {
    const [name = "", , , ...lines] = group.trim().split("\n");
    return [name, lines.map((line) => plain(line).slice(2, -2).split(" | "))];
  });
  assert.deepEqual(listed, KEYS);
});

/** A line of Markdown without its links. */
function plain(line: string): string {
  return line.replaceAll(/\[([^\]]*)\]\([^)]*\)/g, "$1");
}
