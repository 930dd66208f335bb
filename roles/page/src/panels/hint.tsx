/** A hint on how to move, at the first start in a browser. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Viewer } from "../viewer/viewer.ts";

/** How long it stays, milliseconds. */
const SHOWN = 5000;
/** Where the browser stores that it was shown. */
const KEY = "trimaran-hint";

const MOUSE = [
  ["W A S D", "walk"],
  ["drag", "look around"],
  ["click", "pick"],
  ["Home", "whole model"],
  ["?", "all keys"],
] as const;
const FINGERS = [
  ["one finger", "look around"],
  ["two fingers", "move"],
  ["tap", "pick"],
  ["⌂", "whole model"],
] as const;

export function Hint({ viewer }: { readonly viewer: Viewer }) {
  const isShown = useSignal(false);
  useEffect(() => {
    if (wasShown()) {
      return;
    }
    let timer: ReturnType<typeof setTimeout> | undefined;
    // The time begins with the first picture.
    const stop = viewer.onPicture(() => {
      if (timer === undefined) {
        isShown.value = true;
        timer = setTimeout(() => {
          isShown.value = false;
        }, SHOWN);
      }
    });
    return () => {
      stop();
      clearTimeout(timer);
    };
  }, [viewer]);
  if (!isShown.value) {
    return null;
  }
  return (
    <p class="panel hint" role="note">
      {(matchMedia("(pointer: coarse)").matches ? FINGERS : MOUSE).map(([input, effect]) => (
        <span key={input}>
          <kbd>{input}</kbd> {effect}
        </span>
      ))}
    </p>
  );
}

/** Whether it was shown before; from now on it was. */
function wasShown(): boolean {
  try {
    const wasShown = localStorage.getItem(KEY) !== null;
    localStorage.setItem(KEY, "shown");
    return wasShown;
  } catch {
    // Without storage it is shown each time.
    return false;
  }
}
