/** The standard views: six along the axes, and one from a corner. */

import type { Point } from "../space/point.ts";

export interface StandardView {
  readonly name: string;
  /** Its label on a keyboard. */
  readonly key: string;
  /** The viewing direction. Its length is arbitrary. */
  readonly forward: Point;
}

/** Straight up and down, there is no heading: a trace of -z keeps the front at the bottom of the picture. */
const TRACE = -1e-9;

/** The view from a corner, a little above. */
export const ISO: StandardView = { name: "Iso", key: "0", forward: [-1, -0.8, -1] };

/** The views of the six sides. */
export const SIDES: readonly StandardView[] = [
  { name: "Front", key: "4", forward: [0, 0, -1] },
  { name: "Back", key: "5", forward: [0, 0, 1] },
  { name: "Left", key: "6", forward: [1, 0, 0] },
  { name: "Right", key: "7", forward: [-1, 0, 0] },
  { name: "Top", key: "8", forward: [0, -1, TRACE] },
  { name: "Bottom", key: "9", forward: [0, 1, TRACE] },
];

export const STANDARD_VIEWS: readonly StandardView[] = [...SIDES, ISO];
