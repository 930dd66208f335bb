import assert from "node:assert/strict";
import { test } from "node:test";
import { unbroken } from "../src/controls/quantities.tsx";
import { takesKey, type Within } from "../src/navigate/typing.ts";
import { messageOf, withoutSecrets } from "../src/service/errors.ts";
import { openWebSocket, type Socket } from "../wire/src/websocket.ts";

/** An element that matches selectors with `kind` in their list. */
function control(kind: string): Within {
  const closest = (selector: string) => (selector.split(", ").includes(kind) ? {} : null);
  return { closest } as unknown as Within;
}

test("a control takes the keys that the platform gives it, and leaves the others", () => {
  const taken = (kind: string) =>
    ["KeyW", "w", " ", "Enter", "ArrowUp", "Home", "PageDown", "Escape", "Tab"].filter((key) =>
      takesKey(control(kind), key),
    );
  assert.deepEqual(taken("button"), [" ", "Enter"]);
  assert.deepEqual(taken("summary"), [" ", "Enter"]);
  assert.deepEqual(taken("input[type=checkbox]"), [" "]);
  assert.deepEqual(taken("input[type=radio]"), [" ", "ArrowUp"]);
  assert.deepEqual(taken("input[type=range]"), ["ArrowUp", "Home", "PageDown"]);
  assert.deepEqual(taken("select"), [" ", "Enter", "ArrowUp", "Home", "PageDown"]);
  assert.deepEqual(taken("[role=tree]"), [" ", "Enter", "ArrowUp", "Home", "PageDown"]);
  assert.deepEqual(taken("a[href]"), ["Enter"]);
  assert.equal(taken("input").length, 9);
  assert.equal(taken("textarea").length, 9);
  assert.deepEqual(taken("canvas"), []);
});

test("no text shows what stands behind the question mark of an address", () => {
  for (const [text, shown] of [
    [
      "cannot connect to ws://two:7400/link?token=SECRET&network=wan: gone",
      "cannot connect to ws://two:7400/link",
    ],
    ["http://[::1]:8080/?token=SECRET", "http://[::1]:8080/"],
    ["see HTTPS://a.b/c#v=SECRET, or not", "see HTTPS://a.b/c or not"],
    ['"http://a/?token=SECRET" failed', '"http://a/" failed'],
    ["token=SECRET&x=1", "token=…&x=1"],
    ["What is this? Nothing.", "What is this? Nothing."],
  ] as const) {
    const told = withoutSecrets(text);
    assert.ok(told.startsWith(shown) || told === shown, `${text}: ${told}`);
    assert.ok(!told.includes("SECRET"), told);
    assert.equal(messageOf(new Error(text)), told);
  }
  assert.equal(messageOf("http://a/?token=SECRET"), "http://a/");
});

test("a connection that cannot be opened does not tell the token", async () => {
  const socket: Partial<Socket> = {};
  const channel = openWebSocket("ws://two:7400/link?token=SECRET", () => socket as Socket);
  (socket.onclose as (event: { code: number; reason: string }) => void)({ code: 1006, reason: "" });
  await assert.rejects(
    channel,
    new Error("cannot connect to ws://two:7400/link: the connection ended (code 1006)"),
  );
});

test("a line parts no number from its unit", () => {
  const kept: [string, string[]][] = [
    ["25.859 m × 1.000 m × 0.075 m", ["25.859 m ×", "1.000 m ×", "0.075 m"]],
    ["E -1 mm to 2 mm, U 3 mm", ["E -1 mm to", "2 mm,", "U 3 mm"]],
    ['E 3\' 4.00" ± 0.01" (vertex)', ['E 3\' 4.00" ± 0.01" (vertex)']],
  ];
  for (const [text, pieces] of kept) {
    assert.deepEqual(unbroken(text), pieces);
    assert.equal(pieces.join(" "), text);
  }
});
