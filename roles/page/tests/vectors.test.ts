/** The worked examples of Trimaran's own wire page match this page's encoder and decoder. */

import assert from "node:assert/strict";
import { Reader, Writer, whole } from "trimaran-transport";

import { CloseCode, type Identity, TRIMARAN } from "../src/proto/identity.ts";
import { type RoleMessage, viewMessages } from "../src/proto/messages.ts";
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
import { FrameAssembler, loadHasher } from "../wire/src/frames.ts";
import {
  decodeHello,
  decodeVersionedAccept,
  encodeHello,
  encodeVersionedAccept,
  type Hello,
} from "../wire/src/handshake.ts";
import { Kind } from "../wire/src/messages.ts";
import { formatOf } from "../wire/src/protocol.ts";
import { type Check, closed, onlyMessage, refused, same, testPage } from "../wire/tests/examples.ts";
import { endOf, examplesOf, range } from "../wire/tests/support.ts";
import { encodeIds } from "./idEncoder.ts";

const hasher = await loadHasher();

const { encode: encodeIdentity, decode: decodeIdentity } = whole(TRIMARAN.hello);
const { encode: encodeCamera, decode: decodeCamera } = whole(TRIMARAN.latest);
const { encode: encodeRoleMessage, decode: decodeRoleMessage } = whole(TRIMARAN.message);

const PROTO = "proto/WIRE.md";
const FORMAT = formatOf(TRIMARAN);

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
        versions: { highest: 5, lowest: 4 },
        application: TRIMARAN.name,
        session: 5n,
        lane,
        idleTimeout: 20_000,
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

testPage(PROTO, FORMAT, {
  hello: introduced("latest", DISPLAY),
  "hello-without-a-scene": introduced("bulk", { ...DISPLAY, scene: undefined }),
  accept: same(
    Kind.versionedAccept,
    { role: "culler", scene: SCENE, session: undefined },
    (payload) => decodeIdentity(decodeVersionedAccept(payload).introduction),
    (identity) =>
      encodeVersionedAccept({ version: 5, idleTimeout: 20_000, introduction: encodeIdentity(identity) }),
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
      const assembler = new FrameAssembler(hasher, TRIMARAN, 1000);
      for (const name of ["begin", "ids"]) {
        assembler.take(onlyMessage(examplesOf(PROTO).get(name) ?? new Uint8Array(0), FORMAT));
      }
      const ended = assembler.take({ kind: Kind.end, payload: endOf(9, [1, 258]) });
      assert(ended !== undefined);
      assert.deepEqual([...ended.items], [1, 258]);
      assert.deepEqual(ended.header, CAMERA);
      return new Writer().u32(1).u32(258).take();
    },
  },
  "coded-ids": {
    kind: Kind.codedBatch,
    check(payload) {
      const decoder = TRIMARAN.decoder?.();
      assert(decoder !== undefined);
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
      device: { drawing: 200n, pyramid: 20n, culling: 60n },
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
  followed: said({ what: "followed", leader: 7n, firstFrame: 5 }),
  view: {
    kind: Kind.message,
    check(payload) {
      const message = decodeRoleMessage(payload);
      assert(message.what === "view");
      assert.deepEqual([message.version, message.isLast], [3, true]);
      assert.deepEqual(decodeViewState(message.part), VIEW);
      const [only, ...more] = viewMessages(3, VIEW);
      assert.equal(more.length, 0);
      return only && encodeRoleMessage(only);
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
