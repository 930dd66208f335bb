/** Checks the worked examples of a wire page against this encoder and decoder. */

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  type Close,
  decodeClose,
  decodeRefuse,
  encodeClose,
  encodeRefuse,
  type Refusal,
} from "../src/handshake.ts";
import { encodeMessage, type Format, Kind, type Message, MessageStream } from "../src/messages.ts";
import { examplesOf, takeAll, toHex } from "./support.ts";

/** Checks the values of an example, and returns their encoding, if this side can send it. */
export interface Check {
  readonly kind: Kind;
  readonly check: (payload: Uint8Array) => Uint8Array | undefined;
}

export function testPage(page: string, format: Format, checks: Readonly<Record<string, Check>>): void {
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

export function onlyMessage(bytes: Uint8Array, format: Format): Message {
  const stream = new MessageStream(format);
  stream.push(bytes);
  const [message, ...more] = takeAll(stream);
  assert(message !== undefined && more.length === 0 && stream.pending === 0, "it is one message");
  return message;
}

export function same<T>(
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

export const refused = (expected: Refusal) => same(Kind.refuse, expected, decodeRefuse, encodeRefuse);
export const closed = (expected: Close) => same(Kind.close, expected, decodeClose, encodeClose);
