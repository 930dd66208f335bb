/** Makes a picture of any size, as exact and as fine as that of an eye at rest. */

import { Projection } from "../../draw/projection.ts";
import { cutOut, tilesOf } from "../../draw/region.ts";
import type { PartDetails } from "../../service/service.ts";
import { centreOf } from "../../space/box.ts";
import { wayInPicture } from "../../space/plantFrame.ts";
import type { Viewer } from "../../viewer/viewer.ts";
import { dimensionOf } from "../dimensions.ts";
import { unit } from "../lengths.ts";
import { type Caption, drawCaption } from "./caption.ts";
import { drawDimensions } from "./dimensionLines.ts";
import { culled, type Layout, showingAll, stripOf, textSizeOf } from "./layout.ts";

/** Milliseconds between two looks for the set. */
const LOOK = 20;
/** CSS pixels around the middle of the screen to search for a surface. */
const AROUND = 40;

/** How far it is: a share, from 0 to 1. */
export type Progress = (stage: "culling" | "drawing", share: number) => void;

/** No picture could be made. The message says why. */
export class PictureError extends Error {}

export interface Order {
  readonly layout: Layout;
  /** The height of the file on paper in metres, if it is for paper. */
  readonly printedHeight?: number | undefined;
  /** A text for the caption. */
  readonly text: string;
  /** The name of the view or of the picked part, for the caption. */
  readonly subject: string;
  /** The picked part: the scale is for its distance. */
  readonly picked: PartDetails | undefined;
  /** Whether the measured distances are drawn. */
  readonly hasDimensions: boolean;
  /** Gives the picture up. */
  readonly signal: AbortSignal;
  readonly onProgress: Progress;
}

/**
 * A picture of the present view. The set is culled for the picture's own pixels. It is drawn tile by tile, as
 * it may be larger than a canvas of WebGL can be. Meanwhile the eye rests. Throws a `PictureError`, or the
 * signal's reason.
 */
export async function takePicture(viewer: Viewer, order: Order): Promise<HTMLCanvasElement> {
  const { navigator } = viewer;
  const wasHeld = navigator.isHeld;
  navigator.isHeld = true;
  try {
    return await taken(viewer, order);
  } finally {
    navigator.isHeld = wasHeld;
    viewer.endOther();
  }
}

async function taken(
  viewer: Viewer,
  { layout, printedHeight, text, subject, picked, hasDimensions, signal, onProgress }: Order,
): Promise<HTMLCanvasElement> {
  const { file, picture, strip } = layout;
  const own = viewer.camera;
  const focus = focusOf(viewer, picked);
  const north = wayInPicture(viewer.scene.plant, viewer.navigator.axes, [0, 1, 0]);
  const tanHalfFov = showingAll(own.tanHalfFov, viewer.canvas, picture);
  const camera = { ...own, tanHalfFov };
  const wider = culled(picture);
  onProgress("culling", 0);
  const { display } = viewer;
  if (display?.leader !== undefined) {
    throw new PictureError("it is of your own view, and you follow somebody");
  }
  const asked = { ...own, tanHalfFov: (tanHalfFov * wider.height) / picture.height };
  if (display === undefined || !viewer.beginOther(asked, wider)) {
    throw new PictureError("the service does not answer");
  }
  while (!display.isSettled) {
    await new Promise((resolve) => setTimeout(resolve, LOOK));
    signal.throwIfAborted();
    if (display.isOver) {
      // The service says why it ends a link.
      throw new PictureError(viewer.session.trouble.peek() || "the link to the service was lost");
    }
  }
  const [drawables, look] = [viewer.shown(), viewer.look()];
  const context = contextOf(file.width, file.height);
  while (!viewer.renderer.smooth(drawables)) {
    await new Promise((resolve) => setTimeout(resolve));
    signal.throwIfAborted();
  }
  const tiles = tilesOf(picture);
  for (const [done, tile] of tiles.entries()) {
    onProgress("drawing", done / tiles.length);
    await new Promise((resolve) => setTimeout(resolve));
    signal.throwIfAborted();
    const pixels = await viewer.renderer.drawRegion(camera, drawables, look, tile.drawn);
    if (pixels === undefined) {
      throw new PictureError("the graphics device was lost");
    }
    const { left, bottom, width, height } = tile;
    const image = new ImageData(cutOut(tile, pixels), width, height);
    context.putImageData(image, left, picture.height - bottom - height);
  }
  if (hasDimensions) {
    const projection = new Projection(camera, picture.width, picture.height);
    const dimensions = viewer.distances.peek().flatMap((one) => {
      const dimension = dimensionOf(one, projection, unit.peek());
      return dimension?.isInFront ? [dimension] : [];
    });
    drawDimensions(context, picture, dimensions, textSizeOf(stripOf(picture.width)));
  }
  if (strip > 0) {
    const isParallel = viewer.navigator.projection.peek() === "parallel";
    const { name: title } = viewer.scene;
    const caption: Caption = { title, text, subject, date: new Date(), focus, north, isParallel };
    const metresEach = (2 * tanHalfFov) / picture.height;
    const printedEach = printedHeight && printedHeight / file.height;
    const place = { top: picture.height, width: file.width, height: strip, metresEach, printedEach };
    drawCaption(context, place, caption);
  }
  return context.canvas;
}

/** The file of a picture. */
export async function pngOf(canvas: HTMLCanvasElement): Promise<Blob> {
  const blob = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve));
  if (blob === null) {
    throw new PictureError("the browser has no memory for the file");
  }
  return blob;
}

/** Metres along the view to the picked part, or else to the middle of the picture. */
function focusOf(viewer: Viewer, picked: PartDetails | undefined): number | undefined {
  const { canvas, projection } = viewer;
  const { near } = viewer.camera;
  const depth = picked && projection.depthOf(centreOf(picked.core));
  if (depth !== undefined && depth > near) {
    return depth;
  }
  const middle = viewer.pointAt(canvas.clientWidth / 2, canvas.clientHeight / 2, AROUND);
  const { focus, projection: kind } = viewer.navigator;
  const plane = middle ?? (kind.peek() === "parallel" ? focus : undefined);
  return plane && projection.depthOf(plane);
}

function contextOf(width: number, height: number): CanvasRenderingContext2D {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  if (context === null) {
    throw new PictureError(`the browser has no memory for a picture of ${width} x ${height} pixels`);
  }
  return context;
}
