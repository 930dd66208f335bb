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
  ["wheel", "speed; in Orbit, nearer or farther"],
  ["Space", "jump; fly up"],
  ["E, Q", "fly up and down"],
  ["PageUp, PageDown", "look up and down"],
  ["1, 2, 3", "walk, fly, orbit"],
  ["+, −", "field of view"],
  ["click", "pick an object; with Ctrl or Shift one more"],
  ["Alt+click, U", "pick the group around it, and again the next larger one"],
  ["K", "the level of clicks: primitive, part, equipment, system"],
  ["F, H, I, X", "go there, hide, isolate, see-through"],
  ["G", "all the rest as ghosts; again, and all is solid"],
  ["L", "show it in the tree"],
  ["Shift+H", "show all, and cut nothing"],
  ["Ctrl+Z, Ctrl+Y", "undo, redo"],
  ["/", "search"],
  ["T, B, M, V, P", "the model as a tree, sections, distances, views, status"],
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
  const showHelp = () => {
    // The dialog gets key events from now on, including their release.
    navigator.release();
    help.current?.showModal();
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
      <span>{Number(navigator.speed.value.toPrecision(2))} m/s</span>
      <label>
        View{" "}
        <input
          type="range"
          min={20}
          max={100}
          value={navigator.vfov.value}
          aria-label="Vertical field of view in degrees"
          onInput={(event) => navigator.setVfov(event.currentTarget.valueAsNumber)}
        />
      </label>
      {children}
      <Button text="?" aria-label="Keys" onClick={showHelp} />
      <dialog ref={help} aria-label="Keys">
        <Rows rows={HELP} />
        <form method="dialog">
          <button type="submit">Close</button>
        </form>
      </dialog>
    </fieldset>
  );
}
