/** Dimension lines in a saved picture: a line with arrow heads, and its length on a plate beside it. */

import type { Size } from "../../space/size.ts";
import type { Dimension, Spot } from "../dimensions.ts";

/** Parts of a line in heights of its text. */
const THICK = 1 / 7;
const HEAD = 0.8;
const HALF_HEAD = 0.25;
const GAP = 0.3;
const PADDING = 0.3;
/** A line shorter than this has its arrow heads outside. */
const SHORT = 3 * HEAD;

/** Ink on paper can be read on any model. */
const PAPER = "#ffffff";
const INK = "#1c2530";

/** A dimension line as it is drawn, pixels. */
export interface DimensionLine {
  readonly strokes: readonly (readonly [Spot, Spot])[];
  /** The tip of each arrow head, and its other corners. */
  readonly heads: readonly (readonly [Spot, Spot, Spot])[];
  readonly plate: {
    readonly left: number;
    readonly top: number;
    readonly width: number;
    readonly height: number;
  };
}

/** The layout of a line whose text has this height and width. Its plate lies within the picture. */
export function dimensionLine(
  { from, to }: Dimension,
  size: number,
  textWidth: number,
  picture: Size,
): DimensionLine {
  const length = Math.hypot(to.x - from.x, to.y - from.y);
  // A line along the gaze is a point.
  const way = length > 0 ? { x: (to.x - from.x) / length, y: (to.y - from.y) / length } : { x: 1, y: 0 };
  const along = (spot: Spot, steps: number): Spot => ({
    x: spot.x + steps * way.x,
    y: spot.y + steps * way.y,
  });
  const across = (spot: Spot, steps: number): Spot => ({
    x: spot.x - steps * way.y,
    y: spot.y + steps * way.x,
  });
  const isOutside = length < SHORT * size;
  const ends = [
    { end: from, out: -1 },
    { end: to, out: 1 },
  ].filter(({ end }) => !end.isCut);
  const heads = ends.map(({ end, out }): [Spot, Spot, Spot] => {
    const base = along(end, (isOutside ? out : -out) * HEAD * size);
    return [end, across(base, HALF_HEAD * size), across(base, -HALF_HEAD * size)];
  });
  const extensions = isOutside
    ? ends.map(({ end, out }): [Spot, Spot] => [end, along(end, 2 * out * HEAD * size)])
    : [];
  const [width, height] = [textWidth + 2 * PADDING * size, (1 + 2 * PADDING) * size];
  // Above the line, or to the right of an upright one.
  const side = way.x < 0 || (way.x === 0 && way.y < 0) ? 1 : -1;
  const away = (Math.abs(way.y) * width + Math.abs(way.x) * height) / 2 + GAP * size;
  const middle = across({ x: (from.x + to.x) / 2, y: (from.y + to.y) / 2 }, side * away);
  const within = (start: number, most: number) => Math.max(0, Math.min(most, start));
  const plate = {
    left: within(middle.x - width / 2, picture.width - width),
    top: within(middle.y - height / 2, picture.height - height),
    width,
    height,
  };
  return { strokes: [[from, to], ...extensions], heads, plate };
}

/** Draws these into a picture, with texts of this height. */
export function drawDimensions(
  context: CanvasRenderingContext2D,
  picture: Size,
  dimensions: readonly Dimension[],
  size: number,
): void {
  context.save();
  context.beginPath();
  context.rect(0, 0, picture.width, picture.height);
  context.clip();
  context.font = `600 ${size}px system-ui, sans-serif`;
  [context.textAlign, context.textBaseline, context.lineJoin] = ["center", "middle", "round"];
  const laid = dimensions.map((one) => {
    return { ...dimensionLine(one, size, context.measureText(one.label).width, picture), label: one.label };
  });
  const thick = Math.max(1.5, THICK * size);
  for (const { strokes, heads } of laid) {
    // Paper around the ink.
    for (const [colour, around] of [
      [PAPER, thick],
      [INK, 0],
    ] as const) {
      [context.strokeStyle, context.fillStyle] = [colour, colour];
      for (const [from, to] of strokes) {
        path(context, [from, to]);
        context.lineWidth = thick + 2 * around;
        context.stroke();
      }
      for (const head of heads) {
        path(context, head);
        context.closePath();
        context.fill();
        context.lineWidth = 2 * around;
        if (around > 0) {
          context.stroke();
        }
      }
    }
  }
  // No line crosses a text.
  for (const { plate, label } of laid) {
    const { left, top, width, height } = plate;
    [context.fillStyle, context.strokeStyle, context.lineWidth] = [PAPER, INK, thick / 2];
    context.fillRect(left, top, width, height);
    context.strokeRect(left, top, width, height);
    context.fillStyle = INK;
    context.fillText(label, left + width / 2, top + height / 2);
  }
  context.restore();
}

function path(context: CanvasRenderingContext2D, spots: readonly Spot[]): void {
  context.beginPath();
  for (const { x, y } of spots) {
    context.lineTo(x, y);
  }
}
