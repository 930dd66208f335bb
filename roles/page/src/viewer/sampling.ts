/** How finely is culled for what a canvas shows. */

import type { ViewState } from "../proto/viewState.ts";

/** The picture that is culled for is so much wider and higher: what a turn uncovers is there already. */
const WIDER = 1.5;
/**
 * While the eye moves, pixels that are culled for are so much wider: its sets come sooner. Silhouettes are as
 * fine as ever.
 */
const COARSER = 1.5;

/** Pixels. */
export interface Size {
  readonly width: number;
  readonly height: number;
}

/**
 * What is culled for where a picture of this size is shown, in which silhouettes are off by `epsilon` pixels
 * at most. Where the service takes no picture so large, pixels are wider until it does.
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
 * By how much what is culled for is wider than a picture of this size. The pixels of an eye at rest are as
 * large as those of the picture, where the service takes that.
 */
export function widerBy({ height }: Size): number {
  return Math.ceil(WIDER * height) / height;
}
