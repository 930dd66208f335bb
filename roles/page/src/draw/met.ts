/** The covered pixels around a place of the picture. */

import { NOTHING } from "./device.ts";

/** A covered pixel, counted from the upper left, and its distance along the view in metres. */
export interface Met {
  readonly x: number;
  readonly y: number;
  readonly depth: number;
}

/** The covered pixels of a square within `radius` of its middle, which is at this column and row. */
export function metIn(
  square: readonly { readonly item: number; readonly depth: number }[],
  column: number,
  row: number,
  radius: number,
): readonly Met[] {
  const side = 2 * radius + 1;
  return square.flatMap(({ item, depth }, pixel) => {
    // Rows come from below.
    const [right, up] = [(pixel % side) - radius, Math.floor(pixel / side) - radius];
    const isMet = item !== NOTHING && Math.hypot(right, up) <= radius;
    return isMet ? [{ x: column + right + 0.5, y: row - up + 0.5, depth }] : [];
  });
}

/** The pixel with the least measure; the first one of several. */
export function leastOf(all: readonly Met[], measure: (met: Met) => number): Met | undefined {
  let least: { readonly met: Met; readonly value: number } | undefined;
  for (const met of all) {
    const value = measure(met);
    least = least !== undefined && least.value <= value ? least : { met, value };
  }
  return least?.met;
}
