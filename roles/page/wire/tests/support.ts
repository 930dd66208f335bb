/** Shared by several tests. */

import assert from "node:assert/strict";
import { existsSync, readFileSync } from "node:fs";
import { dirname, join } from "node:path";

import { Writer } from "../src/bytes.ts";
import { hashOf, loadHasher } from "../src/frames.ts";
import type { Clock, Connection } from "../src/lane.ts";
import type { Message, MessageStream } from "../src/messages.ts";

/** The examples of a page by name: fenced blocks `hex NAME`, with a comment behind a `#` in any line. */
export function examplesOf(page: string): Map<string, Uint8Array> {
  const text = readFileSync(fileOf(page), "utf8");
  const examples = new Map<string, Uint8Array>();
  for (const [, name = "", body = ""] of text.matchAll(/\n```hex (.*)\n([\s\S]*?)\n```/g)) {
    examples.set(name, fromHex(body.replaceAll(/#.*/g, "")));
  }
  return examples;
}

/** A file of the repository, which the tests run somewhere in. */
export function fileOf(path: string): string {
  for (let folder = process.cwd(); ; folder = dirname(folder)) {
    const file = join(folder, path);
    if (existsSync(file) || folder === dirname(folder)) {
      return file;
    }
  }
}

export function fromHex(text: string): Uint8Array<ArrayBuffer> {
  const digits = text.split(/\s+/).filter((word) => word !== "");
  return Uint8Array.from(digits, (byte) => Number.parseInt(byte, 16));
}

export function toHex(bytes: Uint8Array): string {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join(" ");
}

export function concat(...parts: readonly Uint8Array[]): Uint8Array<ArrayBuffer> {
  return Uint8Array.from(parts.flatMap((part) => [...part]));
}

/** The whole messages in a stream. */
export function takeAll(stream: MessageStream): Message[] {
  const taken: Message[] = [];
  for (let message = stream.take(); message !== undefined; message = stream.take()) {
    taken.push(message);
  }
  return taken;
}

const senderHasher = await loadHasher();

/** The payload of the end of a frame of these items of u32. */
export function endOf(number: number, items: readonly number[]): Uint8Array<ArrayBuffer> {
  senderHasher.init().update(new Uint8Array(Uint32Array.from(items).buffer));
  return new Writer().u32(number).u32(items.length).u64(hashOf(senderHasher)).take();
}

/** The numbers from `first` to before `end`. */
export function range(first: number, end: number): number[] {
  return Array.from({ length: Math.max(0, end - first) }, (_, at) => first + at);
}

/** Pseudo-random numbers from 0 to below `below`, by seed (mulberry32). */
export function randomOf(seed: number): (below: number) => number {
  let state = seed;
  return (below) => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return Math.floor((((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32) * below);
  };
}

/** A clock that advances on request. */
export class FakeClock implements Clock {
  #now = 0;
  #waiting = new Set<{ when: number; call: () => void }>();

  now(): number {
    return this.#now;
  }

  after(milliseconds: number, call: () => void): () => void {
    const waiting = { when: this.#now + Math.max(0, milliseconds), call };
    this.#waiting.add(waiting);
    return () => this.#waiting.delete(waiting);
  }

  /** How many calls are pending. */
  get waiting(): number {
    return this.#waiting.size;
  }

  pass(milliseconds: number): void {
    const until = this.#now + milliseconds;
    for (;;) {
      const due = [...this.#waiting].filter(({ when }) => when <= until);
      const next = due.sort((a, b) => a.when - b.when)[0];
      if (next === undefined) {
        break;
      }
      this.#waiting.delete(next);
      this.#now = Math.max(this.#now, next.when);
      next.call();
    }
    this.#now = until;
  }
}

/** A connection with the test as other end. */
export class FakeConnection implements Connection {
  onBytes: ((bytes: Uint8Array) => void) | undefined;
  onEnd: ((why: string) => void) | undefined;
  sent: Uint8Array[] = [];
  isClosed = false;
  waiting = 0;

  send(bytes: Uint8Array): void {
    assert(!this.isClosed, "nothing is sent after the close");
    this.sent.push(bytes);
  }

  buffered(): number {
    return this.waiting;
  }

  close(): void {
    assert(!this.isClosed, "it is closed once");
    this.isClosed = true;
  }
}

/** Waits until all pending tasks have run. */
export function settled(): Promise<void> {
  return new Promise((resolve) => setImmediate(resolve));
}
