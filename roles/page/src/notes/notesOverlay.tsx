/** Markers of the notes in the picture. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Selection } from "../objects/selection.ts";
import { useProjection } from "../tools/useProjection.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { notesOf } from "./notes.ts";

/** The most markers. */
const MOST = 200;
/** How many are looked for behind other things, once the picture rests for so many milliseconds. */
const MOST_LOOKED = 40;
const REST = 250;

export function NotesOverlay({
  viewer,
  selection,
}: {
  readonly viewer: Viewer;
  readonly selection: Selection;
}) {
  const notes = notesOf(viewer, selection);
  const projection = useProjection(viewer);
  const behind = useSignal<ReadonlySet<string>>(new Set());
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    const look = () => {
      const now = viewer.pictured;
      const seen = notes.shown.peek().filter(({ point }) => point !== null && now.shows(point));
      behind.value = new Set(
        seen.slice(0, MOST_LOOKED).flatMap(({ guid, point }) => {
          const place = point && now.place(point);
          const met = place && viewer.pick(place.x, place.y);
          // A place in the middle of its part is behind the part's own surface.
          const reach = viewer.scene.eyeHeight / 2;
          return place && met && met.depth < place.depth - reach ? [guid] : [];
        }),
      );
    };
    const stop = viewer.onPicture(() => {
      clearTimeout(timer);
      timer = setTimeout(look, REST);
    });
    return () => {
      stop();
      clearTimeout(timer);
    };
  }, [viewer, notes.shown.value]);
  const open = notes.open.value?.guid;
  const markers = notes.shown.value.flatMap((note) => {
    const place =
      note.point === null || !projection.shows(note.point) ? undefined : projection.place(note.point);
    return place === undefined ? [] : [{ note, place }];
  });
  return (
    <svg class="overlay" aria-hidden="true">
      {markers.slice(0, MOST).map(({ note, place }) => (
        <g
          key={note.guid}
          class={`marker ${note.status}${behind.value.has(note.guid) ? " behind" : ""}`}
          aria-current={open === note.guid}
          transform={`translate(${place.x} ${place.y})`}
          onPointerUp={() => void notes.goTo(note.guid)}
        >
          <title>{note.title}</title>
          <path d="M0 0L-9 -13A11 11 0 1 1 9 -13Z" />
          <circle cy={-20} r={4} />
        </g>
      ))}
    </svg>
  );
}
