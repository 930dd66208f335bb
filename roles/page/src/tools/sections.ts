/** Section planes and boxes, as changes of a view. */

import type { Section } from "../proto/viewState.ts";
import { type Box, sizeOf } from "../space/box.ts";
import { type Axis, beyond, dot, minus, type Point, pointOf } from "../space/point.ts";

/** The most sections that a view has. */
export const MOST = 6;
/** A point this near to a section counts as on it, metres. */
const ROUNDING = 1e-6;

/** A plane through a point that cuts away everything before it, along the main axis of the view. */
export function planeFacing(point: Point, forward: Point): Section {
  const sizes = forward.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const direction = pointOf((other) => (other === axis ? -Math.sign(forward[other]) : 0));
  return { kind: "plane", point, direction };
}

/** A slightly larger box. */
export function boxAround(box: Box): Section {
  const room = 0.02 * Math.hypot(...sizeOf(box)) + 1e-6;
  const [lower, upper] = [pointOf((axis) => box.min[axis] - room), pointOf((axis) => box.max[axis] + room)];
  return { kind: "box", lower, upper };
}

/** The same plane, cutting away the other side. */
export function flipped(section: Section): Section {
  if (section.kind === "box") {
    return section;
  }
  return { ...section, direction: minus([0, 0, 0], section.direction) };
}

/** The section moved this far: a plane towards its removed side. */
export function moved(section: Section, metres: number): Section {
  if (section.kind === "box") {
    return section;
  }
  const { point, direction } = section;
  return { ...section, point: beyond(point, direction, metres / Math.hypot(...direction)) };
}

/** The box with one of its six sides moved. It never turns inside out. */
export function resized(section: Section, side: "lower" | "upper", axis: Axis, at: number): Section {
  if (section.kind === "plane" || !Number.isFinite(at)) {
    return section;
  }
  const isSound = side === "lower" ? at < section.upper[axis] : at > section.lower[axis];
  const corner = pointOf((other) => (other === axis ? at : section[side][other]));
  return isSound ? { ...section, [side]: corner } : section;
}

/** Whether sections cut a point away, by more than rounding. */
export function isCutAway(sections: readonly Section[], point: Point): boolean {
  return sections.some((section) => {
    if (section.kind === "box") {
      const { lower, upper } = section;
      return point.some(
        (at, axis) => at < (lower[axis] ?? at) - ROUNDING || at > (upper[axis] ?? at) + ROUNDING,
      );
    }
    const { direction } = section;
    return dot(direction, minus(point, section.point)) > ROUNDING * Math.hypot(...direction);
  });
}

/** The list with one section replaced; without a replacement it is removed. */
export function replaced(
  sections: readonly Section[],
  index: number,
  section: Section | undefined,
): readonly Section[] {
  return sections.flatMap((old, at) => (at === index ? (section ?? []) : old));
}
