/** The resolution of culling for a canvas. */

import type { ViewState } from "../proto/viewState.ts";
import type { Size } from "../space/size.ts";

/** The culled view is this much wider and higher than the picture, so that a turn uncovers nothing new. */
const WIDER = 1.5;
/**
 * While the eye moves, culling pixels are this much wider, so that sets come sooner. Silhouettes stay as
 * fine.
 */
const COARSER = 1.5;

/**
 * The culling resolution for a picture of this size, with silhouette errors of at most `epsilon` pixels. If
 * the service takes no picture so large, pixels are made wider.
 */
export function sampling(
  { width, height }: Size,
  epsilon: number,
  isMoving: boolean,
  most: Size,
): Pick<ViewState, "pictureSize" | "levelRule"> {
  const fitting = Math.max((WIDER * width) / most.width, (WIDER * height) / most.height);
  const coarser = Math.max(isMoving ? COARSER : 1, fitting);
  const side = (pixels: number, most: number) => Math.min(most, Math.ceil((WIDER * pixels) / coarser));
  return {
    pictureSize: { width: side(width, most.width), height: side(height, most.height) },
    levelRule: { epsilon: epsilon / coarser, fewPixels: false },
  };
}

/**
 * The picture that a set is right for on a screen of this size, with at most this tangent of half the vertical
 * field of view. The set was culled for `culled`, with a picture of `set` pixels. The picture shows nothing
 * beyond that one, and has no finer pixels: it has fewer than the screen, if need be.
 */
export function within(
  screen: Size,
  tanHalfFov: number,
  culled: { readonly tanHalfFov: number },
  set: Size,
): Size & { readonly tanHalfFov: number } {
  const most = Math.min(tanHalfFov, culled.tanHalfFov);
  const rows = (set.height * most) / culled.tanHalfFov;
  const share = Math.min(1, set.width / screen.width, rows / screen.height);
  const width = Math.max(1, Math.floor(share * screen.width));
  const height = Math.max(1, Math.floor(share * screen.height));
  const across = (culled.tanHalfFov * set.width * height) / (set.height * width);
  return { width, height, tanHalfFov: Math.min(most, across) };
}

/**
 * How much wider the culled view is than a picture of this size. The culling pixels of an eye at rest are as
 * large as the picture's, if the service allows it.
 */
export function widerBy({ height }: Size): number {
  return Math.ceil(WIDER * height) / height;
}
