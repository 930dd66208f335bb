/** The caption of a picture: the model, a text, the subject, the date, a scale bar and a north arrow. */

import { signal } from "@preact/signals";
import type { Spot } from "../dimensions.ts";
import { lengthText, unit } from "../lengths.ts";
import { textSizeOf } from "./layout.ts";
import { roundLength } from "./scaleBar.ts";

/** The greatest share of the width that the scale bar takes, and the caption's texts. */
const BAR = 0.18;
const TEXTS = 0.6;
/** The room of the north arrow, and its half, in heights of the caption. */
const NORTH = 1.6;
const HALF_NORTH = 0.42;
/** An arrow shorter than this share of its length is not drawn: one looks along it. */
const SHORTEST = 0.25;
/** Paper and ink, for prints on any theme. */
const PAPER = "#ffffff";
const INK = "#1c2530";
const QUIET = "#4d5863";

/** The text that this person gives to captions. It stays as long as the page is open. */
export const captionText = signal("");

export interface Caption {
  /** The model's name. */
  readonly title: string;
  /** The person's own text; empty if there is none. */
  readonly text: string;
  /** The name of the picked part or of the view; empty if there is none. */
  readonly subject: string;
  readonly date: Date;
  /** Metres from the eye to what the scale is for; nothing if nothing is there. */
  readonly focus: number | undefined;
  /** Where north is in the picture, to the right and down: a share of its length. */
  readonly north: readonly [number, number];
  /** The scale is the same at all distances. */
  readonly isParallel: boolean;
}

/** The place of a caption in a file, pixels. */
export interface Strip {
  readonly top: number;
  readonly width: number;
  readonly height: number;
  /** How many metres a pixel is at a distance of one metre. */
  readonly metresEach: number;
  /** The side of a pixel on paper in metres, if it is known. */
  readonly printedEach?: number | undefined;
}

/** The texts of a caption from the left. */
export function textsOf({ title, text, subject, date }: Caption): readonly string[] {
  const two = (number: number) => String(number).padStart(2, "0");
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return [title, text.trim(), subject, day].filter((one) => one !== "");
}

/** The scale bar: its length in pixels, and its text. Nothing if it would be for no distance. */
export function barOf(
  { focus, isParallel }: Pick<Caption, "focus" | "isParallel">,
  { width, metresEach, printedEach }: Pick<Strip, "width" | "metresEach" | "printedEach">,
): { readonly pixels: number; readonly text: string } | undefined {
  if (focus === undefined || !(focus > 0) || !Number.isFinite(focus)) {
    return undefined;
  }
  const each = metresEach * focus;
  const length = roundLength(BAR * width * each, unit.peek());
  const scale =
    printedEach === undefined ? "" : `, 1 : ${Number((each / printedEach).toPrecision(3))} on paper`;
  const where = isParallel ? `parallel${scale}` : `${lengthText(focus, unit.peek())} away`;
  return { pixels: length / each, text: `${lengthText(length, unit.peek())}, ${where}` };
}

/** The north arrow: its foot, its tip, and the corners of its head. Nothing if one looks along it. */
export function arrowOf(
  { north: [x, y] }: Pick<Caption, "north">,
  { top, width, height }: Strip,
): { readonly foot: Spot; readonly head: readonly [Spot, Spot, Spot] } | undefined {
  const share = Math.hypot(x, y);
  if (share < SHORTEST) {
    return undefined;
  }
  const [half, middle] = [HALF_NORTH * height, { x: width - 0.6 * height, y: top + height / 2 }];
  const at = (along: number, across: number): Spot => ({
    x: middle.x + half * (along * x - (across * y) / share),
    y: middle.y + half * (along * y + (across * x) / share),
  });
  return { foot: at(-1, 0), head: [at(1, 0), at(0, 0.4), at(0, -0.4)] };
}

export function drawCaption(context: CanvasRenderingContext2D, strip: Strip, caption: Caption): void {
  const { top, width, height } = strip;
  const [size, space] = [textSizeOf(height), Math.round(0.5 * height)];
  const middle = top + height / 2;
  context.fillStyle = PAPER;
  context.fillRect(0, top, width, height);
  context.textBaseline = "middle";
  const [title = "", ...rest] = textsOf(caption);
  const texts = [
    { text: title, font: `600 ${size}px system-ui, sans-serif`, colour: INK },
    { text: rest.join("   "), font: `${size}px system-ui, sans-serif`, colour: QUIET },
  ];
  let left = space;
  for (const { text, font, colour } of texts) {
    [context.font, context.fillStyle] = [font, colour];
    const room = TEXTS * width - left;
    const taken = Math.min(context.measureText(text).width, Math.max(0, room));
    // Longer texts are set narrower.
    if (taken > 0) {
      context.fillText(text, left, middle, taken);
    }
    left += taken + space;
  }
  const bar = barOf(caption, strip);
  if (bar !== undefined) {
    drawBar(context, strip, bar, size);
  }
  drawNorth(context, strip, caption, size);
}

/** An arrow whose letter is at its left. */
function drawNorth(context: CanvasRenderingContext2D, strip: Strip, caption: Caption, size: number): void {
  const arrow = arrowOf(caption, strip);
  if (arrow === undefined) {
    return;
  }
  const { top, width, height } = strip;
  const { foot, head } = arrow;
  const [tip] = head;
  [context.fillStyle, context.strokeStyle] = [INK, INK];
  context.lineWidth = thicknessOf(strip);
  context.beginPath();
  context.moveTo(foot.x, foot.y);
  context.lineTo(tip.x, tip.y);
  context.stroke();
  context.beginPath();
  for (const { x, y } of head) {
    context.lineTo(x, y);
  }
  context.fill();
  context.font = `600 ${size}px system-ui, sans-serif`;
  context.textAlign = "right";
  context.fillText("N", width - 1.1 * height, top + height / 2);
  context.textAlign = "left";
}

function thicknessOf({ height }: Pick<Strip, "height">): number {
  return Math.max(1, Math.round(height / 24));
}

/** A line with an end on either side, and its text before it. */
function drawBar(
  context: CanvasRenderingContext2D,
  { top, width, height }: Strip,
  { pixels, text }: { readonly pixels: number; readonly text: string },
  size: number,
): void {
  const [middle, thick] = [top + height / 2, thicknessOf({ height })];
  const right = width - Math.round((0.5 + NORTH) * height);
  const left = right - pixels;
  context.fillStyle = INK;
  context.fillRect(left, middle - thick / 2, pixels, thick);
  for (const end of [left, right - thick]) {
    context.fillRect(end, middle - height / 5, thick, (2 * height) / 5);
  }
  context.font = `${size}px system-ui, sans-serif`;
  context.textAlign = "right";
  const room = left - TEXTS * width - size;
  context.fillText(text, left - size / 2, middle, Math.max(1, room));
  context.textAlign = "left";
}
