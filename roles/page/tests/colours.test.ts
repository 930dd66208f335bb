/** Colours over those of the model, their legend and palettes, and what is found. */

import assert from "node:assert/strict";
import { test } from "node:test";
import {
  type Colouring,
  legendOf,
  MOST_PAINTS,
  NO_COLOURS,
  ObjectColours,
  type Paint,
  REST,
} from "../src/draw/colours.ts";
import { cssOf, PALETTE, scaleAt } from "../src/draw/palettes.ts";
import { paint, told } from "../src/objects/actions.ts";
import { colouringBy } from "../src/objects/colouring.ts";
import { heightOf, rowsAt, scrolledTo } from "../src/objects/rowWindow.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import { WHOLE } from "../src/viewer/viewHistory.ts";
import { randomOf } from "../wire/tests/support.ts";

const PAINTED = 1 << 24;

function painted(colour: number, objects: Iterable<number>, label = ""): Paint {
  return { label, colour, objects: ObjectSet.of(objects) };
}

test("each object has the last of its colours", () => {
  for (let seed = 1; seed <= 200; seed += 1) {
    const random = randomOf(seed);
    const paints = Array.from({ length: random(5) }, (_, index) => {
      const objects = Array.from({ length: random(12) }, () => random(16));
      return painted(index + 1, objects);
    });
    const by = seed % 2 === 0 ? "Size" : "";
    const colours = new ObjectColours({ by, paints });
    for (let object = 0; object < 20; object += 1) {
      const last = paints.filter(({ objects }) => objects.has(object)).at(-1)?.colour;
      const expected = last ?? (by === "" ? undefined : REST);
      assert.equal(colours.codeOf(object), expected === undefined ? 0 : PAINTED | expected, `seed ${seed}`);
    }
  }
});

test("the last object, black and the most paints have their colours", () => {
  const last = 0xffff_fffe;
  const paints = Array.from({ length: MOST_PAINTS }, (_, index) => painted(index, [index, last]));
  const colours = new ObjectColours({ by: "", paints });
  assert.equal(colours.codeOf(0), PAINTED);
  assert.equal(colours.codeOf(MOST_PAINTS - 1), PAINTED | (MOST_PAINTS - 1));
  assert.deepEqual([colours.codeOf(last), colours.codeOf(last - 1)], [PAINTED | (MOST_PAINTS - 1), 0]);
  assert.equal(new ObjectColours(NO_COLOURS).codeOf(0), 0);
});

test("an object is coloured by hand over all colours before", () => {
  const red = painted(0xff0000, [1, 2], "valve");
  const blue = painted(0x0000ff, [2, 3], "pump");
  let view = { ...WHOLE, ...paint(WHOLE, red) };
  view = { ...view, ...paint(view, blue) };
  assert.deepEqual(view.colouring, { by: "", paints: [red, blue] });
  assert.equal(told(view, 10), "coloured");
  // A colour of which nothing shows any more is gone.
  view = { ...view, ...paint(view, painted(7, [1, 2, 9])) };
  assert.deepEqual(
    view.colouring.paints.map(({ colour }) => colour),
    [0x0000ff, 7],
  );
  for (let object = 0; object < 2 * MOST_PAINTS; object += 1) {
    view = { ...view, ...paint(view, painted(object, [object])) };
  }
  assert.equal(view.colouring.paints.length, MOST_PAINTS);
  assert.equal(told({ ...view, colouring: { ...view.colouring, by: "Size" } }, 10), "coloured by Size");
});

test("values have colours of the palette, and a legend with their names", () => {
  const objects = [ObjectSet.run(0, 4), ObjectSet.run(7, 8)];
  const legend = { kind: "values", labels: ["new", ""], counts: [4, 1], others: 3 } as const;
  const colouring = colouringBy("Status", { legend, objects });
  assert.deepEqual(colouring, {
    by: "Status",
    paints: [
      { label: "new", colour: PALETTE[0]?.colour, objects: objects[0] },
      { label: "", colour: PALETTE[1]?.colour, objects: objects[1] },
    ],
  });
  assert.deepEqual(
    legendOf(colouring).map(({ label, colours }) => [label, colours.length]),
    [
      ["new", 1],
      ["", 1],
    ],
  );
});

