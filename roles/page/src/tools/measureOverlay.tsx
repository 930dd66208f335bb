/** Distances over the picture, and the marker of the snapped point at the pointer. */

import type { Place } from "../draw/projection.ts";
import type { Snapped } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { measuredText, unit } from "./lengths.ts";
import type { Measuring } from "./measuring.ts";
import { measured } from "./snap.ts";
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
  return (
    <svg class="overlay" aria-hidden="true">
      {[...kept, ...open].map((one, index) => {
        const line = projection.line(one.from.point, one.to.point);
        const { metres, error } = measured(one);
        const label = measuredText(metres, error, unit.value);
        return line && <Line key={index} from={line[0]} to={line[1]} label={label} />;
      })}
      {[start, hover].map((snapped, index) => (
        <Marker key={index} snapped={snapped} place={snapped && projection.place(snapped.point)} />
      ))}
    </svg>
  );
}

function Line({ from, to, label }: { readonly from: Place; readonly to: Place; readonly label: string }) {
  return (
    <g>
      <line x1={from.x} y1={from.y} x2={to.x} y2={to.y} />
      <circle cx={from.x} cy={from.y} r={3} />
      <circle cx={to.x} cy={to.y} r={3} />
      <text x={(from.x + to.x) / 2} y={(from.y + to.y) / 2 - 6}>
        {label}
      </text>
    </g>
  );
}

/** A square is a vertex, a triangle an edge, a ring a face. */
function Marker({
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
