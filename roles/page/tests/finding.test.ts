import assert from "node:assert/strict";
import { type TestContext, test } from "node:test";
import { signal } from "@preact/signals";
import { Finding } from "../src/objects/finding.ts";
import { parted, summaryOf } from "../src/objects/searchBox.tsx";
import { type FoundParts, RefusedError } from "../src/service/service.ts";
import type { Viewer } from "../src/viewer/viewer.ts";

const PART = { kind: "group", id: 1, name: "/20-2051PL", first: 0, end: 2 } as const;

/** A search at a service that answers, or throws an error. */
function searching(t: TestContext) {
  let time = 0;
  let timers: { readonly at: number; readonly run: () => void }[] = [];
  const wait = (run: () => void, pause = 0) => timers.push({ at: time + pause, run });
  t.mock.method(globalThis, "setTimeout", wait as unknown as typeof setTimeout);
  const service = { error: undefined as Error | undefined, asked: [] as string[] };
  const search = async (text: string): Promise<FoundParts> => {
    service.asked.push(text);
    if (service.error !== undefined) {
      throw service.error;
    }
    return { parts: [PART], total: 1, objects: 2 };
  };
  const finding = new Finding({ service: { search }, said: signal("") } as unknown as Viewer);
  /** Lets so many milliseconds pass, and the answer arrive. */
  const pass = async (milliseconds = 0) => {
    time += milliseconds;
    for (let due = timers; due.length > 0; due = timers.filter(({ at }) => at <= time)) {
      timers = timers.filter(({ at }) => at > time);
      for (const { run } of due.filter(({ at }) => at <= time)) {
        run();
      }
      await new Promise(setImmediate);
    }
  };
  const now = () => [finding.found.value?.text, finding.isOpen.value, finding.trouble.value];
  return { finding, service, pass, now };
}

const NO_ANSWER = "The service does not answer. The search is repeated until it does.";

test("a query without an answer empties the list, and is asked until it has one", async (t) => {
  const { finding, service, pass, now } = searching(t);
  void finding.ask("20-20");
  await pass();
  assert.deepEqual(now(), ["20-20", true, ""]);
  assert.equal(finding.part(0), PART);
  service.error = new TypeError("Failed to fetch");
  void finding.ask("2071");
  await pass();
  assert.deepEqual(now(), [undefined, true, NO_ANSWER]);
  assert.equal(finding.part(0), undefined);
  await pass(2000);
  assert.deepEqual(now(), [undefined, true, NO_ANSWER]);
  service.error = undefined;
  await pass(2000);
  assert.deepEqual(now(), ["2071", true, ""]);
  await pass(60_000);
  assert.deepEqual(service.asked, ["20-20", "2071", "2071", "2071"]);
});

test("a refusal is told in the service's words", async (t) => {
  const { finding, service, pass, now } = searching(t);
  service.error = new RefusedError("the model cannot be searched");
  void finding.ask("2071");
  await pass();
  assert.deepEqual(now(), [undefined, true, "the model cannot be searched"]);
});

test("another query, an empty one and a closed list end the repetition", async (t) => {
  const { finding, service, pass, now } = searching(t);
  service.error = new TypeError("Failed to fetch");
  void finding.ask("a");
  await pass();
  void finding.ask("b");
  await pass();
  assert.deepEqual(service.asked, ["a", "b"]);
  void finding.ask("");
  await pass();
  assert.deepEqual(now(), [undefined, false, ""]);
  void finding.ask("c");
  await pass();
  finding.close();
  await pass(60_000);
  assert.deepEqual(service.asked, ["a", "b", "c"]);
  // The list tells at once why it is empty, and the query is asked again.
  service.error = undefined;
  finding.open();
  assert.deepEqual(now(), [undefined, true, NO_ANSWER]);
  await pass();
  assert.deepEqual(now(), ["c", true, ""]);
  finding.close();
  finding.open();
  await pass();
  assert.deepEqual(
    [now(), service.asked],
    [
      ["c", true, ""],
      ["a", "b", "c", "c"],
    ],
  );
});

test("where nothing is found there are examples of queries", () => {
  const none = "Nothing is found. Search for a name or an attribute, such as 20-CE50 or type=VALV.";
  assert.equal(summaryOf({ total: 0, objects: 0 }), none);
  assert.equal(summaryOf({ total: 1, objects: 2000 }), "1 part, 2,000 objects");
});

test("a name is cut before its last letters, and both pieces are all of it", () => {
  const names = [
    "",
    "/20-2051PL",
    "ball valve DN 100",
    "/AREA-20/PIPE-RACK-EAST/20-2051PL-B1",
    "two\nlines of 𝒳",
  ];
  for (const name of names) {
    const [start = "", end = ""] = parted(name);
    assert.equal(start + end, name);
    assert.equal([...end].length, Math.min([...name].length, 12), name);
  }
  assert.deepEqual(parted("/AREA-20/PIPE-RACK-EAST/20-2051PL-B1"), [
    "/AREA-20/PIPE-RACK-EAST/",
    "20-2051PL-B1",
  ]);
  // A letter of two code units is not cut apart.
  assert.deepEqual(parted("ab𝒳23456789012"), ["ab", "𝒳23456789012"]);
});
