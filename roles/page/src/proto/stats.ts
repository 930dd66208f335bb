/** A culler's report of its own work on a frame. */

import type { Reader, Writer } from "../wire/bytes.ts";

/** Times are nanoseconds on the sender's clock. */
export interface Stats {
  /** The display's number. */
  readonly frame: number;
  /** The frame whose visible set OR drew from. */
  readonly occludersOf: number | undefined;
  readonly orStart: bigint;
  readonly orEnd: bigint;
  readonly orBusy: bigint;
  readonly hcStart: bigint;
  readonly hcEnd: bigint;
  readonly occluders: number;
  readonly occluderTriangles: bigint;
  readonly culling: Culling;
  readonly furtherRounds: FurtherRounds;
  readonly toOtherCuller: SentBytes;
}

/** Counters of the culling traversal. */
export type Culling = Readonly<Record<(typeof CULLING)[number], number>>;

/** The work after the first traversal. */
export interface FurtherRounds {
  readonly count: number;
  readonly occluderTriangles: bigint;
  /** Nanoseconds. */
  readonly drawing: bigint;
  readonly tested: number;
  readonly hidden: number;
}

/** Bytes by kind, and the number of messages. */
export type SentBytes = Readonly<Record<(typeof SENT)[number], bigint>>;

export function readStats(reader: Reader): Stats {
  return {
    frame: reader.varint32(),
    occludersOf: reader.option(() => reader.varint32()),
    orStart: reader.varint64(),
    orEnd: reader.varint64(),
    orBusy: reader.varint64(),
    hcStart: reader.varint64(),
    hcEnd: reader.varint64(),
    occluders: reader.varint32(),
    occluderTriangles: reader.varint64(),
    culling: readEach(CULLING, () => reader.varint32()),
    furtherRounds: {
      count: reader.varint32(),
      occluderTriangles: reader.varint64(),
      drawing: reader.varint64(),
      tested: reader.varint32(),
      hidden: reader.varint32(),
    },
    toOtherCuller: readEach(SENT, () => reader.varint64()),
  };
}

export function writeStats(writer: Writer, stats: Stats): void {
  writer.varint(stats.frame).option(stats.occludersOf, (frame) => writer.varint(frame));
  for (const time of [stats.orStart, stats.orEnd, stats.orBusy, stats.hcStart, stats.hcEnd]) {
    writer.varint(time);
  }
  writer.varint(stats.occluders).varint(stats.occluderTriangles);
  for (const name of CULLING) {
    writer.varint(stats.culling[name]);
  }
  const { count, occluderTriangles, drawing, tested, hidden } = stats.furtherRounds;
  writer.varint(count).varint(occluderTriangles).varint(drawing).varint(tested).varint(hidden);
  for (const name of SENT) {
    writer.varint(stats.toOtherCuller[name]);
  }
}

/** Reads a value for each name, in order. */
function readEach<N extends string, T>(names: readonly N[], read: () => T): Readonly<Record<N, T>> {
  return Object.fromEntries(names.map((name) => [name, read()])) as Record<N, T>;
}

const CULLING = [
  "visited",
  "outside",
  "tested",
  "hidden",
  "nearVisible",
  "eyeInside",
  "notFinite",
  "fewPixels",
  "emitted",
  "refined",
  "batches",
] as const;

const SENT = ["camera", "begin", "ids", "end", "control", "geometry", "headers", "messages"] as const;
