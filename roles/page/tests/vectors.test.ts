/** The worked examples of both wire pages match this page's encoder and decoder. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { decodeCamera, encodeCamera } from "../src/proto/camera.ts";
import { IdDecoder } from "../src/proto/idCoding.ts";
import { CloseCode, decodeIdentity, encodeIdentity, type Identity, TRIMARAN } from "../src/proto/identity.ts";
import {
  decodeRoleMessage,
  encodeRoleMessage,
  type RoleMessage,
  viewMessages,
} from "../src/proto/messages.ts";
import { numberList } from "../src/proto/numbers.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import {
  type CullerItem,
  type DisplayItem,
  decodeCullerBlock,
  decodeDisplayBlock,
  packBlocks,
} from "../src/proto/supply.ts";
import { decodeViewState, type ViewState, viewStateOf } from "../src/proto/viewState.ts";
import { Reader, WireError, Writer } from "../src/wire/bytes.ts";
import { FrameAssembler, loadHasher } from "../src/wire/frames.ts";
import {
  type Close,
  decodeClose,
  decodeHello,
  decodeRefuse,
  encodeClose,
  encodeHello,
  encodeRefuse,
  type Hello,
  type Refusal,
} from "../src/wire/handshake.ts";
import { encodeMessage, type Format, Kind, type Message, MessageStream } from "../src/wire/messages.ts";
import { encodeIds } from "./idEncoder.ts";
import { endOf, examplesOf, range, takeAll, toHex } from "./support.ts";

/** Checks the values of an example, and returns their encoding, if this side can send it. */
interface Check {
  readonly kind: Kind;
  readonly check: (payload: Uint8Array) => Uint8Array | undefined;
}

const hasher = await loadHasher();

function testPage(page: string, format: Format, checks: Readonly<Record<string, Check>>): void {
  const examples = examplesOf(page);
  test(`${page} has an example for each check`, () => {
    assert.deepEqual([...examples.keys()].sort(), Object.keys(checks).sort());
  });
  for (const [name, bytes] of examples) {
    test(`${page}: ${name}`, () => {
      const known = checks[name];
      assert(known !== undefined, "no check knows the example");
      const { kind, payload } = onlyMessage(bytes, format);
      assert.equal(kind, known.kind);
      const written = known.check(payload);
      if (written !== undefined) {
        assert.equal(toHex(encodeMessage(kind, written, format)), toHex(bytes));
      }
    });
  }
}

function onlyMessage(bytes: Uint8Array, format: Format): Message {
  const stream = new MessageStream(format);
  stream.push(bytes);
  const [message, ...more] = takeAll(stream);
  assert(message !== undefined && more.length === 0 && stream.pending === 0, "it is one message");
  return message;
}

function same<T>(
  kind: Kind,
  expected: T,
  read: (payload: Uint8Array) => T,
  write?: (value: T) => Uint8Array,
): Check {
  const check = (payload: Uint8Array) => {
    const value = read(payload);
    assert.deepEqual(value, expected);
    return write?.(value);
  };
  return { kind, check };
}

const asIs = (payload: Uint8Array) => payload;
const refused = (expected: Refusal) => same(Kind.refuse, expected, decodeRefuse, encodeRefuse);
const closed = (expected: Close) => same(Kind.close, expected, decodeClose, encodeClose);
const greeted = (expected: Hello) => same(Kind.hello, expected, decodeHello, encodeHello);

// The wire of links, with the application `robot/1`.

const ROBOT = "transport/wire/WIRE.md";
const ROBOT_FORMAT = { latest: 12, header: 8, item: 4 };

const readText = (bytes: Uint8Array) => new Reader(bytes).text();
const writeText = (text: string) => new Writer().text(text).take();

const readPose = (reader: Reader) => [reader.f32(), reader.f32(), reader.f32()];
const writePose = (writer: Writer, pose: number[]) =>
  pose.reduce((writer, number) => writer.f32(number), writer);

/** The robot's decoder: reads the first cell, and how many. */
const cells = {
  decode: (batch: Uint8Array) => {
    const reader = new Reader(batch);
    const first = reader.u32();
    return Uint32Array.from(range(first, first + reader.u16()));
  },
  complete: () => {},
};

/** Checks the frame of these examples. */
function robotFrame(names: readonly string[], ids: readonly number[]): void {
  const assembler = new FrameAssembler(hasher, 1000, cells);
  const frames = names.map((name) => {
    const bytes = examplesOf(ROBOT).get(name);
    assert(bytes !== undefined);
    return assembler.take(onlyMessage(bytes, ROBOT_FORMAT));
  });
  const header = Uint8Array.from([0xe8, 3, 0, 0, 0, 0, 0, 0]);
  assert.deepEqual(frames.at(-1), { number: 9, header, ids: Uint32Array.from(ids) });
}

