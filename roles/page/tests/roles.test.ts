/** A display's identity, camera and view state, and invalid messages. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Reader, WireError, Writer, whole } from "trimaran-transport";
import type { Camera } from "../src/proto/camera.ts";
import { type Identity, TRIMARAN } from "../src/proto/identity.ts";
import { type RoleMessage, viewMessages } from "../src/proto/messages.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Settings } from "../src/proto/settings.ts";
import {
  decodeViewState,
  encodeViewState,
  type Section,
  type ViewState,
  viewParts,
  viewStateOf,
} from "../src/proto/viewState.ts";
import { concat, fromHex, randomOf, range, toHex } from "../wire/tests/support.ts";

const { encode: encodeIdentity, decode: decodeIdentity } = whole(TRIMARAN.hello);
const { encode: encodeCamera, decode: decodeCamera } = whole(TRIMARAN.latest);
const { encode: encodeRoleMessage, decode: decodeRoleMessage } = whole(TRIMARAN.message);

const SETTINGS: Settings = {
  viewport: { width: 640, height: 480 },
  levelRule: { epsilon: 1.5, fewPixels: true },
  batch: 16_384,
  coding: "plain",
  occlusionTest: "hzb",
};

const IDENTITY: Identity = {
  role: "display",
  scene: { hash: (1n << 128n) - 1n, nodes: 1, drawables: 0xffff_ffff, geometries: 3, objects: 4 },
  session: { key: (1n << 64n) - 1n, settings: SETTINGS },
};

const CAMERA: Camera = {
  eye: [1e6, -2, 3],
  orientation: [0, Math.SQRT1_2, 0, Math.SQRT1_2],
  tanHalfFov: 1,
  viewState: 0xffff_ffff,
  near: 0.125,
  frame: 5,
};

const STATE = viewStateOf(SETTINGS);

/** A view state that hides runs of four bytes each, and before them one that may be longer. */
function longState(runs: number, gap: number): ViewState {
  const more = Array.from({ length: runs }, () => [128, 128] as const);
  return { ...STATE, hidden: ObjectSet.coded([[gap, 128], ...more]) };
}

/** The session of an identity with other settings. */
const withSettings = (change: Partial<Settings>): Identity => {
  return { ...IDENTITY, session: { key: 1n, settings: { ...SETTINGS, ...change } } };
};

test("an identity reads back, with and without a scene and a session", () => {
  for (const identity of [
    IDENTITY,
    { role: "culler", scene: IDENTITY.scene, session: undefined },
    { role: "display", scene: undefined, session: undefined },
  ] satisfies Identity[]) {
    assert.deepEqual(decodeIdentity(encodeIdentity(identity)), identity);
  }
  assert(encodeIdentity(IDENTITY).length <= 200, "it fits into a hello");
});

test("settings outside of their ranges are refused", () => {
  const faults: [Partial<Settings>, string][] = [
    [{ batch: 0 }, "a batch of 0 is outside 1 to 16384"],
    [{ batch: 16_385 }, "a batch of 16385 is outside 1 to 16384"],
    [{ viewport: { width: 0, height: 1 } }, "a picture of 0x1 pixels has a side outside 1 to 65536"],
    [{ viewport: { width: 1, height: 65_537 } }, "a picture of 1x65537 pixels has a side outside 1 to 65536"],
    ...[0, -1, Number.NaN, Number.POSITIVE_INFINITY].map((epsilon): [Partial<Settings>, string] => {
      const text = `an error bound of ${epsilon} pixels: it must be a finite number above 0`;
      return [{ levelRule: { epsilon, fewPixels: false } }, text];
    }),
  ];
  for (const [change, text] of faults) {
    assert.throws(() => decodeIdentity(encodeIdentity(withSettings(change))), new WireError(text));
  }
  const largest = withSettings({ viewport: { width: 65_536, height: 65_536 }, batch: 1 });
  assert.deepEqual(decodeIdentity(encodeIdentity(largest)), largest);
});

test("an identity that is cut short or followed by something is refused", () => {
  const bytes = encodeIdentity(IDENTITY);
  for (const length of range(0, bytes.length)) {
    assert.throws(() => decodeIdentity(bytes.subarray(0, length)), WireError, `${length} bytes`);
  }
  assert.throws(() => decodeIdentity(concat(bytes, Uint8Array.of(0))), new WireError("1 bytes too many"));
  assert.throws(() => decodeIdentity(fromHex("02 00 00")), new WireError("2 is none of culler, display"));
});

