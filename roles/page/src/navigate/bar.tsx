/** Controls of navigation: the mode, the speed, the field of view, and help on keys. */

import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { type Row, Rows } from "../controls/rows.tsx";
import type { Mode, Navigator } from "./navigator.ts";

const MODES: readonly (readonly [Mode, string, string])[] = [
  ["walk", "Walk", "1"],
  ["fly", "Fly", "2"],
  ["orbit", "Orbit", "3"],
];

/** The effects of keys, mouse and fingers. */
const HELP: readonly Row[] = [
  ["W A S D, arrows", "walk, and turn"],
  ["mouse or finger, dragged", "look around; in Orbit, turn the model"],
  ["right button, two fingers", "move across; where you walk: go"],
  ["Shift", "faster"],
  ["wheel", "nearer or farther; where you walk, and with Shift: speed"],
  ["Space", "jump; fly up"],
  ["E, Q", "fly up and down"],
  ["PageUp, PageDown", "look up and down"],
  ["1, 2, 3", "walk, fly, orbit"],
  ["+, −", "field of view; in parallel, nearer or farther"],
  ["R", "parallel lines, for elevations at one scale; and back"],
  ["click", "pick an object; with Ctrl or Shift one more"],
  ["Alt+click, U", "pick the group around it, and again the next larger one"],
  ["K", "the level of clicks: primitive, part, equipment, system"],
  ["F, H, I, X", "go there, hide, isolate, see-through"],
  ["G", "all the rest as ghosts; again, and all is solid"],
  ["L", "show it in the tree"],
  ["Shift+H", "show all, and cut nothing"],
  ["Ctrl+Z, Ctrl+Y", "undo, redo"],
  ["Ctrl+P", "print the picture"],
  ["/", "search, and all of a kind"],
  ["?", "these keys; again, and they close"],
  ["T, B, M, Y, V, P", "the model as a tree, sections, distances, colours, views, status"],
  ["J", "where you are, and go to coordinates"],
  ["N", "notes"],
  ["O", "clashes"],
  ["Home, Shift+F", "see the whole model, from a corner or from this side"],
  ["4 to 9, 0", "front, back, left, right, top, bottom; from a corner"],
  ["Alt+←, Alt+→", "back to the place before a jump, and forward"],
  ["no key", "edges of objects come once the picture rests"],
  ["Escape", "back to the picture; take back a point; pick nothing"],
  ["Tab; arrows and Space", "the next control; use it"],
];

export function NavigationBar({
  navigator,
  children,
}: {
  readonly navigator: Navigator;
  /** Other controls of this bar. */
  readonly children: ComponentChildren;
}) {
  const help = useRef<HTMLDialogElement>(null);
  const isFlat = navigator.projection.value === "parallel";
  const showHelp = () => {
    // The dialog gets key events from now on, including their release.
    navigator.release();
    const dialog = help.current;
    dialog?.showModal();
    // Its button has the focus, below the list.
    dialog?.scrollTo(0, 0);
  };
  return (
    <fieldset class="panel bar navigation" aria-label="Moving">
      {MODES.map(([mode, label, key]) => (
        <Button
          text={label}
          key={mode}
          title={`${label} (${key})`}
          aria-pressed={navigator.mode.value === mode}
          onClick={() => navigator.setMode(mode)}
        />
      ))}
      <span>{isFlat ? "parallel" : `${Number(navigator.speed.value.toPrecision(2))} m/s`}</span>
      <label>
        View{" "}
        <input
          type="range"
          min={20}
          max={100}
          value={navigator.vfov.value}
          disabled={isFlat}
          aria-label="Vertical field of view in degrees"
          onInput={(event) => navigator.setVfov(event.currentTarget.valueAsNumber)}
        />
      </label>
      {children}
      <Button text="?" id="open-keys" aria-label="Keys" title="Keys (?)" onClick={showHelp} />
      <dialog
        ref={help}
        class="keys"
        aria-label="Keys"
        onKeyDown={(event) => {
          if (event.key === "?" && !event.repeat) {
            // The page's own keys would open it again.
            event.stopPropagation();
            help.current?.close();
          }
        }}
      >
        <Rows rows={HELP} />
        <form method="dialog">
          <button type="submit">Close</button>
        </form>
      </dialog>
    </fieldset>
  );
}
