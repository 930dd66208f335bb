/** Drags of a mouse and of fingers on the canvas. */

/** One movement, in CSS pixels. */
export interface Drag {
  readonly right: number;
  readonly down: number;
  /** Pans instead of orbiting: the right or middle button, Shift, or two fingers. */
  readonly isPan: boolean;
  /** A pinch of two fingers. */
  readonly pinch: Pinch | undefined;
}

export interface Pinch {
  /** The middle of both fingers, in CSS pixels of the canvas. */
  readonly x: number;
  readonly y: number;
  /** The ratio of their distance to the one before. */
  readonly spread: number;
}

/** Where one finger or the mouse begins a drag, or the middle of two: CSS pixels of the canvas. */
export type Start = (x: number, y: number, fingers: 1 | 2) => void;

/** Calls `onStart` and `onDrag` for drags on the canvas. */
export function listenToPointers(
  canvas: HTMLCanvasElement,
  onStart: Start,
  onDrag: (drag: Drag) => void,
): void {
  /** Pressed pointers, with their last positions. */
  const down = new Map<number, { x: number; y: number }>();
  const fingers = () => {
    const [a, b] = [...down.values()];
    return a && b && { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };
  const pinchOf = (before: number, { x, y, apart }: { x: number; y: number; apart: number }): Pinch => {
    const { left, top } = canvas.getBoundingClientRect();
    return { x: x - left, y: y - top, spread: apart / before };
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const both = fingers();
    if (down.size === 1) {
      onStart(event.offsetX, event.offsetY, 1);
    } else if (down.size === 2 && both !== undefined) {
      const { x, y } = pinchOf(both.apart, both);
      onStart(x, y, 2);
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = down.get(event.pointerId);
    if (last === undefined) {
      return;
    }
    const before = fingers();
    const [right, over] = [event.clientX - last.x, event.clientY - last.y];
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const isPan = down.size > 1 || event.shiftKey || (event.buttons & 6) !== 0;
    // Each of two fingers moves the picture by its half.
    const share = 1 / down.size;
    const now = fingers();
    const pinch = before && now && before.apart > 0 ? pinchOf(before.apart, now) : undefined;
    onDrag({ right: right * share, down: over * share, isPan, pinch });
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
    canvas.addEventListener(end, (event) => down.delete(event.pointerId));
  }
}