test("a camera reads back, and numbers that are not a camera's are refused", () => {
  assert.deepEqual(decodeCamera(encodeCamera(CAMERA)), CAMERA);
  const eye = "the camera's eye is not finite";
  const orientation = "the camera's orientation is not a unit quaternion";
  const fieldOfView = "the camera's vertical field of view is outside 0.00115 to 179.99885 degrees";
  const near = "the camera's near distance is not a positive finite number";
  const faults: [Partial<Camera>, string][] = [
    [{ eye: [0, Number.NaN, 0] }, eye],
    [{ eye: [0, 0, Number.POSITIVE_INFINITY] }, eye],
    [{ orientation: [0, 0, 0, 0] }, orientation],
    [{ orientation: [0, 0, 0, 1.00001] }, orientation],
    [{ orientation: [0, 0, Number.NaN, 1] }, orientation],
    [{ tanHalfFov: 0.9e-5 }, fieldOfView],
    [{ tanHalfFov: 1.1e5 }, fieldOfView],
    [{ tanHalfFov: Number.NaN }, fieldOfView],
    [{ near: 0 }, near],
    [{ near: 1e-30 }, near],
    [{ near: Number.POSITIVE_INFINITY }, near],
  ];
  for (const [change, text] of faults) {
    assert.throws(() => decodeCamera(encodeCamera({ ...CAMERA, ...change })), new WireError(text));
  }
  for (const tanHalfFov of [1e-5, 1e5]) {
    assert.equal(decodeCamera(encodeCamera({ ...CAMERA, tanHalfFov })).tanHalfFov, Math.fround(tanHalfFov));
  }
});

test("sets of objects hold what they are made of, as runs", () => {
  const random = randomOf(11);
  for (let round = 0; round < 300; round += 1) {
    const objects = new Set(range(0, random(40)).map(() => random(60)));
    const set = ObjectSet.of(objects);
    assert.deepEqual(
      [...set],
      [...objects].sort((a, b) => a - b),
    );
    assert.equal(set.isEmpty, objects.size === 0);
    for (const object of range(0, 62)) {
      assert.equal(set.has(object), objects.has(object), `${object} in ${[...objects]}`);
    }
    const writer = new Writer();
    set.write(writer);
    const reader = new Reader(writer.take());
    assert.deepEqual(ObjectSet.read(reader), set);
    assert(reader.isAtEnd);
  }
  assert.deepEqual(ObjectSet.of([3, 1, 2, 2, 5]).runs, [
    { first: 1, end: 4 },
    { first: 5, end: 6 },
  ]);
});

test("a set of objects ends below the largest number", () => {
  const last = 0xffff_fffe;
  const writer = new Writer();
  ObjectSet.of([last]).write(writer);
  assert.equal(toHex(writer.take()), "01 fe ff ff ff 0f 00");
  const read = (hex: string) => ObjectSet.read(new Reader(fromHex(hex)));
  assert.deepEqual([...read("01 fe ff ff ff 0f 00")], [last]);
  const beyond = new WireError("a set of objects goes beyond number 4294967294");
  assert.throws(() => read("01 ff ff ff ff 0f 00"), beyond);
  assert.throws(() => read("01 00 ff ff ff ff 0f"), beyond);
  assert.throws(() => read("02 fe ff ff ff 0f 00 00 00"), beyond);
  assert.throws(() => read("ff ff ff ff 0f 00 00"), WireError, "nothing is set aside for a count");
  for (const object of [-1, 0.5, 0xffff_ffff]) {
    assert.throws(() => ObjectSet.of([object]), RangeError);
  }
});

test("a view state reads back with all that it can have", () => {
  const state: ViewState = {
    ...STATE,
    sections: [
      { kind: "box", lower: [-1, -2, -3], upper: [1, 2, 3] },
      { kind: "plane", point: [1, 2, 3], direction: [0, -1, 0] },
    ],
    hidden: ObjectSet.of([1]),
    isolated: ObjectSet.EMPTY,
    seeThrough: ObjectSet.of([2, 3]),
  };
  assert.deepEqual(decodeViewState(encodeViewState(state)), state);
  assert.deepEqual(decodeViewState(encodeViewState(STATE)), STATE);
  assert.throws(
    () => decodeViewState(concat(encodeViewState(STATE), Uint8Array.of(0))),
    new WireError("1 bytes too many"),
  );
});

test("sections that cut nothing or everything are refused, before they are sent as well", () => {
  const empty = "a section box is empty: its upper corner must lie above its lower one";
  const nowhere = "the direction of a section plane points nowhere";
  const notFinite = "a coordinate of a section is not finite";
  const plane: Section = { kind: "plane", point: [0, 0, 0], direction: [1, 0, 0] };
  const faults: [Section[], string][] = [
    [[{ kind: "box", lower: [0, 0, 0], upper: [1, 0, 1] }], empty],
    [[{ kind: "box", lower: [0, 0, 2], upper: [1, 1, 1] }], empty],
    [[{ kind: "plane", point: [0, 0, 0], direction: [0, 0, 0] }], nowhere],
    [[{ kind: "plane", point: [0, 0, 0], direction: [0, 1e120, 0] }], nowhere],
    [[{ kind: "plane", point: [Number.NaN, 0, 0], direction: [0, 1, 0] }], notFinite],
    [Array.from({ length: 7 }, () => plane), "7 sections: there can be 6"],
  ];
  for (const [sections, text] of faults) {
    assert.throws(() => decodeViewState(encodeViewState({ ...STATE, sections })), new WireError(text));
    assert.throws(() => viewParts(1, { ...STATE, sections }), new WireError(text));
  }
  for (const length of [1e-100, 1e100]) {
    const sections: Section[] = [{ kind: "plane", point: [0, 0, 0], direction: [length, 0, 0] }];
    assert.deepEqual(decodeViewState(encodeViewState({ ...STATE, sections })).sections, sections);
  }
  const six = { ...STATE, sections: Array.from({ length: 6 }, () => plane) };
  assert.deepEqual(decodeViewState(encodeViewState(six)), six);
});

