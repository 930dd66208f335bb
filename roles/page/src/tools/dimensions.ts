/** Measured distances as they lie in a picture. */

import type { Place, Projection } from "../draw/projection.ts";
import type { Size } from "../space/size.ts";
import type { Distance } from "../viewer/viewHistory.ts";
import { measuredText, type Unit } from "./lengths.ts";
import { measured } from "./snap.ts";

/** A place in a picture: pixels from its upper left. */
export type Spot = Pick<Place, "x" | "y">;

/** An end of a line; one that is cut off is not at the measured point. */
export interface DimensionEnd extends Spot {
  readonly isCut: boolean;
}

/** The part of a distance that lies within a picture. */
export interface Dimension {
  readonly from: DimensionEnd;
  readonly to: DimensionEnd;
  /** Whether both measured points are in front of the eye. */
  readonly isInFront: boolean;
  readonly label: string;
}

/** How a distance lies in a picture; nothing if it lies outside. */
export function dimensionOf(one: Distance, projection: Projection, unit: Unit): Dimension | undefined {
  const [from, to] = [one.from.point, one.to.point];
  const line = projection.line(from, to);
  const shares = line && sharesWithin(line, projection.size);
  if (line === undefined || shares === undefined) {
    return undefined;
  }
  const [a, b] = line;
  const areBehind = [from, to].map((end) => projection.place(end) === undefined);
  const at = (share: number, isCut = false): DimensionEnd => {
    return { x: a.x + share * (b.x - a.x), y: a.y + share * (b.y - a.y), isCut };
  };
  const { metres, error } = measured(one);
  return {
    from: at(shares[0], areBehind[0] || shares[0] > 0),
    to: at(shares[1], areBehind[1] || shares[1] < 1),
    isInFront: !areBehind.includes(true),
    label: measuredText(metres, error, unit),
  };
}

/** Where a line enters and leaves a picture, as shares of the line; nothing if it misses it. */
function sharesWithin(
  [a, b]: readonly [Spot, Spot],
  { width, height }: Size,
): readonly [number, number] | undefined {
  let [first, last] = [0, 1];
  for (const [from, to, most] of [
    [a.x, b.x, width],
    [a.y, b.y, height],
  ] as const) {
    const way = to - from;
    if (way === 0) {
      if (from < 0 || from > most) {
        return undefined;
      }
      continue;
    }
    const [one, other] = [-from / way, (most - from) / way];
    [first, last] = [Math.max(first, Math.min(one, other)), Math.min(last, Math.max(one, other))];
  }
  return first <= last ? [first, last] : undefined;
}
