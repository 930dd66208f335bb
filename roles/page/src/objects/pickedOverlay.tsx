/** Boxes around picked parts that are drawn as one with others: those have no colour of their own. */

import type { Drawable } from "../draw/model.ts";
import type { PartDetails } from "../service/service.ts";
import { edgesOf } from "../space/box.ts";
import { Segment } from "../tools/segment.tsx";
import { useProjection } from "../tools/useProjection.ts";
import type { Viewer } from "../viewer/viewer.ts";
import type { Selection } from "./selection.ts";

/** The most parts with a box. */
const MOST = 20;

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function PickedOverlay({ viewer, selection }: Properties) {
  const projection = useProjection(viewer);
  const drawn = viewer.shown();
  const parts = selection.parts.value.slice(0, MOST).filter((part) => isAmong(drawn, part));
  return (
    <svg class="overlay picked" aria-hidden="true">
      {parts.flatMap(({ core }, part) =>
        edgesOf(core).map(([from, to], edge) => (
          <Segment key={`${part} ${edge}`} projection={projection} from={from} to={to} />
        )),
      )}
    </svg>
  );
}

/**
 * Whether a part may be drawn as one with others, and not by itself. A drawable of several objects names one
 * of them alone.
 */
function isAmong(
  drawn: readonly Pick<Drawable, "object" | "objects">[],
  { first, end }: Pick<PartDetails, "first" | "end">,
): boolean {
  const isItself = drawn.some(({ object, objects }) => objects === 1 && object >= first && object < end);
  return !isItself && drawn.some(({ objects }) => objects > 1);
}
