/** Handles for dragging sections: their places, and the effect of a drag. */

import type { Projection } from "../draw/projection.ts";
import type { Section } from "../proto/viewState.ts";
import { centreOf } from "../space/box.ts";
import { beyond, type Point, pointOf } from "../space/point.ts";
import { moved, resized } from "./sections.ts";

/** An axis seen end-on counts as a point, below this many pixels if a metre would be 100. */
const END_ON = 20;

/** A part of a section that can be dragged along a line. */
export interface Handle {
  readonly name: string;
  readonly point: Point;
  /** The axis of the drag, a unit vector. */
  readonly axis: Point;
  /** The section with the handle moved this many metres along its axis. */
  readonly drag: (metres: number) => Section;
}

const SIDES = ["lower", "upper"] as const;
/** The axes and their names. */
export const AXES = [
  [0, "x"],
  [1, "y"],
  [2, "z"],
] as const;

/** One for a plane, and one for each side of a box. */
export function handlesOf(section: Section): readonly Handle[] {
  if (section.kind === "plane") {
    const { point, direction } = section;
    const length = Math.hypot(...direction);
    const axis = pointOf((axis) => direction[axis] / length);
    return [{ name: "plane", point, axis, drag: (metres) => moved(section, metres) }];
  }
  const { lower, upper } = section;
  const middle = centreOf({ min: lower, max: upper });
  return AXES.flatMap(([axis, name]) =>
    SIDES.map((side): Handle => {
      const point = pointOf((other) => (other === axis ? section[side] : middle)[other]);
      const along = pointOf((other) => (other === axis ? 1 : 0));
      const drag = (metres: number) => resized(section, side, axis, section[side][axis] + metres);
      return { name: `${side} ${name}`, point, axis: along, drag };
    }),
  );
}

/**
 * The distance in metres along the axis of a handle for a drag in CSS pixels. On an axis seen end-on, up is
 * away from the eye.
 */
export function metresOf(
  { point, axis }: Handle,
  projection: Projection,
  right: number,
  down: number,
): number {
  const place = projection.place(point);
  if (place === undefined) {
    return 0;
  }
  const pixel = projection.metresEach(place.depth);
  const reach = 100 * pixel;
  // Points behind the eye have no projection: there the axis is taken the other way.
  const ends = [1, -1].flatMap((sign) => {
    const end = projection.place(beyond(point, axis, sign * reach));
    return end === undefined ? [] : { end, sign };
  });
  const [first] = ends;
  if (first === undefined) {
    return 0;
  }
  const { end, sign } = first;
  const [x, y] = [sign * (end.x - place.x), sign * (end.y - place.y)];
  const length = x * x + y * y;
  if (length < END_ON * END_ON) {
    return -Math.sign(sign * (end.depth - place.depth)) * down * pixel;
  }
  return (reach * (right * x + down * y)) / length;
}
