import assert from "node:assert/strict";
import { test } from "node:test";
import { signal } from "@preact/signals";
import { Measuring } from "../src/tools/measuring.ts";
import type { Viewer } from "../src/viewer/viewer.ts";

/** Measuring in a picture of nothing, which has the focus of the keyboard or not. */
function measuring() {
  const picked: number[][] = [];
  const focus = { isVisible: false };
  const viewer = {
    canvas: {
      addEventListener: () => {},
      matches: () => focus.isVisible,
      clientWidth: 900,
      clientHeight: 700,
    },
    said: signal(""),
    pick: (...place: number[]) => {
      picked.push(place);
      return undefined;
    },
    display: undefined,
  };
  return { measuring: new Measuring(viewer as unknown as Viewer), viewer, picked, focus };
}

test("Enter takes the point at the crosshair, where that shows and points are measured", () => {
  const { measuring: tool, viewer, picked, focus } = measuring();
  focus.isVisible = true;
  assert.equal(tool.enter(), false, "nothing is measured");
  tool.toggle();
  focus.isVisible = false;
  assert.equal(tool.enter(), false, "the focus is elsewhere");
  tool.choose("parts");
  focus.isVisible = true;
  assert.equal(tool.enter(), false, "parts are picked elsewhere");
  assert.equal(picked.length, 0);
  tool.choose("points");
  assert.equal(tool.enter(), true);
  assert.ok(picked.length > 0 && picked.every(([x, y]) => x === 450 && y === 350), String(picked));
  assert.equal(viewer.said.value, "There is nothing at the crosshair.");
});
