/** Controls of navigation: the mode, the speed, the field of view, and help on keys. */

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { lazy } from "../controls/lazy.tsx";
import type { Mode, Navigator } from "./navigator.ts";

const MODES: readonly (readonly [Mode, string, string])[] = [
  ["walk", "Walk", "1"],
  ["fly", "Fly", "2"],
  ["orbit", "Orbit", "3"],
];

const KeyList = lazy(async () => (await import("./keyList.tsx")).KeyList);

export function NavigationBar({
  navigator,
  children,
}: {
  readonly navigator: Navigator;
  /** Other controls of this bar. */
  readonly children: ComponentChildren;
}) {
  const help = useRef<HTMLDialogElement>(null);
  const isListed = useSignal(false);
  const isFlat = navigator.projection.value === "parallel";
  const showHelp = () => {
    // The dialog gets key events from now on, including their release.
    navigator.release();
    isListed.value = true;
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
        {isListed.value && <KeyList />}
        <form method="dialog">
          <button type="submit">Close</button>
        </form>
      </dialog>
    </fieldset>
  );
}
