/** The commands of objects, for buttons and keys alike. */

import type { ObjectSet } from "../proto/objectSet.ts";
import type { PartDetails } from "../service/service.ts";
import { around } from "../space/box.ts";
import type { Measuring } from "../tools/measuring.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type Change, hide, isolate, showAll, toggleSeeThrough } from "./actions.ts";
import { tellIfHidden } from "./reveal.ts";
import type { Selection } from "./selection.ts";

export interface Command {
  readonly label: string;
  /** Its label on a keyboard. */
  readonly key: string;
  readonly run: () => void;
  readonly isPossible: () => boolean;
}

/** The commands for picked objects, and for the view. */
export function commandsOf(viewer: Viewer, selection: Selection, measuring: Measuring): readonly Command[] {
  const { view, selected } = viewer;
  const hasSelection = () => !selected.value.isEmpty;
  const change = (make: (objects: ObjectSet) => Change) => () => view.change(make(selected.peek()));
  return [
    {
      label: "Go there",
      key: "F",
      run: () => goToAll(viewer, selection.parts.peek()),
      isPossible: hasSelection,
    },
    { label: "Whole model", key: "Home", run: () => seeAll(viewer), isPossible: () => true },
    {
      label: "Hide",
      key: "H",
      run: () => {
        change((objects) => hide(view.current.peek(), objects))();
        selection.clear();
      },
      isPossible: hasSelection,
    },
    {
      label: "Isolate",
      key: "I",
      run: change((objects) => isolate(view.current.peek(), objects)),
      isPossible: hasSelection,
    },
    {
      label: "See-through",
      key: "X",
      run: change((objects) => toggleSeeThrough(view.current.peek(), objects)),
      isPossible: hasSelection,
    },
    {
      label: "Show all",
      key: "Shift+H",
      run: () => view.change(showAll(view.modelSeeThrough)),
      isPossible: () => true,
    },
    {
      label: "Undo",
      key: "Ctrl+Z",
      run: () => {
        if (!measuring.takeBack()) {
          view.undo();
        }
      },
      isPossible: () => measuring.start.value !== undefined || view.canUndo.value,
    },
    { label: "Redo", key: "Ctrl+Y", run: () => view.redo(), isPossible: () => view.canRedo.value },
  ];
}

/** Moves to a view of a part. */
export function goTo(viewer: Viewer, part: PartDetails | undefined): void {
  if (part !== undefined) {
    viewer.navigator.frame(part.core, part.sides);
    void tellIfHidden(viewer, part);
  }
}

/** Moves to a view of all of these. */
function goToAll(viewer: Viewer, parts: readonly PartDetails[]): void {
  const box = around(parts.map(({ core }) => core));
  if (box !== undefined && parts.length > 1) {
    viewer.navigator.frame(box);
  } else {
    goTo(viewer, parts[0]);
  }
}

/** Moves to a view of the whole model. */
export function seeAll({ navigator, scene }: Viewer): void {
  navigator.frame(scene.core);
}

/** The key of an event in the notation of commands. */
export function keyOf({ ctrlKey, metaKey, shiftKey, key }: KeyboardEvent): string {
  const shift = shiftKey ? "Shift+" : "";
  return `${ctrlKey || metaKey ? "Ctrl+" : ""}${shift}${key.length === 1 ? key.toUpperCase() : key}`;
}
