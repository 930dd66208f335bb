/** Messages of pages around the page: only those of allowed origins are heard, and only valid ones obeyed. */

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Request } from "../../../examples/embedding/trimaran.d.ts";
import { Gate, type Heard, possibleOrigins } from "../src/embedding/gate.ts";
import { isMeant, parseRequest, RequestError } from "../src/embedding/requests.ts";

const HEAD = { trimaran: 1, id: 7 };

function parsed(data: unknown): Request {
  assert.ok(isMeant(data), JSON.stringify(data));
  return parseRequest(data);
}

test("a valid request is taken as it is", () => {
  const pose = { eye: [1, 2, 3], forward: [0, 0, -1], vfovDeg: 60 };
  for (const request of [
    { do: "hello" },
    { do: "goTo", part: { name: "P-101" } },
    { do: "select", parts: [] },
    { do: "select", parts: [{ object: 0 }, { group: 4294967295 }, { name: "a" }] },
    { do: "isolate", parts: [{ object: 3 }] },
    { do: "hide", parts: [{ object: 3 }] },
    { do: "showAll" },
    { do: "setView", view: "AAAA" },
    { do: "setView", pose },
    { do: "setView", pose: { ...pose, vfovDeg: 0.0573 } },
    { do: "takePicture", isCaptioned: true, size: { width: 640, height: 480 } },
  ]) {
    assert.deepEqual(parsed({ ...HEAD, ...request }), { ...HEAD, ...request });
  }
  assert.deepEqual(parsed({ ...HEAD, id: "x", do: "takePicture" }), {
    trimaran: 1,
    id: "x",
    do: "takePicture",
    isCaptioned: false,
  });
});

test("an invalid request is refused, whatever is in it", () => {
  const pose = { eye: [1, 2, 3], forward: [0, 0, -1], vfovDeg: 60 };
  for (const wrong of [
    { trimaran: 2, do: "hello" },
    { trimaran: "1", do: "hello" },
    { id: undefined, do: "hello" },
    { id: Number.NaN, do: "hello" },
    { id: {}, do: "hello" },
    { id: "x".repeat(101), do: "hello" },
    {},
    { do: "quit" },
    { do: "__proto__" },
    { do: ["hello"] },
    { do: "hello", more: 1 },
    { do: "goTo" },
    { do: "goTo", part: "P-101" },
    { do: "goTo", part: {} },
    { do: "goTo", part: { name: "" } },
    { do: "goTo", part: { name: "x".repeat(1001) } },
    { do: "goTo", part: { name: 5 } },
    { do: "goTo", part: { name: "a", object: 1 } },
    { do: "goTo", part: { object: -1 } },
    { do: "goTo", part: { object: 1.5 } },
    { do: "goTo", part: { object: "1" } },
    { do: "goTo", part: { group: 2 ** 32 } },
    { do: "goTo", part: { element: 1 } },
    { do: "goTo", part: null },
    { do: "select" },
    { do: "select", parts: { length: 1 } },
    { do: "select", parts: Array(101).fill({ object: 1 }) },
    { do: "select", parts: new Array(3) },
    { do: "hide", parts: [{ object: 1 }, 2] },
    { do: "setView" },
    { do: "setView", view: 5 },
    { do: "setView", view: "" },
    { do: "setView", view: "A", pose },
    { do: "setView", pose: { ...pose, eye: [1, 2] } },
    { do: "setView", pose: { ...pose, eye: [1, 2, Number.NaN] } },
    { do: "setView", pose: { ...pose, eye: [1, 2, "3"] } },
    { do: "setView", pose: { ...pose, eye: [1e300, 2, 3] } },
    { do: "setView", pose: { ...pose, forward: [0, 0, 0] } },
    { do: "setView", pose: { ...pose, forward: [1e10, 0, 0] } },
    { do: "setView", pose: { ...pose, vfovDeg: 0 } },
    { do: "setView", pose: { ...pose, vfovDeg: "60" } },
    { do: "setView", pose: { ...pose, roll: 1 } },
    { do: "takePicture", size: { width: 640 } },
    { do: "takePicture", size: { width: "640", height: 480 } },
    { do: "takePicture", size: [640, 480] },
    { do: "takePicture", isCaptioned: "yes" },
  ]) {
    assert.throws(() => parsed({ ...HEAD, ...wrong }), RequestError, JSON.stringify(wrong));
  }
});

