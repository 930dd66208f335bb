/** Section planes and boxes, as changes of a view. */

import type { Point, Section } from "../proto/viewState.ts";

/** The most sections that a view has. */
export const MOST = 6;
/** A point this near to a section counts as on it, metres. */
const ROUNDING = 1e-6;

/** A plane through a point that cuts away everything before it, along the main axis of the view. */
export function planeFacing(point: Point, forward: Point): Section {
  const sizes = forward.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const direction = [0, 1, 2].map((other) => (other === axis ? -Math.sign(forward[axis] ?? 1) : 0));
  return { kind: "plane", point, direction: [direction[0] ?? 0, direction[1] ?? 0, direction[2] ?? 0] };
}

/** A box around two corners, slightly larger. */
export function boxAround(min: Point, max: Point): Section {
  const room = 0.02 * Math.hypot(max[0] - min[0], max[1] - min[1], max[2] - min[2]) + 1e-6;
  return {
    kind: "box",
    lower: [min[0] - room, min[1] - room, min[2] - room],
    upper: [max[0] + room, max[1] + room, max[2] + room],
  };
}

/** The same plane, cutting away the other side. */
export function flipped(section: Section): Section {
  if (section.kind === "box") {
    return section;
  }
  const [x, y, z] = section.direction;
  return { ...section, direction: [0 - x, 0 - y, 0 - z] };
}

/** The section moved this far: a plane towards its removed side. */
export function moved(section: Section, metres: number): Section {
  if (section.kind === "box") {
    return section;
  }
  const { point, direction } = section;
  const length = Math.hypot(...direction);
  const at = (axis: 0 | 1 | 2) => point[axis] + (direction[axis] * metres) / length;
  return { ...section, point: [at(0), at(1), at(2)] };
}

/** The box with one of its six sides moved. It never turns inside out. */
export function resized(section: Section, side: "lower" | "upper", axis: 0 | 1 | 2, at: number): Section {
  if (section.kind === "plane" || !Number.isFinite(at)) {
    return section;
  }
  const isSound = side === "lower" ? at < section.upper[axis] : at > section.lower[axis];
  const corner: [number, number, number] = [...section[side]];
  corner[axis] = at;
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
    const length = Math.hypot(...section.direction);
    const beyond = section.direction.map(
      (along, axis) => along * ((point[axis] ?? 0) - (section.point[axis] ?? 0)),
    );
    return beyond.reduce((sum, part) => sum + part, 0) > ROUNDING * length;
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