test("numbers have a scale, and an entry of the legend has four steps of it", () => {
  const counts = Array.from({ length: 32 }, () => 1);
  const objects = counts.map((_, step) => ObjectSet.run(2 * step, 2 * step + 1));
  const legend = { kind: "numbers", least: 50, largest: 850, unit: "mm", counts, others: 0 } as const;
  const colouring = colouringBy("Size", { legend, objects });
  assert.deepEqual([colouring.paints[0]?.colour, colouring.paints[31]?.colour], [0x440154, 0xfde725]);
  const entries = legendOf(colouring);
  assert.deepEqual(
    entries.map(({ label, objects }) => [label, objects.size]),
    Array.from({ length: 8 }, (_, entry) => [`${50 + 100 * entry} to ${150 + 100 * entry} mm`, 4]),
  );
  assert.deepEqual([...(entries[1]?.objects ?? [])], [8, 10, 12, 14]);
  const one = colouringBy("Size", { legend: { ...legend, largest: 50 }, objects });
  assert.deepEqual(
    legendOf(one).map(({ label }) => label),
    ["50 mm"],
  );
});

test("a legend joins only what stands side by side", () => {
  const paints = ["a", "a", "b", "a"].map((label, object) => painted(object, [object], label));
  const entries = legendOf({ by: "", paints } satisfies Colouring);
  assert.deepEqual(
    entries.map(({ label, objects }) => [label, [...objects]]),
    [
      ["a", [0, 1]],
      ["b", [2]],
      ["a", [3]],
    ],
  );
});

test("a scale goes from its first to its last colour, whatever is asked of it", () => {
  assert.deepEqual([-1, 0, 1, 9].map(scaleAt).map(cssOf), ["#440154", "#440154", "#fde725", "#fde725"]);
  assert.equal(cssOf(scaleAt(4 / 9)), "#26828e");
  assert.equal(cssOf(scaleAt(0.5 / 9)), "#461566");
  // The palette has no colour twice.
  assert.equal(new Set(PALETTE.map(({ colour }) => colour)).size, PALETTE.length);
});

test("the rows that show cover the view, at any scroll position of a list of any length", () => {
  for (const total of [0, 1, 5, 100, 1_000_000, 20_000_000]) {
    for (const row of [26, 44]) {
      const list = { total, row, view: 300 };
      const height = heightOf(list);
      assert.ok(height <= 16_000_000);
      for (const share of [0, 0.25, 0.5, 0.999, 1]) {
        const scrolled = share * Math.max(0, height - list.view);
        const { first, end, top } = rowsAt(list, scrolled);
        assert.ok(first >= 0 && end <= total && end - first < 40, `${total} ${share}`);
        assert.ok(first === 0 || top <= scrolled, "nothing is missing above");
        const bottom = top + (end - first) * row;
        assert.ok(end === total || bottom >= scrolled + list.view, "nor below");
        assert.ok(bottom <= height + 1, "the last row is within the list");
      }
      const last = rowsAt(list, Math.max(0, height - list.view));
      assert.equal(last.end, total, "the end can be reached");
    }
  }
});

test("a row is scrolled to just so far that it shows", () => {
  for (const total of [100, 5_000_000]) {
    const list = { total, row: 26, view: 260 };
    const shows = (index: number, scrolled: number) => {
      const { first, top } = rowsAt(list, scrolled);
      const place = top + (index - first) * list.row - scrolled;
      return place >= -1e-3 && place + list.row <= list.view + 1e-3;
    };
    for (const index of [0, 9, 10, Math.floor(total / 2), total - 1]) {
      for (const from of [0, heightOf(list) / 2, heightOf(list) - list.view]) {
        const scrolled = scrolledTo(list, index, from);
        assert.ok(shows(index, scrolled), `${index} from ${from}`);
        assert.ok(Math.abs(scrolledTo(list, index, scrolled) - scrolled) < 1e-3);
        assert.ok(!shows(index, from) || Math.abs(scrolled - from) < 1e-3, "what shows is not moved");
      }
    }
  }
});

test("runs that touch are joined, and a long answer is one set", () => {
  const set = ObjectSet.joined([
    { first: 0, end: 3 },
    { first: 3, end: 5 },
    { first: 7, end: 8 },
  ]);
  assert.deepEqual(set, ObjectSet.of([0, 1, 2, 3, 4, 7]));
  assert.deepEqual(ObjectSet.joined([]), ObjectSet.EMPTY);
});
