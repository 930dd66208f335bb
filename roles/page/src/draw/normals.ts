/** Normals of round surfaces, out of flat triangles. Only light has them. */

import { WORDS_EACH } from "./page.ts";
import { type Flat, NONE, Surface } from "./surface.ts";

/** The normals of one piece. */
export interface Soft {
  /**
   * For each vertex and then for each copy: a folded normal, two numbers of 16 bits. Bit 0 says whether the
   * triangles that have their colour from it are round. All 0 if none is.
   */
  readonly codes: Uint32Array;
  /** The vertices that are copied, since surfaces with different normals meet there. */
  readonly copies: Uint32Array;
  /** The indices; those from the number of vertices on are of copies. */
  readonly indices: Uint32Array;
}

/** Makes the normals of pieces that share a local frame. `carrier` is the corner with the colour: 0 or 2. */
export function soften(pieces: readonly Flat[], carrier: number, surface = new Surface()): Soft[] {
  surface.load(pieces);
  let corner = 0;
  return pieces.map((piece) => {
    const soft = assigned(piece, carrier, surface, corner);
    corner += piece.indices.length;
    return soft;
  });
}

/** Gives each vertex of a piece a normal, and copies those that need several. Its corners begin at `base`. */
function assigned({ words, indices }: Flat, carrier: number, surface: Surface, base: number): Soft {
  const { bundles, areRound, haveArea } = surface;
  const count = words.length / WORDS_EACH;
  if (!surface.isRound) {
    return { codes: new Uint32Array(count), copies: new Uint32Array(0), indices };
  }
  /** For each vertex whether triangles that begin there are to be round: `ROUND`, `REFUSED`, or both. */
  const wishes = new Uint8Array(count);
  for (let first = 0; first < indices.length; first += 3) {
    if (haveArea[(base + first) / 3] === 1) {
      let wish = 0;
      for (let corner = base + first; corner < base + first + 3; corner += 1) {
        const bundle = bundles[corner] ?? NONE;
        wish |= bundle === NONE ? REFUSED : areRound[bundle] === 1 ? ROUND : 0;
      }
      const vertex = indices[first + carrier] ?? 0;
      wishes[vertex] = (wishes[vertex] ?? 0) | wish;
    }
  }
  /** For each vertex and then for each copy: its bundle, and the next copy of the same vertex. */
  const held = new Int32Array(count + indices.length).fill(NONE);
  const nexts = new Int32Array(count + indices.length).fill(NONE);
  const copies: number[] = [];
  const after = indices.slice();
  for (let corner = 0; corner < indices.length; corner += 1) {
    const triangle = corner - (corner % 3);
    if (wishes[indices[triangle + carrier] ?? 0] !== ROUND || haveArea[(base + triangle) / 3] === 0) {
      continue;
    }
    const bundle = bundles[base + corner] ?? NONE;
    let vertex = indices[corner] ?? 0;
    while (held[vertex] !== NONE && held[vertex] !== bundle) {
      let next = nexts[vertex] ?? NONE;
      if (next === NONE) {
        next = count + copies.length;
        nexts[vertex] = next;
        copies.push(indices[corner] ?? 0);
      }
      vertex = next;
    }
    held[vertex] = bundle;
    after[corner] = vertex;
  }
  const codes = new Uint32Array(count + copies.length);
  for (let vertex = 0; vertex < codes.length; vertex += 1) {
    const original = vertex < count ? vertex : (copies[vertex - count] ?? 0);
    const bundle = held[vertex] ?? NONE;
    const code = bundle === NONE ? 0 : folded(surface.normals, 3 * bundle) & ~1;
    codes[vertex] = code | (wishes[original] === ROUND ? 1 : 0);
  }
  return { codes, copies: Uint32Array.from(copies), indices: after };
}

const ROUND = 1;
const REFUSED = 2;

/** The folded normal that begins there in a list: see `Normal` of the scene. */
function folded(list: Float32Array, start: number): number {
  const [x, y, z] = [list[start] ?? 0, list[start + 1] ?? 0, list[start + 2] ?? 0];
  const sum = Math.abs(x) + Math.abs(y) + Math.abs(z);
  const [u, v] = [x / sum, y / sum];
  const isUnder = z < 0;
  const across = isUnder ? (1 - Math.abs(v)) * (u < 0 ? -1 : 1) : u;
  const along = isUnder ? (1 - Math.abs(u)) * (v < 0 ? -1 : 1) : v;
  return (Math.round(32767 * across) & 0xffff) | (Math.round(32767 * along) << 16);
}
