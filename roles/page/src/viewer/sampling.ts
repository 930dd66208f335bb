/** The resolution of culling for a canvas. */

import type { ViewState } from "../proto/viewState.ts";

/** The culled view is this much wider and higher than the picture, so that a turn uncovers nothing new. */
const WIDER = 1.5;
/**
 * While the eye moves, culling pixels are this much wider, so that sets come sooner. Silhouettes stay as
 * fine.
 */
const COARSER = 1.5;

/** Pixels. */
export interface Size {
  readonly width: number;
  readonly height: number;
}

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
 * How much wider the culled view is than a picture of this size. The culling pixels of an eye at rest are as
 * large as the picture's, if the service allows it.
 */
export function widerBy({ height }: Size): number {
  return Math.ceil(WIDER * height) / height;
}
