/** Distances over the picture, the marker of the snapped point, and the keyboard's crosshair. */

import type { Place } from "../draw/projection.ts";
import type { Snapped } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type Dimension, dimensionOf } from "./dimensions.ts";
import { unit } from "./lengths.ts";
import type { Measuring } from "./measuring.ts";
import { useProjection } from "./useProjection.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly measuring: Measuring;
}

export function MeasureOverlay({ viewer, measuring }: Properties) {
  const projection = useProjection(viewer);
  const [start, hover] = [measuring.start.value, measuring.hover.value];
  const kept = viewer.distances.value;
  const open = start && hover ? [{ from: start, to: hover }] : [];
  if (kept.length === 0 && !measuring.isOn.value) {
    return null;
  }
  const { width, height } = projection.size;
  return (
    <svg class="overlay" aria-hidden="true">
      {measuring.takesPoints.value && (
        <path class="crosshair" d={`M${width / 2 - 14} ${height / 2}h28m-14 -14v28`} />
      )}
      {[...kept, ...open].map((one, index) => {
        const dimension = dimensionOf(one, projection, unit.value);
        return dimension && <Line key={index} {...dimension} />;
      })}
      {[start, hover].map((snapped, index) => (
        <Marker key={index} snapped={snapped} place={snapped && projection.place(snapped.point)} />
      ))}
    </svg>
  );
}

function Line({ from, to, label }: Dimension) {
  return (
    <g>
      <line x1={from.x} y1={from.y} x2={to.x} y2={to.y} />
      {[from, to].map(({ x, y, isCut }, index) => !isCut && <circle key={index} cx={x} cy={y} r={3} />)}
      <text x={(from.x + to.x) / 2} y={(from.y + to.y) / 2 - 6}>
        {label}
      </text>
    </g>
  );
}

/** A square is a vertex, a triangle an edge, a ring a face. */
export function Marker({
  snapped,
  place,
}: {
  readonly snapped: Snapped | undefined;
  readonly place: Place | undefined;
}) {
  if (snapped === undefined || place === undefined) {
    return null;
  }
  const { x, y } = place;
  switch (snapped.to) {
    case "vertex":
      return <rect x={x - 6} y={y - 6} width={12} height={12} />;
    case "edge":
      return <path d={`M${x - 7} ${y + 5}L${x + 7} ${y + 5}L${x} ${y - 8}Z`} />;
    case "face":
      return <circle class="ring" cx={x} cy={y} r={6} />;
  }
}
