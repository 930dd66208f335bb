/** The surface that triangles make, and its normals: facets with no crease between them share one. */

import { WORDS_EACH } from "./page.ts";
import { BEND } from "./shaders.ts";

/** The cosine of the angle below which facets are one: half a degree. */
const LEVEL = 0.99996;
/** The most facets of a round place, since each is compared with each. */
const MOST_FACETS = 31;
/** The height of the thinnest triangle that counts, relative to coordinates: 16 roundings of these. */
const THINNEST = 1e-6;

/** A corner without a bundle. */
export const NONE = -1;

/** Triangles of one piece of geometry as the device has them. */
export interface Flat {
  /** All of the vertices. */
  readonly words: Float32Array;
  /** Three a triangle. */
  readonly indices: Uint32Array;
}

/** All triangles of some pieces, welded where positions are equal. It is used again, as pieces are many. */
export class Surface {
  /** The bundle of each corner: facets that share a normal there. `NONE` if the triangle stays flat. */
  bundles = new Int32Array(0);
  /** Whether the facets of each bundle have different normals, and its normal. */
  areRound = new Uint8Array(0);
  normals = new Float32Array(0);
  /** Whether any is round. */
  isRound = false;
  /** Whether each triangle has a normal. */
  haveArea = new Uint8Array(0);
  /** How many corners and bundles there are. The arrays may be longer. */
  #count = 0;
  #bundled = 0;
  /** The position of each corner, its place, and its facet among those of the place. */
  #corners = new Float32Array(0);
  #places = new Uint32Array(0);
  #facets = new Uint8Array(0);
  /** The unit normals of triangles, and twice their areas. */
  #facing = new Float64Array(0);
  #areas = new Float64Array(0);
  /** The first corner of each place, then the start of each place's corners; and these. */
  #starts = new Uint32Array(0);
  #meeting = new Uint32Array(0);
  /** Places by hash. */
  #table = new Int32Array(0);

  /** Takes the triangles of these in place of all before. */
  load(pieces: readonly Flat[]): void {
    const count = pieces.reduce((sum, { indices }) => sum + indices.length, 0);
    this.#reserve(count);
    this.bundles.fill(NONE, 0, count);
    this.areRound.fill(0, 0, count);
    this.haveArea.fill(0, 0, count / 3);
    [this.#count, this.#bundled, this.isRound] = [count, 0, false];
    const corners = this.#corners;
    let to = 0;
    for (const { words, indices } of pieces) {
      for (let corner = 0; corner < indices.length; corner += 1) {
        const from = WORDS_EACH * (indices[corner] ?? 0);
        // Adding 0 makes 0 of -0, so that places have the same bits.
        corners[to] = (words[from] ?? 0) + 0;
        corners[to + 1] = (words[from + 1] ?? 0) + 0;
        corners[to + 2] = (words[from + 2] ?? 0) + 0;
        to += 3;
      }
    }
    this.#face();
    this.#bundle();
  }

  #reserve(count: number): void {
    if (count <= this.bundles.length) {
      return;
    }
    const most = 3 * Math.ceil(count / 2);
    this.bundles = new Int32Array(most);
    this.areRound = new Uint8Array(most);
    this.normals = new Float32Array(3 * most);
    this.haveArea = new Uint8Array(most / 3);
    this.#corners = new Float32Array(3 * most);
    this.#places = new Uint32Array(most);
    this.#facets = new Uint8Array(most);
    this.#facing = new Float64Array(most);
    this.#areas = new Float64Array(most / 3);
    this.#starts = new Uint32Array(most + 1);
    this.#meeting = new Uint32Array(most);
    this.#table = new Int32Array(2 ** Math.ceil(Math.log2(2 * most)));
  }

  /** Finds the normals of triangles. */
  #face(): void {
    const [p, facing, count] = [this.#corners, this.#facing, this.#count];
    let size = 0;
    for (let word = 0; word < 3 * count; word += 1) {
      size = Math.max(size, Math.abs(p[word] ?? 0));
    }
    for (let first = 0; first < count; first += 3) {
      const a = 3 * first;
      const ux = (p[a + 3] ?? 0) - (p[a] ?? 0);
      const uy = (p[a + 4] ?? 0) - (p[a + 1] ?? 0);
      const uz = (p[a + 5] ?? 0) - (p[a + 2] ?? 0);
      const vx = (p[a + 6] ?? 0) - (p[a] ?? 0);
      const vy = (p[a + 7] ?? 0) - (p[a + 1] ?? 0);
      const vz = (p[a + 8] ?? 0) - (p[a + 2] ?? 0);
      const x = uy * vz - uz * vy;
      const y = uz * vx - ux * vz;
      const z = ux * vy - uy * vx;
      const area = Math.sqrt(x * x + y * y + z * z);
      // At most twice the square of the longest side.
      const sides = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz;
      // The normal of a thinner one is noise.
      if (area > Math.sqrt(sides) * size * THINNEST) {
        this.haveArea[first / 3] = 1;
        this.#areas[first / 3] = area;
        facing[first] = x / area;
        facing[first + 1] = y / area;
        facing[first + 2] = z / area;
      }
    }
  }

