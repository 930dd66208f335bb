/** The triangles of many pieces of geometry in few buffers of the device, so that one call draws many. */

import { VERTEX_BYTES } from "../proto/piece.ts";
import type { Provoking } from "./features.ts";
import type { Mesh, Triangles } from "./model.ts";
import { byteOffset, DEVICE_BYTES, GeometryPage, type Spot } from "./page.ts";
import type { Bounds } from "./view.ts";

/** The vertex capacity of the first page, and the least of a page for several pieces. */
const FIRST_VERTICES = 1 << 16;
const MOST_VERTICES = 1 << 20;
/** The index capacity of a page per vertex. */
const INDICES_EACH = 6;
/** The room of a page for copies of vertices, as a share of a piece that fills it. */
const FOR_COPIES = 1 / 8;

/** The place of a piece's triangles. */
export interface Range {
  readonly page: GeometryPage;
  /** The page's number, below `pages`, until the next piece comes or goes. */
  readonly pageNumber: number;
  /** Where its indices begin in the page, in bytes. */
  readonly byteOffset: number;
  /** How many indices. */
  readonly count: number;
  /** The box around its vertices, in its local frame. */
  readonly bounds: Bounds;
}

/** A piece in the arena. */
export interface Held extends Range {
  pageNumber: number;
  readonly spot: Spot;
  /** How many pieces its normals were made with, itself among them; 0 if it has none yet. */
  softWith: number;
}

export class GeometryArena {
  readonly #gl: WebGL2RenderingContext;
  readonly provoking: Provoking;
  readonly pages: GeometryPage[] = [];
  readonly #pieces = new Map<number, Held>();
  /** Changes whenever a piece comes or goes. */
  changes = 0;

  constructor(gl: WebGL2RenderingContext, provoking: Provoking) {
    [this.#gl, this.provoking] = [gl, provoking];
  }

  /** Bytes that pieces take. */
  get bytes(): number {
    return this.pages.reduce((sum, page) => sum + page.used, 0);
  }

  /** Bytes on the device, used or free. */
  get capacity(): number {
    return this.pages.reduce((sum, page) => sum + page.capacity, 0);
  }

  /** The place of a piece's triangles, if it is here. */
  range(piece: number): Held | undefined {
    return this.#pieces.get(piece);
  }

  /** The triangles of a piece, read back from the device. */
  triangles(piece: number): Triangles | undefined {
    const held = this.#pieces.get(piece);
    return held?.page.read(held.spot);
  }

  /**
   * Takes a piece, replacing the one of that number. A piece without triangles only removes it.
   *
   * Throws if the device is out of memory.
   */
  set(piece: number, mesh: Mesh): void {
    this.drop(piece);
    if (mesh.indices.length === 0) {
      return;
    }
    let [page, spot] = this.#room(mesh) ?? [];
    if (page === undefined || spot === undefined) {
      page = this.#grow(mesh);
      spot = page.add(mesh);
    }
    if (spot !== undefined) {
      this.changes += 1;
      this.#pieces.set(piece, {
        softWith: 0,
        page,
        spot,
        pageNumber: this.pages.indexOf(page),
        byteOffset: byteOffset(spot),
        count: mesh.indices.length,
        bounds: boundsOf(mesh.vertices),
      });
    }
  }

  drop(piece: number): void {
    const held = this.#pieces.get(piece);
    if (held === undefined) {
      return;
    }
    this.changes += 1;
    this.#pieces.delete(piece);
    held.page.remove(held.spot);
    if (held.page.used === 0 && this.pages.length > 1) {
      held.page.delete();
      this.pages.splice(held.pageNumber, 1);
      for (const other of this.#pieces.values()) {
        other.pageNumber -= other.pageNumber > held.pageNumber ? 1 : 0;
      }
    }
  }

  #room(mesh: Mesh): [GeometryPage, Spot] | undefined {
    for (const page of this.pages) {
      const spot = page.add(mesh);
      if (spot !== undefined) {
        return [page, spot];
      }
    }
    return undefined;
  }

  /** A new page, as large as all before together within bounds, and large enough for the mesh. */
  #grow({ vertices, indices }: Mesh): GeometryPage {
    const wanted = Math.max(FIRST_VERTICES, this.capacity / (DEVICE_BYTES + 4 * INDICES_EACH));
    const usual = Math.min(MOST_VERTICES, Math.ceil(wanted));
    const page = new GeometryPage(
      this.#gl,
      this.provoking,
      Math.max(usual, Math.ceil((1 + FOR_COPIES) * (vertices.length / VERTEX_BYTES))),
      Math.max(usual * INDICES_EACH, indices.length),
    );
    this.pages.push(page);
    return page;
  }
}

/** The box around the positions of vertices. */
export function boundsOf(vertices: Uint8Array<ArrayBuffer>): Bounds {
  const whole = vertices.byteOffset % 4 === 0 ? vertices : vertices.slice();
  const words = new Float32Array(whole.buffer, whole.byteOffset, Math.floor(whole.length / 4));
  const bounds = new Float64Array(6);
  const wordsEach = VERTEX_BYTES / 4;
  for (let axis = 0; axis < 3 && words.length > 0; axis += 1) {
    let [low, high] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
    for (let i = axis; i < words.length; i += wordsEach) {
      const coordinate = words[i] ?? 0;
      low = Math.min(low, coordinate);
      high = Math.max(high, coordinate);
    }
    bounds[axis] = (low + high) / 2;
    bounds[3 + axis] = (high - low) / 2;
  }
  return bounds;
}
