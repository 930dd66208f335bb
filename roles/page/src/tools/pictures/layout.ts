/** The sizes of a saved picture and its parts. */

import type { Size } from "../../space/size.ts";

/** Culled for around a picture, on each side: smoothing shifts it by half a pixel. Pixels. */
const MARGIN = 4;
/** The least width and height of a picture, pixels. */
const SMALLEST = 64;
/** The height of a caption: a share of the picture's width, and at least this many pixels. */
const STRIP = 1 / 40;
const LOWEST_STRIP = 28;

/** The height of a caption of a picture this wide. */
export function stripOf(width: number): number {
  return Math.max(LOWEST_STRIP, Math.round(width * STRIP));
}

/** The height of the texts of a picture with a caption of this height. */
export function textSizeOf(strip: number): number {
  return Math.round(0.42 * strip);
}

/** The wishes of a person. */
export interface Wish {
  /** The size of the file. */
  readonly size: Size;
  /** The picture has the screen's proportions: the file is as high as that takes. */
  readonly keepsShape: boolean;
  readonly isCaptioned: boolean;
}

export interface Layout {
  /** The whole file. */
  readonly file: Size;
  /** The picture of the model, at the top. */
  readonly picture: Size;
  /** Height of the caption below it; zero without one. */
  readonly strip: number;
}

/** The layout of a picture of what `screen` shows. Throws a `RangeError` if there is no such picture. */
export function layoutOf({ size, keepsShape, isCaptioned }: Wish, screen: Size, most: Size): Layout {
  const { width } = size;
  const strip = isCaptioned ? stripOf(width) : 0;
  const height = keepsShape ? Math.round((width * screen.height) / screen.width) : size.height - strip;
  const limit = largest(most);
  const fits = (side: number, most: number) => Number.isInteger(side) && side >= SMALLEST && side <= most;
  if (!fits(width, limit.width) || !fits(height, limit.height)) {
    const range = `${SMALLEST} to ${limit.width} pixels wide and to ${limit.height} high`;
    throw new RangeError(`a picture of ${width} x ${height} pixels: this service culls for ${range}`);
  }
  return { file: { width, height: height + strip }, picture: { width, height }, strip };
}

/** The largest picture, if the service culls for pictures of at most this size. */
export function largest({ width, height }: Size): Size {
  return { width: width - 2 * MARGIN, height: height - 2 * MARGIN };
}

/** The size to cull for. Its pixels are those of the picture. */
export function culled({ width, height }: Size): Size {
  return { width: width + 2 * MARGIN, height: height + 2 * MARGIN };
}

/** The tangent of half the vertical field of view with which a picture shows all that a screen shows. */
export function showingAll(tanHalfFov: number, screen: Size, { width, height }: Size): number {
  return tanHalfFov * Math.max(1, (screen.width * height) / (screen.height * width));
}
