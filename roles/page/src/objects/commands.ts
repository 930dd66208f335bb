/** The commands of objects, for buttons and keys alike. */

import type { StandardView } from "../navigate/standardViews.ts";
import type { ObjectSet } from "../proto/objectSet.ts";
import type { PartDetails } from "../service/service.ts";
import { around, type Box } from "../space/box.ts";
import type { Measuring } from "../tools/measuring.ts";
import type { NavigationCommand } from "../tools/orientation.tsx";
import { frameShown, seeAll } from "../tools/overview.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { hasGhosts } from "../viewer/viewHistory.ts";
import { type Change, ghostRest, hide, isolate, showAll, toggleSeeThrough } from "./actions.ts";
import { tellIfHidden } from "./reveal.ts";
import type { Selection } from "./selection.ts";

export interface Command {
  readonly label: string;
  /** Its label on a keyboard. */
  readonly key: string;
  readonly run: () => void;
  readonly isPossible: () => boolean;
  /** For a switch: whether it is on. */
  readonly isOn?: () => boolean;
}

/** The commands for picked objects, and for the view. `openTree` shows the tree. */
export function commandsOf(
  viewer: Viewer,
  selection: Selection,
  measuring: Measuring,
  openTree: () => void,
): readonly Command[] {
  const { view, selected } = viewer;
  const { objects: count } = viewer.scene;
  const isGhostly = () => hasGhosts(view.current.value, count, view.modelSeeThrough);
  const hasSelection = () => !selected.value.isEmpty;
  const change = (make: (objects: ObjectSet) => Change) => () => view.change(make(selected.peek()));
  return [
    {
      label: "Go there",
      key: "F",
      run: () => goToAll(viewer, selection),
      isPossible: () => selection.bounds.value !== undefined,
    },
    {
      label: "Parent",
      key: "U",
      run: () => selection.pickParent(),
      isPossible: hasSelection,
    },
    {
      label: "In the tree",
      key: "L",
      run: () => {
        openTree();
        selection.locate();
      },
      isPossible: () => selection.details.value !== undefined,
    },
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
      label: "Ghosts",
      key: "G",
      run: () => {
        const solid = selected.peek();
        const ghosts = ghostRest(solid, count, view.modelSeeThrough);
        const isOff = solid.isEmpty || view.current.peek().seeThrough.equals(ghosts.seeThrough);
        view.change(isOff ? { seeThrough: view.modelSeeThrough } : ghosts);
      },
      isPossible: () => hasSelection() || isGhostly(),
      isOn: isGhostly,
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
      run: () => view.change(showAll(view.current.peek(), view.modelSeeThrough)),
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
function goToAll(viewer: Viewer, selection: Selection): void {
  const parts = selection.parts.peek();
  const box = parts.length === 0 ? selection.bounds.peek() : around(parts.map(({ core }) => core));
  if (box !== undefined && parts.length !== 1) {
    viewer.navigator.frame(box);
  } else {
    goTo(viewer, parts[0]);
  }
}

/** The commands of navigation. */
export function navigationCommandsOf(viewer: Viewer): readonly NavigationCommand[] {
  const { navigator } = viewer;
  const { history } = navigator;
  const isPossible = () => true;
  return [
    {
      label: "Previous place",
      sign: "←",
      key: "Alt+ArrowLeft",
      run: () => navigator.goBack(),
      isPossible: () => history.canGoBack.value,
    },
    {
      label: "Next place",
      sign: "→",
      key: "Alt+ArrowRight",
      run: () => navigator.goBack(1),
      isPossible: () => history.canGoForward.value,
    },
    { label: "Whole model", sign: "⌂", key: "Home", run: () => void seeAll(viewer), isPossible },
    {
      label: "Fit all",
      sign: "⤢",
      key: "Shift+F",
      run: () => void frameShown(viewer, (box) => navigator.frame(box)),
      isPossible,
    },
  ];
}

/** Looks at what is picked, or else at all that is shown, in a standard view. */
export function lookFrom(viewer: Viewer, selection: Selection, { forward }: StandardView): void {
  const look = (box: Box) => viewer.navigator.frameFrom(box, forward);
  const picked = selection.bounds.peek();
  if (picked !== undefined) {
    look(picked);
  } else {
    void frameShown(viewer, look);
  }
}

/** The key of an event in the notation of commands. */
export function keyOf({ ctrlKey, metaKey, altKey, shiftKey, key, code }: KeyboardEvent): string {
  const modifiers = `${ctrlKey || metaKey ? "Ctrl+" : ""}${altKey ? "Alt+" : ""}${shiftKey ? "Shift+" : ""}`;
  // On some keyboards digits need Shift: the place of the key counts.
  const digit = /^Digit(\d)$/.exec(code)?.[1];
  return `${modifiers}${digit ?? (key.length === 1 ? key.toUpperCase() : key)}`;
}
