/** Handles over the picture for dragging sections. */

import { edgesOf } from "../space/box.ts";
import { beyond } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type Handle, handlesOf, metresOf } from "./handles.ts";
import { replaced } from "./sections.ts";
import { Segment } from "./segment.tsx";
import { useProjection } from "./useProjection.ts";

/** Length of a handle's direction line, pixels. */
const REACH = 28;

export function SectionsOverlay({ viewer }: { readonly viewer: Viewer }) {
  const projection = useProjection(viewer);
  const { sections } = viewer.view.current.value;
  return (
    <svg class="overlay" aria-hidden="true">
      {sections.map((section, index) => {
        const edges = section.kind === "box" ? edgesOf({ min: section.lower, max: section.upper }) : [];
        return edges.map(([from, to], edge) => (
          <Segment key={`${index} ${edge}`} projection={projection} from={from} to={to} />
        ));
      })}
      {sections.flatMap((section, index) =>
        handlesOf(section).map((handle) => {
          const place = projection.place(handle.point);
          if (place === undefined) {
            return null;
          }
          const { point, axis } = handle;
          const reach = REACH * projection.metresEach(place.depth);
          const [from, to] = [beyond(point, axis, -reach), beyond(point, axis, reach)];
          return (
            <g key={`${index} ${handle.name}`}>
              <Segment projection={projection} from={from} to={to} />
              <circle
                class="handle"
                cx={place.x}
                cy={place.y}
                r={8}
                onPointerDown={(event) => begin(event, viewer, index, handle)}
              />
            </g>
          );
        }),
      )}
    </svg>
  );
}

/** Drags a handle until the pointer is released, as one step of the history. */
function begin(event: PointerEvent, viewer: Viewer, index: number, handle: Handle): void {
  const { currentTarget: circle, clientX, clientY, pointerId } = event;
  if (!(circle instanceof Element)) {
    return;
  }
  event.preventDefault();
  const { view, projection } = viewer;
  const before = view.current.peek().sections;
  const over = new AbortController();
  const move = ({ clientX: x, clientY: y }: PointerEvent) => {
    const section = handle.drag(metresOf(handle, projection, x - clientX, y - clientY));
    view.drag({ sections: replaced(before, index, section) });
  };
  const end = () => {
    over.abort();
    view.change({ sections: view.current.peek().sections });
  };
  // The handle is drawn anew at each step, so the window listens to the pointer.
  const of = (act: (event: PointerEvent) => void) => (event: PointerEvent) => {
    if (event.pointerId === pointerId) {
      act(event);
    }
  };
  addEventListener("pointermove", of(move), { signal: over.signal });
  addEventListener("pointerup", of(end), { signal: over.signal });
  addEventListener("pointercancel", of(end), { signal: over.signal });
}
