/** The start: an overview of the model, and then a flight down to the place where a walk begins. */

import { ISO } from "../navigate/standardViews.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** The duration of the flight, seconds. */
const FLIGHT = 2;
/** The longest wait for an exact overview, once there is any picture: milliseconds. */
const LONGEST_WAIT = 3000;

/** Whether the person wants as little motion as possible. */
export function isMotionReduced(): boolean {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}

/** Moves to a view of the whole model, from a corner. */
export function seeAll({ navigator, scene }: Viewer): void {
  navigator.frameFrom(scene.core, ISO.forward);
}

/** Shows an overview, and flies down once it is drawn. Any input ends the flight. */
export function flyDown(viewer: Viewer): void {
  const { navigator, scene } = viewer;
  const [to, mode] = [{ eye: navigator.eye, forward: navigator.forward }, navigator.mode.peek()];
  let since: number | undefined;
  const isDrawn = () => {
    if (viewer.display?.shown !== undefined) {
      since ??= performance.now();
    }
    return viewer.isSettled || (since !== undefined && performance.now() - since > LONGEST_WAIT);
  };
  navigator.show(scene.core, ISO.forward);
  navigator.fly(to, mode, FLIGHT, isDrawn);
}
