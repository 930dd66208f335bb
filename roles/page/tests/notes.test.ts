import assert from "node:assert/strict";
import { test } from "node:test";
import { Gaze } from "../src/navigate/gaze.ts";
import { axesOf } from "../src/navigate/orbit.ts";
import { coded, type Note, type NoteList, type Status } from "../src/notes/exchange.ts";
import { headed, Notes } from "../src/notes/notes.ts";
import { dateText } from "../src/notes/notesPanel.tsx";
import type { Selection } from "../src/objects/selection.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Viewer } from "../src/viewer/viewer.ts";

test("a set of objects travels as gaps and lengths", () => {
  for (const objects of [[], [0], [7, 3, 4, 5, 100, 6], [0, 1, 3, 4_000_000_000]]) {
    const set = ObjectSet.of(objects);
    assert.ok(ObjectSet.coded(coded(set)).equals(set), String(objects));
  }
  assert.deepEqual(coded(ObjectSet.of([3, 4, 5, 6, 7, 100])), [
    [3, 4],
    [91, 0],
  ]);
});

test("a note that looks straight down keeps its heading, and another one is as it was", () => {
  for (const down of [-1, 1]) {
    const gaze = new Gaze(headed([0, down, 0], [-0.6 * down, 0, 0.8 * down]));
    const [, up] = axesOf(gaze);
    assert.ok(Math.abs(up[0] + 0.6 * down) < 0.02 && Math.abs(up[2] - 0.8 * down) < 0.02, String(up));
    assert.ok(Math.abs(gaze.forward[1] - down) < 1e-3);
  }
  assert.deepEqual(headed([0.6, 0, -0.8], [0, 1, 0]), [0.6, 0, -0.8]);
});

test("a date that the browser cannot read is shown as it is", () => {
  assert.equal(dateText("2015-03-23T10:59:26.1234567+0100x"), "2015-03-23T10:59:26.1234567+0100x");
  assert.match(dateText("2026-11-30T13:05:00Z"), /2026/);
});

/** A list of notes by these states, the oldest first. Their titles are numbers. */
function listOf(...states: readonly Status[]): NoteList {
  const notes = states.map((status, at): Note => {
    const guid = String(at);
    return { guid, title: guid, text: "", author: "Ada", date: "", status, point: null, replyCount: 0 };
  });
  return { tag: states.join(), mayWrite: true, you: "Ada", damaged: [], notes };
}

test("a note that somebody closes stays in the list until the filter changes or the panel closes", async () => {
  let answer = listOf("open", "open", "closed");
  const service = { ask: async () => ({ status: 200, json: async () => answer }) };
  const notes = new Notes({ service } as unknown as Viewer, {} as Selection);
  const shown = () => notes.shown.value.map(({ guid, status }) => `${guid} ${status}`);
  const becomes = async (...states: readonly Status[]) => {
    answer = listOf(...states);
    await notes.refresh();
  };
  const stop = notes.watch();
  await notes.refresh();
  assert.deepEqual(shown(), ["1 open", "0 open"]);
  await becomes("closed", "open", "closed");
  assert.deepEqual(shown(), ["1 open", "0 closed"]);
  // It stays at the next change too.
  await becomes("closed", "closed", "closed");
  assert.deepEqual(shown(), ["1 closed", "0 closed"]);
  notes.filter("open", "");
  assert.deepEqual(shown(), []);
  await becomes("open", "closed", "closed");
  await becomes("closed", "closed", "closed");
  assert.deepEqual(shown(), ["0 closed"]);
  stop();
  assert.deepEqual(shown(), []);
  notes.filter("closed", "Bob");
  assert.deepEqual(shown(), []);
  notes.filter("closed", "Ada");
  assert.equal(shown().length, 3);
});
