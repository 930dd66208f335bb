/** A list of the distances. */

import { metres } from "../objects/detailsPanel.tsx";
import type { Viewer } from "../viewer/viewer.ts";
import type { Measuring } from "./measuring.ts";
import { distance } from "./snap.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly measuring: Measuring;
}

export function MeasurePanel({ viewer, measuring }: Properties) {
  return (
    <section class="panel sections" aria-label="Distances">
      <p>Click two points. The marker shows what is met: a vertex, an edge or a face.</p>
      <ol>
        {viewer.distances.value.map((one, index) => {
          const along = ([0, 1, 2] as const).map((axis) => metres(Math.abs(one.to[axis] - one.from[axis])));
          return (
            <li key={index}>
              {metres(distance(one.from, one.to))} (x {along[0]}, height {along[1]}, z {along[2]})
              <button
                type="button"
                aria-label={`Remove distance ${index + 1}`}
                onClick={() => measuring.remove(one)}
              >
                ×
              </button>
            </li>
          );
        })}
      </ol>
    </section>
  );
}
