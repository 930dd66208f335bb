/** Boxes with their sides along the axes. */

import { minus, type Point, pointOf } from "./point.ts";

/** By its lower and upper corner, metres. */
export interface Box {
  readonly min: Point;
  readonly max: Point;
}

/** The middle of a box. */
export function centreOf({ min, max }: Box): Point {
  return pointOf((axis) => (min[axis] + max[axis]) / 2);
}

/** The lengths of its sides. */
export function sizeOf({ min, max }: Box): Point {
  return minus(max, min);
}

/** The eight corners of a box. */
export function cornersOf({ min, max }: Box): readonly Point[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((corner) =>
    pointOf((axis) => ((corner >> axis) & 1 ? max : min)[axis]),
  );
}

/** The ends of the twelve edges of a box. */
export function edgesOf(box: Box): readonly (readonly [Point, Point])[] {
  const corners = cornersOf(box);
  return corners.flatMap((from, corner) =>
    [1, 2, 4].flatMap((axis) => {
      const to = corners[corner | axis];
      return (corner & axis) === 0 && to !== undefined ? [[from, to] as const] : [];
    }),
  );
}

/** Whether both are one box. */
export function isSame(a: Box, b: Box): boolean {
  return a.min.every((least, axis) => least === b.min[axis] && a.max[axis] === b.max[axis]);
}

/** The box around boxes; nothing if there are none. */
export function around(boxes: readonly Box[]): Box | undefined {
  const corner = (of: "min" | "max") => pointOf((axis) => Math[of](...boxes.map((box) => box[of][axis])));
  return boxes.length === 0 ? undefined : { min: corner("min"), max: corner("max") };
}
