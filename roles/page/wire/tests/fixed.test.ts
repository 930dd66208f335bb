/** Structs, arrays and items lie in memory as Rust's would, without padding. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Reader, WireError } from "../src/bytes.ts";
import {
  bool,
  bytes,
  type Codec,
  checked,
  count,
  i8,
  i16,
  i32,
  i64,
  list,
  option,
  record,
  u16,
  u32,
  u128,
  whole,
} from "../src/codec.ts";
import { array, nothing, number, struct } from "../src/fixed.ts";
import { itemsOf, typedItems } from "../src/items.ts";
import { defineProtocol, formatOf } from "../src/protocol.ts";
import { fromHex, toHex } from "./support.ts";

test("each number has its size, its order and its sign", () => {
  const cases = [
    ["u8", 0xfe, "fe"],
    ["i8", -2, "fe"],
    ["u16", 0xfffe, "fe ff"],
    ["i16", -2, "fe ff"],
    ["u32", 0xffff_fffe, "fe ff ff ff"],
    ["i32", -2, "fe ff ff ff"],
    ["u64", (1n << 64n) - 2n, "fe ff ff ff ff ff ff ff"],
    ["i64", -2n, "fe ff ff ff ff ff ff ff"],
    ["u128", (1n << 127n) + 1n, "01 00 00 00 00 00 00 00 00 00 00 00 00 00 00 80"],
    ["f32", 1.5, "00 00 c0 3f"],
    ["f64", -2.5, "00 00 00 00 00 00 04 c0"],
  ] as const;
  for (const [type, value, hex] of cases) {
    const { encode, decode } = whole<number | bigint>(number(type));
    assert.equal(toHex(encode(value)), hex, type);
    assert.equal(decode(fromHex(hex)), value, type);
    assert.equal(number(type).size, fromHex(hex).length);
  }
});

test("a struct has its fields one behind the other, structs and arrays among them", () => {
  const inner = struct({ id: "u8", at: array("f32", 2) });
  const outer = struct({ flag: "u8", inner, last: "u16" });
  assert.equal(outer.size, 12);
  const value = { flag: 1, inner: { id: 2, at: [1, -1] as const }, last: 0x304 };
  const hex = "01 02 00 00 80 3f 00 00 80 bf 04 03";
  assert.equal(toHex(whole(outer).encode(value)), hex);
  assert.deepEqual(whole(outer).decode(fromHex(hex)), value);
  assert.throws(() => whole(outer).decode(fromHex("01 02")), WireError);
  // Within postcard it is the same.
  assert.deepEqual(whole(option(inner)).decode(fromHex("01 02 00 00 80 3f 00 00 80 bf")), value.inner);
  const wrong = [1] as unknown as readonly [number, number];
  assert.throws(() => whole(inner).encode({ id: 2, at: wrong }), /an array of 1 values: it has 2/);
});

test("a value that has a fault is refused wherever it stands", () => {
  const even = checked(number("u8"), (n) => (n % 2 === 0 ? undefined : `${n} is odd`));
  assert.equal(even.size, 1);
  assert.throws(() => even.read(new Reader(Uint8Array.of(3))), new WireError("3 is odd"));
  assert.throws(() => struct({ even }).read(new Reader(Uint8Array.of(3))), new WireError("3 is odd"));
  assert.throws(() => itemsOf(even).decode(Uint8Array.of(2, 3)), new WireError("3 is odd"));
  const small = checked(u32, (n) => (n < 200 ? undefined : `${n} is large`));
  assert.throws(() => whole(record({ small })).decode(fromHex("c8 01")), new WireError("200 is large"));
});

test("items are values, or numbers in an array of their type", () => {
  const point = struct({ x: "f32", y: "f32" });
  const bytes = fromHex("00 00 80 3f 00 00 00 40 00 00 40 40 00 00 80 40");
  const points = [
    { x: 1, y: 2 },
    { x: 3, y: 4 },
  ];
  assert.deepEqual(itemsOf(point).decode(bytes), points);
  assert.deepEqual(itemsOf(point).encode(points), bytes);
  const typed = typedItems(Float32Array, 2);
  assert.equal(typed.size, 8);
  assert.deepEqual(typed.decode(bytes), Float32Array.of(1, 2, 3, 4));
  assert.deepEqual(typed.encode(new Float32Array([9, 1, 2, 3, 4]).subarray(1)), bytes);
  assert.throws(() => typed.encode(new Float32Array(3)), RangeError);
});

test("signed numbers of postcard are folded", () => {
  for (const [value, hex] of [
    [0, "00"],
    [-1, "01"],
    [1, "02"],
    [-64, "7f"],
    [64, "80 01"],
  ] as const) {
    for (const codec of [i16, i32]) {
      assert.equal(toHex(whole(codec).encode(value)), hex);
      assert.equal(whole(codec).decode(fromHex(hex)), value);
    }
    assert.equal(toHex(whole(i64).encode(BigInt(value))), hex);
    assert.equal(whole(i64).decode(fromHex(hex)), BigInt(value));
  }
  for (const value of [-(2 ** 31), 2 ** 31 - 1]) {
    assert.equal(whole(i32).decode(whole(i32).encode(value)), value);
  }
  for (const value of [-(1n << 63n), (1n << 63n) - 1n]) {
    assert.equal(whole(i64).decode(whole(i64).encode(value)), value);
  }
  assert.equal(whole(i8).decode(Uint8Array.of(0xff)), -1);
});

test("wide numbers, bytes and lists of postcard read back", () => {
  const check = <T>(codec: Codec<T>, value: T, hex: string) => {
    assert.equal(toHex(whole(codec).encode(value)), hex);
    assert.deepEqual(whole(codec).decode(fromHex(hex)), value);
  };
  check(u128, 1n << 127n, `${"80 ".repeat(18)}02`);
  check(count, Number.MAX_SAFE_INTEGER, "ff ff ff ff ff ff ff 0f");
  check(bool, true, "01");
  check(bool, false, "00");
  check(bytes, Uint8Array.of(7, 8), "02 07 08");
  const wheels = list(u16, 2, "wheels");
  check(wheels, [300, 5], "02 ac 02 05");
  assert.throws(
    () => whole(wheels).decode(fromHex("03 01 02 03")),
    new WireError("3 wheels: there can be 2"),
  );
});

test("a protocol is within the limits of the wire, and needs no more than a name and a hello", () => {
  const least = defineProtocol({ name: "least/1", hello: nothing });
  assert.deepEqual(formatOf(least), { latest: 0, header: 0, item: 4 });
  const define = (change: object) => () => defineProtocol({ name: "a", hello: nothing, ...change });
  const [value, items] = [array("u8", 1024), typedItems(Uint8Array, 256)];
  const most = defineProtocol({ name: "x".repeat(32), hello: nothing, latest: value, header: value, items });
  assert.deepEqual(formatOf(most), { latest: 1024, header: 1024, item: 256 });
  assert.throws(define({ name: "x".repeat(33) }), /has 33 bytes: it must have 1 to 32/);
  assert.throws(define({ latest: array("u8", 1025) }), /a latest value has 1025 bytes/);
  assert.throws(define({ header: array("u8", 1025) }), /a header has 1025 bytes/);
  assert.throws(define({ items: itemsOf(nothing) }), /an item has 0 bytes/);
  assert.throws(define({ items: typedItems(Uint8Array, 257) }), /an item has 257 bytes/);
});
