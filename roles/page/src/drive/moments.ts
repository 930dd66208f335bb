/** The page's traffic and memory, at several times of a walk. */

import type { Viewer } from "../viewer/viewer.ts";

/** Seconds between two moments; more on long walks. */
const PERIOD = 10;
/** The most moments of a walk, without the one at its end. */
const MOST = 60;

export class Moments {
  readonly #viewer: Viewer;
  readonly #period: number;
  readonly list: ReturnType<typeof momentOf>[] = [];

  /** For a walk that takes this many seconds. */
  constructor(viewer: Viewer, seconds: number) {
    this.#viewer = viewer;
    this.#period = Math.max(PERIOD, seconds / MOST);
  }

  /** The walk goes on for this many seconds. */
  pass(seconds: number): void {
    if (this.list.length < MOST && seconds >= this.list.length * this.#period) {
      this.add(seconds);
    }
  }

  add(seconds: number): void {
    this.list.push(momentOf(this.#viewer, seconds));
  }
}

/** See `Moment` of `src/page/drive.rs`. */
function momentOf({ display, renderer }: Viewer, seconds: number) {
  const bytes = display?.bytes;
  return {
    seconds,
    cameraBytes: bytes?.latest.sent ?? 0,
    idBytes: bytes?.frames.received ?? 0,
    pieceBytes: bytes?.bulk.received ?? 0,
    heldBytes: renderer.bytes,
    scriptBytes: scriptBytes(),
  };
}

/** Not every browser reports it. */
function scriptBytes(): number | null {
  const { memory } = performance as unknown as { readonly memory?: { readonly usedJSHeapSize: number } };
  return memory?.usedJSHeapSize ?? null;
}
