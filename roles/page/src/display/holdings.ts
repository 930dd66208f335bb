/** The page's copy of its scene: records of drawables, and pieces of geometry within a budget. */

import { WireError } from "trimaran-transport";
import type { Outline } from "../proto/identity.ts";
import { numberList } from "../proto/numbers.ts";
import { type Piece, PieceAssembler, SOFT_BYTES, unpackPiece, VERTEX_BYTES } from "../proto/piece.ts";
import { type DrawableRecord, MOST_RECORDS, Records, unpackRecords } from "../proto/records.ts";
import { decodeCullerBlock } from "../proto/supply.ts";

/** The renderer: it is told which pieces come and go. */
export interface Store {
  setPiece(number: number, piece: Piece): void;
  dropPiece(number: number): void;
}

/** The state of a piece. */
interface Held {
  readonly bytes: number;
  readonly triangles: number;
  /** The tick of its last use. */
  used: number;
}

export class Holdings {
  readonly outline: Outline;
  readonly #store: Store;
  /** Bytes of geometry on the device. One picture's geometry is kept even beyond the budget. */
  budget: number;
  readonly #records: Records;
  readonly #pieces = new Map<number, Held>();
  /** The first drawable of the level that stands in for a drawable, and how many it has. */
  readonly #standIns = new Map<number, readonly [number, number]>();
  /** How many triangles a piece has, by the records of its drawables. */
  readonly #triangles = new Map<number, number>();
  #assembler = new PieceAssembler();
  /** Bytes of geometry on the device. */
  bytes = 0;
  #tick = 0;

  constructor(outline: Outline, store: Store, budget: number) {
    [this.outline, this.#store, this.budget] = [outline, store, budget];
    this.#records = new Records(outline);
  }

  record(id: number): DrawableRecord | undefined {
    return this.#records.get(id);
  }

  /** Another culler supplies from now on. */
  beginAnew(): void {
    this.#assembler = new PieceAssembler();
  }

  /** Takes a block of a culler. Throws a `WireError` if it cannot belong to the scene. */
  take(block: Uint8Array): void {
    for (const item of decodeCullerBlock(block)) {
      switch (item.item) {
        case "entries":
          for (const record of unpackRecords(item.packed)) {
            this.#takeRecord(record);
          }
          break;
        case "geometry": {
          if (item.number >= this.outline.geometries) {
            throw new WireError(`the scene has no piece ${item.number} of geometry`);
          }
          const whole = this.#assembler.take(item);
          if (whole !== undefined) {
            this.#setPiece(whole.number, unpackPiece(whole.bytes));
          }
          break;
        }
        case "stand-in":
          for (const finer of item.drawables) {
            this.#standIns.set(finer, [item.id, item.pieces]);
          }
          if (this.#standIns.size > MOST_RECORDS) {
            throw new WireError(`more than ${MOST_RECORDS} drawables have stand-ins`);
          }
          break;
        case "ahead":
          break;
      }
    }
  }

  #takeRecord(record: DrawableRecord): void {
    this.#records.take(record);
    const { geometry, triangles } = record;
    this.#check(geometry, triangles, this.#triangles.get(geometry) ?? this.#pieces.get(geometry)?.triangles);
    this.#triangles.set(geometry, triangles);
  }

  #check(piece: number, triangles: number, known: number | undefined): void {
    if (known !== undefined && known !== triangles) {
      throw new WireError(`the geometry ${piece} has ${triangles} triangles here and ${known} there`);
    }
  }

  has(id: number): boolean {
    const record = this.#records.get(id);
    return record !== undefined && this.#pieces.has(record.geometry);
  }

  /** Returns those that are not complete here. */
  lacking(ids: Uint32Array): Uint32Array {
    return ids.filter((id) => !this.has(id));
  }

  /** The drawables to show for `ids`, with stand-ins for missing ones; and whether everything has one. */
  standingIn(ids: Uint32Array): { shown: number[]; isWhole: boolean } {
    const shown: number[] = [];
    let isWhole = true;
    const standIns = new Set<number>();
    for (const id of ids) {
      if (this.has(id)) {
        shown.push(id);
        continue;
      }
      const pieces = this.#standsIn(id);
      isWhole &&= pieces.length > 0;
      for (const piece of pieces) {
        standIns.add(piece);
      }
    }
    return { shown: [...shown, ...standIns], isWhole };
  }

  /** The stand-ins for a drawable, if all of them are here. */
  #standsIn(id: number): readonly number[] {
    const [first, count] = this.#standIns.get(id) ?? [0, 0];
    const pieces: number[] = [];
    for (let piece = first; piece < first + count; piece += 1) {
      if (!this.has(piece)) {
        return [];
      }
      pieces.push(piece);
    }
    return pieces;
  }

  /** All drawables and pieces that are here. */
  all(): [Uint32Array, Uint32Array] {
    return [numberList(this.#records.ids()), numberList(this.#pieces.keys())];
  }

  /** Notes that these are shown. Evicts the least recently used pieces over budget; returns them. */
  use(drawables: readonly DrawableRecord[]): Uint32Array {
    this.#tick += 1;
    for (const { geometry } of drawables) {
      const held = this.#pieces.get(geometry);
      if (held !== undefined) {
        held.used = this.#tick;
      }
    }
    if (this.bytes <= this.budget) {
      return new Uint32Array(0);
    }
    const idle = [...this.#pieces].filter(([, { used }]) => used < this.#tick);
    idle.sort(([, a], [, b]) => a.used - b.used);
    const dropped: number[] = [];
    for (const [number, { bytes }] of idle) {
      if (this.bytes <= this.budget) {
        break;
      }
      this.#pieces.delete(number);
      this.bytes -= bytes;
      this.#store.dropPiece(number);
      dropped.push(number);
    }
    return numberList(dropped);
  }

  /** The renderer has lost everything. Returns the lost pieces. */
  loseAll(): Uint32Array {
    const gone = numberList(this.#pieces.keys());
    this.#pieces.clear();
    this.bytes = 0;
    return gone;
  }

  #setPiece(number: number, piece: Piece): void {
    this.#check(number, piece.triangles, this.#triangles.get(number));
    const { vertices, indices } = piece;
    const softBytes = (SOFT_BYTES * vertices.byteLength) / VERTEX_BYTES;
    const bytes = vertices.byteLength + softBytes + indices.byteLength;
    this.bytes += bytes - (this.#pieces.get(number)?.bytes ?? 0);
    this.#pieces.set(number, { bytes, triangles: piece.triangles, used: this.#tick });
    this.#store.setPiece(number, piece);
  }
}