  /** Bundles the facets around each place. Triangles without area are left out. */
  #bundle(): void {
    const places = this.#weld();
    const [starts, meeting, numbers, haveArea] = [this.#starts, this.#meeting, this.#places, this.haveArea];
    starts.fill(0, 0, places + 1);
    for (let corner = 0; corner < this.#count; corner += 1) {
      const place = numbers[corner] ?? 0;
      starts[place] = (starts[place] ?? 0) + (haveArea[(corner / 3) | 0] ?? 0);
    }
    // The end of each place's corners: filling from behind moves it to the start.
    let end = 0;
    for (let place = 0; place <= places; place += 1) {
      end += starts[place] ?? 0;
      starts[place] = end;
    }
    for (let corner = this.#count - 1; corner >= 0; corner -= 1) {
      if (haveArea[(corner / 3) | 0] === 1) {
        const place = numbers[corner] ?? 0;
        const slot = (starts[place] ?? 0) - 1;
        starts[place] = slot;
        meeting[slot] = corner;
      }
    }
    for (let place = 0; place < places; place += 1) {
      this.#around(meeting, starts[place] ?? 0, starts[place + 1] ?? 0);
    }
  }

  /** Gives corners at equal positions one number, and returns how many numbers there are. */
  #weld(): number {
    const bits = new Int32Array(this.#corners.buffer);
    const [firsts, places] = [this.#starts, this.#places];
    // Open addressing, in as much of the table as the corners take.
    const mask = 2 ** Math.ceil(Math.log2(Math.max(2, 2 * this.#count))) - 1;
    const table = this.#table.fill(NONE, 0, mask + 1);
    let count = 0;
    for (let corner = 0; corner < this.#count; corner += 1) {
      const x = bits[3 * corner] ?? 0;
      const y = bits[3 * corner + 1] ?? 0;
      const z = bits[3 * corner + 2] ?? 0;
      let hash = Math.imul(Math.imul(Math.imul(x, 0x9e3779b1) ^ y, 0x85ebca6b) ^ z, 0xc2b2ae35);
      hash = (hash ^ (hash >>> 15)) & mask;
      let place = table[hash] ?? NONE;
      while (place !== NONE && !isAt(bits, firsts[place] ?? 0, x, y, z)) {
        hash = (hash + 1) & mask;
        place = table[hash] ?? NONE;
      }
      if (place === NONE) {
        place = count;
        table[hash] = place;
        firsts[place] = corner;
        count += 1;
      }
      places[corner] = place;
    }
    return count;
  }

  /** Bundles the facets around one place: those of `corners` from `start` to before `end`. */
  #around(corners: Uint32Array, start: number, end: number): void {
    let count = 0;
    for (let at = start; at < end; at += 1) {
      const corner = corners[at] ?? 0;
      let facet = 0;
      while (facet < count && this.#alike(FIRSTS[facet] ?? 0, corner) <= LEVEL) {
        facet += 1;
      }
      if (facet === MOST_FACETS) {
        return;
      }
      if (facet === count) {
        FIRSTS[facet] = corner;
        count += 1;
      }
      this.#facets[corner] = facet;
    }
    if (count === 1) {
      this.#add(corners, start, end, 1, this.#facing, FIRSTS[0] ?? 0);
      return;
    }
    let done = 0;
    for (let facet = 0; facet < count; facet += 1) {
      if ((done & (1 << facet)) === 0) {
        const bundle = this.#reached(facet, count);
        done |= bundle;
        this.#split(corners, start, end, bundle, count);
      }
    }
  }

  /** The facets that are reached from one without a crease, a bit for each. */
  #reached(facet: number, count: number): number {
    let [bundle, before] = [1 << facet, 0];
    while (bundle !== before) {
      before = bundle;
      for (let one = 0; one < count; one += 1) {
        for (let other = 0; other < count && (bundle & (1 << one)) !== 0; other += 1) {
          bundle |= this.#alike(FIRSTS[one] ?? 0, FIRSTS[other] ?? 0) > BEND ? 1 << other : 0;
        }
      }
    }
    return bundle;
  }

  /** Gives facets one normal, or each its own. */
  #split(corners: Uint32Array, start: number, end: number, bundle: number, count: number): void {
    this.#mean(corners, start, end, bundle);
    let isOne = true;
    for (let facet = 0; facet < count; facet += 1) {
      isOne &&= (bundle & (1 << facet)) === 0 || this.#off(FIRSTS[facet] ?? 0) > BEND;
    }
    if (isOne) {
      this.#add(corners, start, end, bundle, MEAN, 0);
      return;
    }
    // The tip of a cone.
    for (let facet = 0; facet < count; facet += 1) {
      if ((bundle & (1 << facet)) !== 0) {
        let near = 0;
        for (let other = 0; other < count; other += 1) {
          near |= this.#alike(FIRSTS[facet] ?? 0, FIRSTS[other] ?? 0) > BEND ? 1 << other : 0;
        }
        this.#mean(corners, start, end, near);
        this.#add(corners, start, end, 1 << facet, MEAN, 0, near);
      }
    }
  }

  /** Adds a bundle with the normal that begins there in a list. It is round if several facets made that. */
  #add(
    corners: Uint32Array,
    start: number,
    end: number,
    bundle: number,
    normals: Float64Array,
    from: number,
    makers = bundle,
  ): void {
    const number = this.#bundled;
    this.#bundled += 1;
    const first = normals === MEAN ? from : from - (from % 3);
    for (let axis = 0; axis < 3; axis += 1) {
      this.normals[3 * number + axis] = normals[first + axis] ?? 0;
    }
    if ((makers & (makers - 1)) !== 0) {
      this.areRound[number] = 1;
      this.isRound = true;
    }
    for (let at = start; at < end; at += 1) {
      const corner = corners[at] ?? 0;
      if ((bundle & (1 << (this.#facets[corner] ?? 0))) !== 0) {
        this.bundles[corner] = number;
      }
    }
  }

  /** The mean normal of facets, by angle, and by area: so a wide face beside a fillet stays flat. */
  #mean(corners: Uint32Array, start: number, end: number, bundle: number): void {
    let [x, y, z] = [0, 0, 0];
    for (let at = start; at < end; at += 1) {
      const corner = corners[at] ?? 0;
      if ((bundle & (1 << (this.#facets[corner] ?? 0))) !== 0) {
        const first = corner - (corner % 3);
        const weight = (this.#areas[first / 3] ?? 0) * this.#angle(corner);
        x += weight * (this.#facing[first] ?? 0);
        y += weight * (this.#facing[first + 1] ?? 0);
        z += weight * (this.#facing[first + 2] ?? 0);
      }
    }
    const length = Math.sqrt(x * x + y * y + z * z);
    [MEAN[0], MEAN[1], MEAN[2]] = length > 0 ? [x / length, y / length, z / length] : [0, 0, 1];
  }

  /** The angle of a triangle at a corner. */
  #angle(corner: number): number {
    const p = this.#corners;
    const first = corner - (corner % 3);
    const [here, next, last] = [
      3 * corner,
      3 * (first + ((corner + 1) % 3)),
      3 * (first + ((corner + 2) % 3)),
    ];
    let dot = 0;
    for (let axis = 0; axis < 3; axis += 1) {
      const from = p[here + axis] ?? 0;
      dot += ((p[next + axis] ?? 0) - from) * ((p[last + axis] ?? 0) - from);
    }
    return Math.atan2(this.#areas[first / 3] ?? 0, dot);
  }

  /** The cosine of the angle between the triangles of two corners. */
  #alike(corner: number, other: number): number {
    const facing = this.#facing;
    const [a, b] = [corner - (corner % 3), other - (other % 3)];
    return (
      (facing[a] ?? 0) * (facing[b] ?? 0) +
      (facing[a + 1] ?? 0) * (facing[b + 1] ?? 0) +
      (facing[a + 2] ?? 0) * (facing[b + 2] ?? 0)
    );
  }

  /** The cosine of the angle between the mean and the triangle of a corner. */
  #off(corner: number): number {
    const facing = this.#facing;
    const a = corner - (corner % 3);
    return (
      (MEAN[0] ?? 0) * (facing[a] ?? 0) +
      (MEAN[1] ?? 0) * (facing[a + 1] ?? 0) +
      (MEAN[2] ?? 0) * (facing[a + 2] ?? 0)
    );
  }
}

/** The first corner of each facet at a place, and a mean normal: reused, as places are many. */
const FIRSTS = new Uint32Array(MOST_FACETS);
const MEAN = new Float64Array(3);

/** Whether a corner has these coordinates, bit by bit. */
function isAt(bits: Int32Array, corner: number, x: number, y: number, z: number): boolean {
  return bits[3 * corner] === x && bits[3 * corner + 1] === y && bits[3 * corner + 2] === z;
}
