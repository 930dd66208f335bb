/** Numbers, texts and options on the wire. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { cutText, Reader, randomNumber, shownText, WireError, Writer } from "../src/bytes.ts";
import { number } from "../src/fixed.ts";
import { fromHex, range, toHex } from "./support.ts";

const read = (hex: string) => new Reader(fromHex(hex));

test("numbers of fixed width are little-endian", () => {
  const writer = new Writer().u8(1).u16(0x0302).u24(0x060504).u32(0x8a090807).u64(0x8807060504030201n);
  const bytes = writer.f32(1.5).f64(-2.5).take();
  assert.equal(
    toHex(bytes),
    "01 02 03 04 05 06 07 08 09 8a 01 02 03 04 05 06 07 88 00 00 c0 3f 00 00 00 00 00 00 04 c0",
  );
  const reader = new Reader(bytes);
  assert.deepEqual(
    [reader.u8(), reader.u16(), reader.u24(), reader.u32()],
    [1, 0x0302, 0x060504, 0x8a090807],
  );
  assert.equal(reader.u64(), 0x8807060504030201n);
  assert.deepEqual([reader.f32(), reader.f64(), reader.isAtEnd], [1.5, -2.5, true]);
  assert.equal(
    read("01 00 00 00 00 00 00 00 00 00 00 00 00 00 00 80").fixed(number("u128")),
    (1n << 127n) + 1n,
  );
});

test("a reader reads a part of a buffer as if it were alone", () => {
  const reader = new Reader(fromHex("ff ff 01 00 00 00 ff").subarray(2, 6));
  assert.deepEqual([reader.u32(), reader.position], [1, 4]);
  assert.throws(() => reader.u8(), new WireError("cut short: 1 bytes expected, 0 left"));
});

test("varints take a byte for every seven bits", () => {
  for (const [value, size] of [
    [0, 1],
    [127, 1],
    [128, 2],
    [16_383, 2],
    [16_384, 3],
    [0xffff_ffff, 5],
  ] as const) {
    const bytes = new Writer().varint(value).take();
    assert.equal(bytes.length, size);
    const reader = new Reader(bytes);
    assert.deepEqual([reader.varint32(), reader.isAtEnd], [value, true]);
  }
  for (const bits of [64, 128] as const) {
    const largest = (1n << BigInt(bits)) - 1n;
    const bytes = new Writer().varint(largest).take();
    assert.equal(bytes.length, Math.ceil(bits / 7));
    const reader = new Reader(bytes);
    assert.equal(bits === 64 ? reader.varint64() : reader.varint128(), largest);
  }
  assert.equal(read("80 80 00").varint32(), 0, "the shortest form is not asked for, as in postcard");
});

test("varints that are cut short, too long or too large are refused", () => {
  const faults: [string, (reader: Reader) => unknown, string][] = [
    ["", (reader) => reader.varint32(), "cut short: 1 bytes expected, 0 left"],
    ["80", (reader) => reader.varint32(), "cut short: 1 bytes expected, 0 left"],
    ["ff ff ff ff 10", (reader) => reader.varint32(), "the number 4563402751 is above 32 bits"],
    ["80 80 80 80 80 00", (reader) => reader.varint32(), "a number is longer than 32 bits"],
    ["80 80 04", (reader) => reader.varint16(), "the number 65536 is above 16 bits"],
    ["80 80 80 00", (reader) => reader.varint16(), "a number is longer than 16 bits"],
    [
      "ff ff ff ff ff ff ff ff ff 02",
      (reader) => reader.varint64(),
      "the number 27670116110564327423 is above 64 bits",
    ],
    ["80 80 80 80 80 80 80 80 80 80 00", (reader) => reader.varint64(), "a number is longer than 64 bits"],
    [
      "80 80 80 80 80 80 80 10",
      (reader) => reader.varintCount(),
      "a count of 9007199254740992 is beyond 53 bits",
    ],
  ];
  for (const [hex, take, text] of faults) {
    assert.throws(() => take(read(hex)), new WireError(text), hex);
  }
});

test("what postcard does not write is refused", () => {
  assert.throws(() => read("02").bool(), new WireError("2 is neither no nor yes"));
  assert.throws(() => read("02 05").option(() => 1), new WireError("2 is neither no nor yes"));
  assert.throws(() => read("02").variant(["a", "b"]), new WireError("2 is none of a, b"));
  assert.throws(() => read("02 c3 28").text(), new WireError("a text is not UTF-8"));
  assert.throws(() => read("03 61 62").text(), new WireError("cut short: 3 bytes expected, 2 left"));
  assert.throws(() => read("03 61 62 63").text(2), new WireError("a text of 3 bytes is longer than 2"));
  assert.throws(() => read("ff ff ff ff 0f").byteString(), WireError, "nothing is set aside for a length");
  assert.throws(() => read("01 02").end(), new WireError("2 bytes too many"));
});

test("options, names and texts read back", () => {
  const bytes = new Writer()
    .option(undefined, () => {})
    .bool(true)
    .variant(["a", "b"], "b")
    .text("\ufeffé")
    .take();
  assert.equal(toHex(bytes), "00 01 01 05 ef bb bf c3 a9");
  const reader = new Reader(bytes);
  assert.equal(
    reader.option(() => 1),
    undefined,
  );
  assert.deepEqual([reader.bool(), reader.variant(["a", "b"]), reader.text()], [true, "b", "\ufeffé"]);
});

test("a writer grows and what was taken stays", () => {
  const writer = new Writer();
  for (const number of range(0, 1000)) {
    writer.u32(number);
  }
  const taken = writer.take();
  writer.u8(7);
  assert.deepEqual([taken.length, writer.length], [4000, 4001]);
  const reader = new Reader(taken);
  assert.deepEqual(
    range(0, 1000).map(() => reader.u32()),
    range(0, 1000),
  );
  // At each place where the buffer grows, for every kind of value.
  for (const before of range(56, 64)) {
    const bytes = new Writer().bytes(new Uint8Array(before)).f64(1).take();
    assert.equal(new Reader(bytes.subarray(before)).f64(), 1);
  }
});

test("what is no whole number is not written", () => {
  for (const value of [-1, -1n, 0.5, Number.NaN, 2 ** 53]) {
    assert.throws(() => new Writer().varint(value), RangeError, String(value));
  }
});

test("random numbers differ", () => {
  assert.equal(new Set(range(0, 20).map(randomNumber)).size, 20);
});

test("texts are cut at a character and shown escaped", () => {
  assert.equal(cutText("é".repeat(150), 200), "é".repeat(100));
  assert.equal(cutText(`x${"é".repeat(150)}`, 200), `x${"é".repeat(99)}`, "a half character does not travel");
  assert.equal(cutText("😀😀", 7), "😀");
  assert.equal(shownText("a\u001b[31mb"), "a\\u{1b}[31mb");
});
