/** The clipping planes of sections, in camera space. */

import type { Section } from "../proto/viewState.ts";
import type { Point } from "../space/point.ts";
import type { Camera } from "./model.ts";
import type { View } from "./view.ts";

/** The planes of six boxes. */
export const MOST_PLANES = 36;

/** A clipping plane: a point of it, and the direction that is cut away. World. */
interface Plane {
  readonly point: Point;
  readonly direction: Point;
}

/**
 * Four numbers per plane: a point of camera space is cut away if its dot product with the first three, plus
 * the fourth, is positive. They are computed in doubles relative to the eye, and rounded once.
 */
export function cutPlanes(sections: readonly Section[], view: View, { eye }: Camera): Float32Array {
  const planes = sections.flatMap(planesOf);
  const numbers = new Float32Array(4 * planes.length);
  for (const [index, { point, direction }] of planes.entries()) {
    const length = Math.hypot(...direction);
    const [x, y, z] = [direction[0] / length, direction[1] / length, direction[2] / length];
    for (let axis = 0; axis < 3; axis += 1) {
      numbers[4 * index + axis] = view.along(axis, x, y, z);
    }
    numbers[4 * index + 3] = x * (eye[0] - point[0]) + y * (eye[1] - point[1]) + z * (eye[2] - point[2]);
  }
  return numbers;
}

function planesOf(section: Section): readonly Plane[] {
  if (section.kind === "plane") {
    return [section];
  }
  const { lower, upper } = section;
  return [
    { point: lower, direction: [-1, 0, 0] },
    { point: lower, direction: [0, -1, 0] },
    { point: lower, direction: [0, 0, -1] },
    { point: upper, direction: [1, 0, 0] },
    { point: upper, direction: [0, 1, 0] },
    { point: upper, direction: [0, 0, 1] },
  ];
}
