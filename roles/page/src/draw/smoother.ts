/** Makes the normals of round surfaces bit by bit, while the eye rests: moving pictures do without. */

import type { GeometryArena, Held } from "./arena.ts";
import { Blocks } from "./blocks.ts";
import type { Drawable } from "./model.ts";
import { soften } from "./normals.ts";
import { Surface } from "./surface.ts";

/** The most triangles whose normals are made together: more would hold up the screen. */
const MOST = 1 << 14;

/** Pieces of one object in one local frame: surfaces run through them. */
interface Group {
  readonly of: Drawable;
  readonly pieces: Held[];
  triangles: number;
}

export class Smoother {
  readonly #arena: GeometryArena;
  readonly #blocks: Blocks;
  /** These have been grouped, at this state of the arena. */
  #drawables: readonly Drawable[] | undefined;
  #changes = 0;
  /** Nothing once all is done, as it may have grown large. */
  #surface: Surface | undefined;
  /** The groups that are left to do. */
  #groups: Group[] = [];

  constructor(gl: WebGL2RenderingContext, arena: GeometryArena) {
    [this.#arena, this.#blocks] = [arena, new Blocks(gl)];
  }

  /** Goes on for so many milliseconds. Returns whether all drawables have their normals. */
  smooth(drawables: readonly Drawable[], milliseconds: number): boolean {
    const begun = performance.now();
    if (this.#drawables !== drawables || this.#changes !== this.#arena.changes) {
      [this.#drawables, this.#changes] = [drawables, this.#arena.changes];
      this.#blocks.clear();
      this.#groups = groupsOf(this.#arena, drawables).filter(isDue);
    }
    this.#surface ??= new Surface();
    while (this.#groups.length > 0 && performance.now() - begun < milliseconds) {
      const group = this.#groups.pop();
      // An instance of the same pieces may have come before.
      if (group !== undefined && isDue(group)) {
        this.#soften(group.pieces, this.#surface);
      }
    }
    if (this.#groups.length > 0) {
      return false;
    }
    this.#blocks.clear();
    this.#surface = undefined;
    return true;
  }

  #soften(pieces: readonly Held[], surface: Surface): void {
    const flats = pieces.map(({ page, spot }) => page.flat(spot, this.#blocks));
    const softs = soften(flats, this.#arena.provoking === "first" ? 0 : 2, surface);
    if (pieces.some(({ spot }) => spot.copies !== undefined)) {
      // Their copies go elsewhere, and indices that were read before would be of the old place.
      this.#blocks.clear();
    }
    for (const [at, held] of pieces.entries()) {
      const [flat, soft] = [flats[at], softs[at]];
      if (flat !== undefined && soft !== undefined) {
        held.page.soften(held.spot, flat, soft);
        held.softWith = pieces.length;
      }
    }
  }
}

/** Whether a piece has no normals yet, or those made with fewer of the pieces around it. */
function isDue({ pieces }: Group): boolean {
  return pieces.some(({ softWith }) => softWith < pieces.length);
}

/** Ordered by their place on the device, which is read in blocks. */
function groupsOf(arena: GeometryArena, drawables: readonly Drawable[]): Group[] {
  const groups: Group[] = [];
  /** The groups of each object that are not full. */
  const byObject = new Map<number, Group[]>();
  for (const drawable of drawables) {
    const held = arena.range(drawable.geometry);
    if (held === undefined) {
      continue;
    }
    const own = byObject.get(drawable.object) ?? [];
    const triangles = held.count / 3;
    let group = own.find((one) => isOneFrame(one.of, drawable) && one.triangles + triangles <= MOST);
    if (group === undefined) {
      group = { of: drawable, pieces: [], triangles: 0 };
      groups.push(group);
      byObject.set(drawable.object, [group, ...own]);
    }
    group.pieces.push(held);
    group.triangles += triangles;
  }
  const start = ({ pieces: [first] }: Group) => first?.byteOffset ?? 0;
  return groups.sort((a, b) => start(a) - start(b));
}

function isOneFrame(one: Drawable, other: Drawable): boolean {
  const isSame = (a: readonly number[], b: readonly number[]) => a.every((number, at) => number === b[at]);
  return isSame(one.origin, other.origin) && isSame(one.linear, other.linear);
}