test("a long view state is told in parts of 16,000 bytes, in order", () => {
  const state = { ...STATE, hidden: ObjectSet.of(range(0, 40_000).map((at) => 2 * at)) };
  const messages = viewMessages(4, state);
  const parts = messages.map((message) => {
    assert(message.what === "view" && message.version === 4);
    return message;
  });
  assert.deepEqual(
    parts.map(({ part }) => part.length).slice(0, -1),
    range(1, parts.length).map(() => 16_000),
  );
  assert.deepEqual(
    parts.map(({ isLast }) => isLast),
    [...range(1, parts.length).map(() => false), true],
  );
  assert(parts.length > 2);
  assert.deepEqual(decodeViewState(concat(...parts.map(({ part }) => part))), state);
});

test("a view state of full parts ends with one, and of more than 4,194,304 bytes is not told", () => {
  const parts = viewParts(4, longState(7994, 2 ** 14));
  assert.deepEqual(
    parts.map(({ part, isLast }) => [part.length, isLast]),
    [
      [16_000, false],
      [16_000, true],
    ],
  );
  const runs = 1_048_570;
  assert.equal(viewParts(1, longState(runs, 2 ** 7)).at(-1)?.part.length, 4_194_304 % 16_000);
  const tooLong = new RangeError("a view state of 4194305 bytes: 4194304 is the most");
  assert.throws(() => viewParts(1, longState(runs, 2 ** 14)), tooLong);
});

test("each message of a role has its number and reads back", () => {
  const key = (1n << 64n) - 1n;
  const said: [number, RoleMessage][] = [
    [1, { what: "meet", key, endpoint: undefined }],
    [2, { what: "met", key }],
    [3, { what: "unmet", key }],
    [4, { what: "switch", key, firstFrame: 0xffff_ffff }],
    [5, { what: "switched", key }],
    [6, { what: "part" }],
    [7, { what: "view", version: 1, part: Uint8Array.of(1, 2), isLast: false }],
    [8, { what: "waits", key }],
    [9, { what: "lead", leader: key }],
    [10, { what: "follow", leader: key }],
    [11, { what: "unfollow", leader: key }],
    [12, { what: "followed", leader: key, firstFrame: 7 }],
    [13, { what: "unfollowed", leader: key, firstFrame: 0xffff_ffff }],
  ];
  for (const [number, message] of said) {
    const bytes = encodeRoleMessage(message);
    assert.equal(bytes[0], number);
    assert.deepEqual(decodeRoleMessage(bytes), message);
    assert.throws(
      () => decodeRoleMessage(concat(bytes, Uint8Array.of(0))),
      new WireError("1 bytes too many"),
    );
    assert.throws(() => decodeRoleMessage(bytes.subarray(0, -1)), WireError);
  }
  assert.throws(() => decodeRoleMessage(Uint8Array.of(14)), WireError);
});

test("each number of the stats is read in its place", () => {
  // Frame 1, occluders of frame 2, and then 3, 4, 5 and so on.
  const bytes = Uint8Array.from([0, 1, 1, ...range(2, 37)]);
  const message = decodeRoleMessage(bytes);
  assert(message.what === "stats");
  const { stats } = message;
  assert.deepEqual([stats.frame, stats.occludersOf, stats.orStart, stats.hcEnd], [1, 2, 3n, 7n]);
  assert.deepEqual(stats.device, { drawing: 8n, pyramid: 9n, culling: 10n });
  assert.deepEqual([stats.occluders, stats.occluderTriangles], [11, 12n]);
  assert.deepEqual(Object.values(stats.culling), range(13, 24));
  assert.deepEqual([stats.culling.nearVisible, stats.culling.batches], [17, 23]);
  const rounds = { count: 24, occluderTriangles: 25n, drawing: 26n, tested: 27, hidden: 28 };
  assert.deepEqual(stats.furtherRounds, rounds);
  assert.deepEqual(Object.values(stats.toOtherCuller), range(29, 37).map(BigInt));
  assert.deepEqual(encodeRoleMessage(message), bytes);
});
