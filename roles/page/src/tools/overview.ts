/** Overviews: of all that is shown, and the one at the start, with a flight down to where a walk begins. */

import { ISO } from "../navigate/standardViews.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { SceneDescription, Service } from "../service/service.ts";
import { type Box, isSame } from "../space/box.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { drawnOf, type ViewHistory } from "../viewer/viewHistory.ts";

/** The duration of the flight, seconds. */
const FLIGHT = 2;
/** The longest wait for an exact overview, once there is any picture: milliseconds. */
const LONGEST_WAIT = 3000;
/** The most shown objects whose box the service looks for: of more, it is about that of the whole model. */
const MOST_BOXED = 1_000_000;

/** Whether the person wants as little motion as possible. */
export function isMotionReduced(): boolean {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}

/** The part of a viewer that frames what it shows. */
interface Framed {
  readonly scene: Pick<SceneDescription, "core" | "objects">;
  readonly service: Pick<Service, "boxAround">;
  readonly view: Pick<ViewHistory, "current">;
}

/**
 * Calls `frame` with the box around all that is shown. Where objects are hidden or isolated, the service says
 * it. Without an answer, or with nothing shown, it is the box of the whole model.
 */
export async function frameShown({ scene, service, view }: Framed, frame: (box: Box) => void): Promise<void> {
  const { core, objects } = scene;
  const now = view.current.peek();
  if (now.isolated === undefined && now.hidden.isEmpty) {
    frame(core);
    return;
  }
  const shown = drawnOf(now, ObjectSet.run(0, objects));
  const isWhole = shown.isEmpty || shown.size > MOST_BOXED;
  const box = isWhole ? core : await service.boxAround(shown).catch(() => core);
  // The whole model is framed by its shape, and others by their box.
  frame(isSame(box, core) ? core : box);
}

/** Moves to a view of all that is shown, from a corner. */
export function seeAll(viewer: Viewer): Promise<void> {
  return frameShown(viewer, (box) => viewer.navigator.frameFrom(box, ISO.forward));
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
