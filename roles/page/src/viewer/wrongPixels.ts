/** Pixels that show another object than they should. */

import { NOTHING } from "../draw/device.ts";
import type { Drawable } from "../draw/model.ts";

/** The share of pixels, from 0 to 1, at which two pictures show different objects. */
export function wrongShare(shown: Uint32Array, exact: Uint32Array, drawables: Iterable<Drawable>): number {
  const byId = new Map<number, Drawable>();
  for (const drawable of drawables) {
    byId.set(drawable.id, drawable);
  }
  /** Known results for two drawables, by their numbers. */
  const known = new Map<number, Map<number, boolean>>();
  let wrong = 0;
  for (let pixel = 0; pixel < exact.length; pixel += 1) {
    const [a, b] = [shown[pixel] ?? NOTHING, exact[pixel] ?? NOTHING];
    if (a === b) {
      continue;
    }
    const ofA = known.get(a) ?? new Map<number, boolean>();
    known.set(a, ofA);
    let isSame = ofA.get(b);
    if (isSame === undefined) {
      isSame = showSame(byId.get(a), byId.get(b));
      ofA.set(b, isSame);
    }
    wrong += isSame ? 0 : 1;
  }
  return exact.length === 0 ? 0 : wrong / exact.length;
}

/** Whether two drawables show the same object, or one shows a group with the other's. */
function showSame(a: Drawable | undefined, b: Drawable | undefined): boolean {
  if (a === undefined || b === undefined) {
    return false;
  }
  if (a.objects === 1 && b.objects === 1) {
    return a.object === b.object;
  }
  return a.objects > b.objects ? isWithin(b, a) : isWithin(a, b);
}

function isWithin(part: Drawable, whole: Drawable): boolean {
  return [0, 1, 2].every((axis) => {
    const [low, high] = [whole.worldMin[axis] ?? 0, whole.worldMax[axis] ?? 0];
    // Levels of an object differ a little.
    const slack = 0.01 * (high - low);
    return (part.worldMin[axis] ?? 0) >= low - slack && (part.worldMax[axis] ?? 0) <= high + slack;
  });
}
