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
interface Size {
  readonly width: number;
  readonly height: number;
}

/**
 * What is culled for where a picture of this size is shown, in which silhouettes are off by `epsilon` pixels
 * at most.
 */
export function sampling(
  { width, height }: Size,
  epsilon: number,
  isMoving: boolean,
): Pick<ViewState, "pictureSize" | "levelRule"> {
  const coarser = isMoving ? COARSER : 1;
  const side = (pixels: number) => Math.ceil((WIDER * pixels) / coarser);
  return {
    pictureSize: { width: side(width), height: side(height) },
    levelRule: { epsilon: epsilon / coarser, fewPixels: false },
  };
}

/**
 * By how much what is culled for is wider than a picture of this size. The pixels of an eye at rest are as
 * large as those of the picture.
 */
export function widerBy(picture: Size): number {
  return sampling(picture, 1, false).pictureSize.height / picture.height;
}
