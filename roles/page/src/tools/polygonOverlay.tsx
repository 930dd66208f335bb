/** Measured polygons over the picture, and the one whose corners are being picked. */

import type { Snapped } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { unit } from "./lengths.ts";
import type { Measuring } from "./measuring.ts";
import { around, polygonTexts } from "./polygons.ts";
import { Segment } from "./segment.tsx";
import { useProjection } from "./useProjection.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly measuring: Measuring;
}

export function PolygonOverlay({ viewer, measuring }: Properties) {
  const projection = useProjection(viewer);
  const corners = measuring.corners.value;
  const [first] = corners;
  const start = first && projection.place(first.point);
  const edgesOf = (edges: readonly (readonly [Snapped, Snapped])[]) =>
    edges.map(([from, to], index) => (
      <Segment key={index} projection={projection} from={from.point} to={to.point} />
    ));
  return (
    <svg class="overlay polygons" aria-hidden="true">
      {measuring.findings.value.map((finding, index) => {
        if (finding.kind !== "polygon") {
          return null;
        }
        const places = finding.corners.flatMap(({ point }) => projection.place(point) ?? []);
        const middle = (of: (place: (typeof places)[number]) => number) =>
          places.reduce((sum, place) => sum + of(place), 0) / places.length;
        const [text] = polygonTexts(finding.corners, unit.value);
        return (
          <g key={index}>
            {edgesOf(around(finding.corners))}
            {places.length > 0 && (
              <text x={middle(({ x }) => x)} y={middle(({ y }) => y)}>
                {text}
              </text>
            )}
          </g>
        );
      })}
      {edgesOf(around(corners).slice(0, -1))}
      {start && <circle class="ring" cx={start.x} cy={start.y} r={6} />}
    </svg>
  );
}
