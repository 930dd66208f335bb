/** A rectangle of a picture that is drawn by itself: pictures may be larger than a canvas can be. */

import type { Size } from "../space/size.ts";
import { OCCLUSION_REACH } from "./shaders.ts";

export interface Region extends Size {
  /** The whole picture. */
  readonly of: Size;
  /** Its lower left corner in the whole picture, pixels. It may lie outside. */
  readonly left: number;
  readonly bottom: number;
}

/** All of a picture. */
export function whole({ width, height }: Size): Region {
  return { of: { width, height }, left: 0, bottom: 0, width, height };
}

/**
 * Scale and shift that take the coordinates of the whole picture to those of the region, each from -1 to 1.
 * Everything is moved by `right` and `up` pixels first.
 */
export function fitting(
  { of, left, bottom, width, height }: Region,
  [right, up]: readonly [number, number],
): { readonly scale: readonly [number, number]; readonly shift: readonly [number, number] } {
  return {
    scale: [of.width / width, of.height / height],
    shift: [(of.width + 2 * (right - left)) / width - 1, (of.height + 2 * (up - bottom)) / height - 1],
  };
}

/** How far the middle of the region is from that of the whole picture: to the right and up, pixels. */
export function offsetOf({ of, left, bottom, width, height }: Region): readonly [number, number] {
  return [left + (width - of.width) / 2, bottom + (height - of.height) / 2];
}

/** After this many pixels hatching repeats. */
const HATCH = 9;
/** The most pixels of a side of a tile. */
const SIDE = 112 * HATCH;
/** Lines look at so many pixels around, and rounding takes one more. */
const LINES = 3;

/** A part of a picture, and the larger region that is drawn for it. */
export interface Tile extends Omit<Region, "of"> {
  readonly drawn: Region;
}

/** The tiles that a picture is drawn in. Their side is a multiple of 9 pixels, so that hatching goes on. */
export function tilesOf(of: Size, side = SIDE): readonly Tile[] {
  const tiles: Tile[] = [];
  for (let bottom = 0; bottom < of.height; bottom += side) {
    for (let left = 0; left < of.width; left += side) {
      const width = Math.min(side, of.width - left);
      const height = Math.min(side, of.height - bottom);
      tiles.push({ left, bottom, width, height, drawn: around({ of, left, bottom, width, height }) });
    }
  }
  return tiles;
}

/** The region with all pixels on which those of a tile depend. */
function around({ of, ...tile }: Region): Region {
  const apron = HATCH * Math.ceil((OCCLUSION_REACH * of.height + LINES) / HATCH);
  const [left, bottom] = [Math.max(0, tile.left - apron), Math.max(0, tile.bottom - apron)];
  const width = Math.min(of.width, tile.left + tile.width + apron) - left;
  const height = Math.min(of.height, tile.bottom + tile.height + apron) - bottom;
  return { of, left, bottom, width, height };
}

/**
 * The pixels of a tile out of those drawn for it, with rows from below. Both have red, green, blue and alpha.
 * Rows of the result are from above.
 */
export function cutOut(
  { left, bottom, width, height, drawn }: Tile,
  pixels: Uint8Array,
): Uint8ClampedArray<ArrayBuffer> {
  const cut = new Uint8ClampedArray(4 * width * height);
  const from = left - drawn.left;
  for (let row = 0; row < height; row += 1) {
    const start = 4 * ((bottom - drawn.bottom + height - 1 - row) * drawn.width + from);
    cut.set(pixels.subarray(start, start + 4 * width), 4 * row * width);
  }
  return cut;
}