/** A part of a frame, with all examples of that frame and its ids. */
function framed(kind: Kind, written: Uint8Array, names = ["begin", "batch", "end"], ids = [1, 258]): Check {
  const check = () => {
    robotFrame(names, ids);
    return written;
  };
  return { kind, check };
}

testPage(ROBOT, ROBOT_FORMAT, {
  hello: greeted({ application: "robot/1", session: 5n, lane: "latest", introduction: writeText("arm") }),
  "hello-4": {
    kind: Kind.hello,
    check(payload) {
      assert.throws(
        () => decodeHello(payload),
        new WireError("the peer speaks version 4 of the wire, this one version 3"),
      );
      return undefined;
    },
  },
  accept: same(Kind.accept, "map", readText, writeText),
  refuse: refused({ reason: "not taken", code: 1, text: "full" }),
  close: closed({ code: 3, text: "no power" }),
  "keep-alive": same(Kind.keepAlive, new Uint8Array(0), asIs, asIs),
  "latest-value": same(
    Kind.latestValue,
    [1, 2, -3],
    (payload) => readPose(new Reader(payload)),
    (pose) => writePose(new Writer(), pose).take(),
  ),
  "numbered-value": same(
    Kind.numberedValue,
    { number: 5, pose: [1, 2, -3] },
    (payload) => {
      const reader = new Reader(payload);
      return { number: reader.u32(), pose: readPose(reader) };
    },
    ({ number, pose }) => writePose(new Writer().u32(number), pose).take(),
  ),
  begin: framed(Kind.begin, new Writer().u32(9).u64(1000n).take()),
  batch: framed(Kind.batch, new Writer().u32(1).u32(258).take()),
  end: framed(Kind.end, endOf(9, [1, 258])),
  "empty-end": framed(Kind.end, endOf(9, []), ["begin", "empty-end"], []),
  "coded-batch": {
    kind: Kind.codedBatch,
    check(payload) {
      const assembler = new FrameAssembler(hasher, 1000, cells);
      assembler.take({ kind: Kind.begin, payload: new Writer().u32(9).u64(1000n).take() });
      assembler.take({ kind: Kind.codedBatch, payload });
      const outcome = assembler.take({ kind: Kind.end, payload: endOf(9, range(100, 150)) });
      assert(outcome !== undefined);
      assert.deepEqual([...outcome.ids], range(100, 150));
      return new Writer().u32(100).u16(50).take();
    },
  },
  message: same(
    Kind.message,
    { command: 1, place: "dock" },
    (payload) => {
      const reader = new Reader(payload);
      return { command: reader.varint32(), place: reader.text() };
    },
    ({ command, place }) => new Writer().varint(command).text(place).take(),
  ),
  block: same(
    Kind.block,
    "map tile",
    (payload) => new TextDecoder().decode(payload),
    (text) => new TextEncoder().encode(text),
  ),
});

// Trimaran's messages over its links.

const PROTO = "proto/WIRE.md";

const KEY = 0x5eedn;

const SCENE = { hash: 0x1234n, nodes: 400, drawables: 600, geometries: 250, objects: 100 };

const SETTINGS = {
  viewport: { width: 1024, height: 768 },
  levelRule: { epsilon: 2, fewPixels: false },
  batch: 256,
  coding: "changes",
  occlusionTest: "raster",
} as const;

const DISPLAY: Identity = { role: "display", scene: SCENE, session: { key: KEY, settings: SETTINGS } };

const CAMERA = {
  eye: [1, 2, -3],
  orientation: [0, 0, 0, 1],
  tanHalfFov: 0.5,
  viewState: 3,
  near: 0.25,
  frame: 7,
} as const;

const VIEW: ViewState = {
  ...viewStateOf(SETTINGS),
  sections: [{ kind: "plane", point: [0, 3, 0], direction: [0, 1, 0] }],
  hidden: ObjectSet.of([4, 2, 3, 7]),
  seeThrough: ObjectSet.of([300]),
};

const NOW = [...range(100, 110), ...range(111, 120), ...range(123, 150), 200, 1000];

const zero = 0n;

const zeros = <Name extends string, Zero>(zero: Zero, ...names: readonly Name[]) =>
  Object.fromEntries(names.map((name) => [name, zero])) as Record<Name, Zero>;

/** A hello and the identity in it. */
function introduced(lane: Hello["lane"], identity: Identity): Check {
  const check = (payload: Uint8Array) => {
    const hello = decodeHello(payload);
    assert.deepEqual(
      { ...hello, introduction: decodeIdentity(hello.introduction) },
      {
        application: TRIMARAN.name,
        session: 5n,
        lane,
        introduction: identity,
      },
    );
    return encodeHello({ ...hello, introduction: encodeIdentity(identity) });
  };
  return { kind: Kind.hello, check };
}