test("messages of other scripts are not meant for the page", () => {
  for (const data of [undefined, null, 5, "trimaran", [], { source: "react-devtools" }, ["trimaran"]]) {
    assert.equal(isMeant(data), false);
  }
});

/** A window around the page, and what it gets. */
function around() {
  const got: [string, unknown][] = [];
  return {
    got,
    postMessage: (message: unknown, origin: string) => {
      got.push([origin, message]);
    },
  };
}

const heard = (window: object, origin: string, data: unknown): Heard => {
  return { source: window as MessageEventSource, origin, data };
};

/** Until all that was heard has been answered. */
const answered = () => new Promise((resolve) => setTimeout(resolve));

test("only the window around is heard, if its origin is allowed", async () => {
  const window = around();
  const run: Request[] = [];
  const gate = new Gate(window, ["https://a.example"], async (request) => {
    run.push(request);
    return {};
  });
  const hello = { ...HEAD, do: "hello" };
  for (const [source, origin] of [
    [window, "https://b.example"],
    [window, "http://a.example"],
    [window, "https://a.example:8443"],
    [window, "https://a.example.b.example"],
    [window, "null"],
    [window, ""],
    [around(), "https://a.example"],
    [{}, "https://a.example"],
  ] as const) {
    gate.hear(heard(source, origin, hello));
    gate.hear(heard(source, origin, { ...HEAD, do: "nonsense" }));
  }
  await answered();
  assert.deepEqual([run, window.got], [[], []], "not even an error is told");
  gate.hear(heard(window, "https://a.example", hello));
  await answered();
  assert.deepEqual(run, [hello]);
  assert.deepEqual(window.got, [["https://a.example", { trimaran: 1, event: "done", id: 7 }]]);
});

test("requests run one after the other, and each is answered", async () => {
  const window = around();
  const order: string[] = [];
  const gate = new Gate(window, ["https://a.example"], async (request) => {
    order.push(`begin ${request.id}`);
    await answered();
    order.push(`end ${request.id}`);
    if (request.do === "showAll") {
      throw new Error("no part at http://plant/?token=SECRET");
    }
    return {};
  });
  gate.hear(heard(window, "https://a.example", { trimaran: 1, id: 1, do: "showAll" }));
  gate.hear(heard(window, "https://a.example", { trimaran: 1, id: 2, do: "hello" }));
  gate.hear(heard(window, "https://a.example", { trimaran: 1, id: "x".repeat(999), do: "hello" }));
  for (let turn = 0; turn < 10; turn += 1) {
    await answered();
  }
  assert.deepEqual(order, ["begin 1", "end 1", "begin 2", "end 2"]);
  const told = window.got.map(([, message]) => message as { event: string; id?: unknown; message?: string });
  assert.deepEqual(
    told.map(({ event, id }) => [event, id]),
    [
      ["error", 1],
      ["done", 2],
      ["error", undefined],
    ],
  );
  assert.ok(!JSON.stringify(told).includes("SECRET"), JSON.stringify(told));
});

test("where the browser says who is around, nobody else is spoken to", () => {
  const allowed = ["https://own.example", "https://a.example"];
  assert.deepEqual(possibleOrigins(allowed, undefined), allowed);
  assert.deepEqual(possibleOrigins(allowed, []), allowed);
  assert.deepEqual(possibleOrigins(allowed, ["https://a.example", "https://own.example"]), [
    "https://a.example",
  ]);
  assert.deepEqual(possibleOrigins(allowed, ["https://b.example"]), []);
});
