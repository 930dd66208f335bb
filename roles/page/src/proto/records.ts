/** Records of drawables: the data for drawing a drawable and its node, except its triangles. */

import { Reader, WireError } from "trimaran-transport";
import type { Point } from "../space/point.ts";
import { POINT } from "./camera.ts";
import type { Outline } from "./identity.ts";
import { BOTH_SIDES } from "./sides.ts";
import { unzstd } from "./zstd.ts";

export interface DrawableRecord {
  /** Lower and upper corner of its box in the world, metres. */
  readonly worldMin: Point;
  readonly worldMax: Point;
  /** Origin of the node's local frame in the world, metres. */
  readonly origin: Point;
  /** Local frame to world without the translation: nine numbers, column by column. */
  readonly linear: readonly number[];
  readonly id: number;
  readonly node: number;
  /** Its piece of geometry. */
  readonly geometry: number;
  /** How many triangles that has. */
  readonly triangles: number;
  /** The eyes to which both sides of its triangles are visible: see `sides.ts`. */
  readonly sides: number;
  /** An object that it shows. */
  readonly object: number;
  /** How many objects it shows. */
  readonly objects: number;
  /** The first drawable of its level, which is drawn in pieces. */
  readonly level: number;
  /** How many drawables the level consists of. */
  readonly pieces: number;
}

/** The most records packed together. */
export const MOST_PACKED = 256;

/** The most pieces of a level. */
const MOST_PIECES = 65_535;

/** The most records that a display keeps. */
export const MOST_RECORDS = 4_194_304;

const RECORD_BYTES = 144;

/** Unpacks records that were packed together. */
export function unpackRecords(packed: Uint8Array): DrawableRecord[] {
  const reader = new Reader(packed);
  const count = reader.u16();
  if (count > MOST_PACKED) {
    throw new WireError(`${count} records are packed together: ${MOST_PACKED} is the most`);
  }
  const columns = unzstd(reader.rest(), count * RECORD_BYTES);
  const rows = new Reader(rowsOf(columns, count));
  const records: DrawableRecord[] = [];
  for (let row = 0; row < count; row += 1) {
    records.push(addBefore(readRecord(rows), records.at(-1)));
  }
  return records;
}

/** Keeps the records of one scene, and refuses those that cannot belong to it. */
export class Records {
  readonly #outline: Outline;
  readonly #byId = new Map<number, DrawableRecord>();
  /** A record of each node: all of a node agree on the node's data. */
  readonly #byNode = new Map<number, DrawableRecord>();
  readonly #most: number;

  constructor(outline: Outline, most = MOST_RECORDS) {
    this.#outline = outline;
    this.#most = most;
  }

  get count(): number {
    return this.#byId.size;
  }

  get(id: number): DrawableRecord | undefined {
    return this.#byId.get(id);
  }

  /** The ids of all drawables whose records are there. */
  ids(): IterableIterator<number> {
    return this.#byId.keys();
  }

  /** Takes a record. It may be repeated, but not changed. Returns whether it is new. */
  take(record: DrawableRecord): boolean {
    const fault = faultOfRecord(record, this.#outline);
    if (fault !== undefined) {
      throw new WireError(`the record of drawable ${record.id}: ${fault}`);
    }
    const [known, sameNode] = [this.#byId.get(record.id), this.#byNode.get(record.node)];
    const isOther = known !== undefined && !isSameDrawable(known, record);
    if (isOther || (sameNode !== undefined && !isSameNode(sameNode, record))) {
      throw new WireError(`drawable ${record.id} or its node came once more, and is another one`);
    }
    if (known !== undefined) {
      return false;
    }
    if (this.#byId.size >= this.#most) {
      throw new WireError(`more than ${this.#most} records came`);
    }
    this.#byId.set(record.id, record);
    if (sameNode === undefined) {
      this.#byNode.set(record.node, record);
    }
    return true;
  }
}

/** Why a record cannot belong to the scene, if so. */
export function faultOfRecord(record: DrawableRecord, outline: Outline): string | undefined {
  const { worldMin, worldMax, origin, linear } = record;
  const numbers = [
    ["drawable", record.id, outline.drawables],
    ["node", record.node, outline.nodes],
    ["geometry", record.geometry, outline.geometries],
    ["object", record.object, outline.objects],
  ] as const;
  const beyond = numbers.find(([, number, count]) => number >= count);
  if (beyond !== undefined) {
    const [what, number, count] = beyond;
    return `it has ${what} ${number}, and the scene only ${count} of these`;
  }
  if (![...worldMin, ...worldMax, ...origin, ...linear].every(Number.isFinite)) {
    return "a number is not finite";
  }
  if (worldMin.some((low, axis) => low > (worldMax[axis] ?? low))) {
    return "its box is inside out";
  }
  if (record.sides > BOTH_SIDES) {
    return "its sides are unknown";
  }
  if (record.triangles === 0) {
    return "it has no triangles";
  }
  const { id, level, pieces } = record;
  const isPiece = pieces <= MOST_PIECES && id >= level && id < level + pieces;
  return isPiece ? undefined : "it is no piece of its level";
}

/** Transposes columns to one record behind the other. */
function rowsOf(columns: Uint8Array, count: number): Uint8Array {
  const rows = new Uint8Array(columns.length);
  for (let column = 0; column < RECORD_BYTES; column += 1) {
    for (let row = 0; row < count; row += 1) {
      rows[row * RECORD_BYTES + column] = columns[column * count + row] ?? 0;
    }
  }
  return rows;
}

function readRecord(reader: Reader): DrawableRecord {
  return {
    worldMin: POINT.read(reader),
    worldMax: POINT.read(reader),
    origin: POINT.read(reader),
    linear: Array.from({ length: 9 }, () => reader.f32()),
    id: reader.u32(),
    node: reader.u32(),
    geometry: reader.u32(),
    triangles: reader.u32(),
    sides: reader.u32(),
    object: reader.u32(),
    // The topmost bit marks see-through objects of the model: a page knows those already.
    objects: reader.u32() & 0x7fff_ffff,
    level: reader.u32(),
    pieces: reader.u32(),
  };
}

/** A record whose numbers are differences from the record before it, if there is one. */
function addBefore(record: DrawableRecord, before: DrawableRecord | undefined): DrawableRecord {
  if (before === undefined) {
    return record;
  }
  return {
    ...record,
    id: (record.id + before.id) >>> 0,
    node: (record.node + before.node) >>> 0,
    geometry: (record.geometry + before.geometry) >>> 0,
    object: (record.object + before.object) >>> 0,
    level: (record.level + before.level) >>> 0,
  };
}

const DRAWABLE_FIELDS = ["node", "geometry", "triangles", "sides", "level", "pieces"] as const;

function isSameDrawable(a: DrawableRecord, b: DrawableRecord): boolean {
  const corners = ({ worldMin, worldMax }: DrawableRecord) => [...worldMin, ...worldMax];
  return DRAWABLE_FIELDS.every((name) => a[name] === b[name]) && areEqual(corners(a), corners(b));
}

function isSameNode(a: DrawableRecord, b: DrawableRecord): boolean {
  const numbers = ({ origin, linear, object, objects }: DrawableRecord) =>
    [...origin, ...linear, object, objects] as const;
  return areEqual(numbers(a), numbers(b));
}

function areEqual(numbers: readonly number[], others: readonly number[]): boolean {
  return numbers.every((number, at) => number === others[at]);
}