const said = (expected: RoleMessage) => same(Kind.message, expected, decodeRoleMessage, encodeRoleMessage);

const demanded = (expected: DisplayItem[]) =>
  same(Kind.block, expected, decodeDisplayBlock, (items) => {
    const [block, ...more] = packBlocks(items);
    assert(block !== undefined && more.length === 0, "it is one block");
    return block;
  });

const supplied = (expected: CullerItem[]) => same(Kind.block, expected, decodeCullerBlock);

testPage(PROTO, TRIMARAN.format, {
  hello: introduced("latest", DISPLAY),
  "hello-without-a-scene": introduced("bulk", { ...DISPLAY, scene: undefined }),
  accept: same(
    Kind.accept,
    { role: "culler", scene: SCENE, session: undefined },
    decodeIdentity,
    encodeIdentity,
  ),
  refuse: refused({
    reason: "not taken",
    code: 3,
    text: "the listener is a culler as well: connect displays with cullers",
  }),
  close: closed({ code: CloseCode.failed, text: "it failed: no GPU" }),
  camera: same(Kind.latestValue, CAMERA, decodeCamera, encodeCamera),
  begin: same(
    Kind.begin,
    { frame: 9, camera: CAMERA },
    (payload) => {
      const reader = new Reader(payload);
      return { frame: reader.u32(), camera: decodeCamera(reader.rest()) };
    },
    ({ frame, camera }) => new Writer().u32(frame).bytes(encodeCamera(camera)).take(),
  ),
  ids: {
    kind: Kind.batch,
    check() {
      const assembler = new FrameAssembler(hasher, 1000, new IdDecoder());
      for (const name of ["begin", "ids"]) {
        assembler.take(onlyMessage(examplesOf(PROTO).get(name) ?? new Uint8Array(0), TRIMARAN.format));
      }
      const ended = assembler.take({ kind: Kind.end, payload: endOf(9, [1, 258]) });
      assert(ended !== undefined);
      assert.deepEqual([...ended.ids], [1, 258]);
      assert.deepEqual(decodeCamera(ended.header), CAMERA);
      return new Writer().u32(1).u32(258).take();
    },
  },
  "coded-ids": {
    kind: Kind.codedBatch,
    check(payload) {
      const decoder = new IdDecoder();
      decoder.complete(7, Uint32Array.from(range(100, 150)));
      assert.deepEqual([...decoder.decode(payload, 9, 1000)], NOW);
      return encodeIds(NOW, 2, range(100, 150));
    },
  },
  stats: said({
    what: "stats",
    stats: {
      frame: 9,
      occludersOf: 7,
      orStart: 1n,
      orEnd: 300n,
      orBusy: zero,
      hcStart: zero,
      hcEnd: zero,
      occluders: 0,
      occluderTriangles: zero,
      culling: {
        ...zeros(0, "outside", "tested", "hidden", "nearVisible", "eyeInside", "notFinite", "fewPixels"),
        ...zeros(0, "refined", "batches"),
        visited: 5,
        emitted: 2,
      },
      furtherRounds: { count: 0, occluderTriangles: zero, drawing: zero, tested: 0, hidden: 0 },
      toOtherCuller: zeros(
        zero,
        "camera",
        "begin",
        "ids",
        "end",
        "control",
        "geometry",
        "headers",
        "messages",
      ),
    },
  }),
  meet: said({ what: "meet", key: KEY, endpoint: "tcp://two:7400" }),
  switch: said({ what: "switch", key: KEY, firstFrame: 8 }),
  view: {
    kind: Kind.message,
    check(payload) {
      const message = decodeRoleMessage(payload);
      assert(message.what === "view");
      assert.deepEqual([message.version, message.isLast], [3, true]);
      assert.deepEqual(decodeViewState(message.part), VIEW);
      const [only, ...more] = viewMessages(3, VIEW);
      assert.equal(more.length, 0);
      return only;
    },
  },
  "holds-and-begin": demanded([
    { item: "holds", drawables: numberList([134, 5, 4]), geometries: numberList([7]) },
    { item: "begin", coarserFirst: true, ahead: 8_388_608 },
  ]),
  lacks: demanded([{ item: "lacks", frame: 9, taken: 300, drawables: numberList([2, 258]) }]),
  "taken-and-shown": demanded([
    { item: "taken", bytes: 17_000 },
    { item: "shown", frame: 9 },
  ]),
  "geometry-part": supplied([
    {
      item: "geometry",
      number: 8,
      length: 300,
      offset: 296,
      part: Uint8Array.from([0xde, 0xad, 0xbe, 0xef]),
    },
  ]),
  "stand-in": supplied([{ item: "stand-in", id: 300, pieces: 2, drawables: numberList([2, 258]) }]),
  ahead: supplied([{ item: "ahead", geometries: numberList([8, 9]) }]),
});
