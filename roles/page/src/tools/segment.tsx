/** A line between two points of the world, over the picture. */

import type { Projection } from "../draw/projection.ts";
import type { Point } from "../space/point.ts";

interface Properties {
  readonly projection: Projection;
  readonly from: Point;
  readonly to: Point;
}

/** Nothing if all of it is behind the eye. */
export function Segment({ projection, from, to }: Properties) {
  const line = projection.line(from, to);
  return line && <line x1={line[0].x} y1={line[0].y} x2={line[1].x} y2={line[1].y} />;
}
