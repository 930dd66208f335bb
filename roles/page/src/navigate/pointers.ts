/** Drags of a mouse and of fingers on the canvas. */

/** One movement, in CSS pixels. */
export interface Drag {
  readonly right: number;
  readonly down: number;
  /** Pans instead of orbiting: the right or middle button, Shift, or two fingers. */
  readonly isPan: boolean;
  /** The ratio of two fingers' distance to the one before. */
  readonly spread: number;
}

/** Where a drag began, in CSS pixels of the canvas. */
export type Start = (x: number, y: number) => void;

/** Calls `onStart` and `onDrag` for drags on the canvas. */
export function listenToPointers(
  canvas: HTMLCanvasElement,
  onStart: Start,
  onDrag: (drag: Drag) => void,
): void {
  /** Pressed pointers, with their last positions. */
  const down = new Map<number, { x: number; y: number }>();
  const spreadOf = () => {
    const [a, b] = [...down.values()];
    return a === undefined || b === undefined ? 0 : Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (down.size === 1) {
      onStart(event.offsetX, event.offsetY);
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = down.get(event.pointerId);
    if (last === undefined) {
      return;
    }
    const before = spreadOf();
    const [right, over] = [event.clientX - last.x, event.clientY - last.y];
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const isPan = down.size > 1 || event.shiftKey || (event.buttons & 6) !== 0;
    // Each of two fingers moves the picture by its half.
    const share = 1 / down.size;
    const spread = before > 0 ? spreadOf() / before : 1;
    onDrag({ right: right * share, down: over * share, isPan, spread });
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
    canvas.addEventListener(end, (event) => down.delete(event.pointerId));
  }
}
