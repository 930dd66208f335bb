/** Buttons that move the eye up and down while they are held, for people without a keyboard. */

import { Button } from "../controls/button.tsx";
import type { Navigator } from "./navigator.ts";

/** By mode: the label of a button, and the code of the equivalent key. */
const WALKING = [["Jump", "Space"]] as const;
const FLYING = [
  ["Rise", "KeyE"],
  ["Sink", "KeyQ"],
] as const;

export function TouchPad({ navigator }: { readonly navigator: Navigator }) {
  const buttons = navigator.mode.value === "walk" ? WALKING : FLYING;
  return (
    <fieldset class="panel bar touch" aria-label="Up and down">
      {buttons.map(([label, code]) => {
        const press = (isDown: boolean) => () => navigator.press(code, isDown);
        const tap = (event: MouseEvent) => {
          // A click of a keyboard or a screen reader comes without a pointer.
          if (event.detail === 0) {
            navigator.press(code, true);
            navigator.press(code, false);
          }
        };
        return (
          <Button
            text={label}
            key={label}
            onPointerDown={press(true)}
            onPointerUp={press(false)}
            onPointerCancel={press(false)}
            onPointerLeave={press(false)}
            onContextMenu={(event) => event.preventDefault()}
            onClick={tap}
          />
        );
      })}
    </fieldset>
  );
}
