/** Loads the code for normals of round surfaces once there is a picture: the first one does without. */

import type { Smoother } from "./smoother.ts";

let made: typeof Smoother | undefined;
let loading: Promise<void> | undefined;
let isAbsent = false;

/** Begins to load it, if nothing has before. Resolves when it is there, or cannot be had. */
export function loadSmoother(): Promise<void> {
  loading ??= import("./smoother.ts").then(
    ({ Smoother }) => {
      made = Smoother;
    },
    () => {
      // Round surfaces look flat then.
      isAbsent = true;
    },
  );
  return loading;
}

/** Whether it is on its way. */
export function isSmootherDue(): boolean {
  return made === undefined && !isAbsent;
}

/** Nothing until it is there. */
export function smootherClass(): typeof Smoother | undefined {
  return made;
}
