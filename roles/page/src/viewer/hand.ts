/** Measures the latency from input to picture. */

const KINDS = ["keydown", "pointermove", "wheel"] as const;

export class Hand {
  /** When the first input came that no picture has followed yet. */
  #since: number | undefined;
  /** The latency of the last picture that followed input, milliseconds. */
  latency = 0;

  constructor() {
    for (const kind of KINDS) {
      const note = ({ timeStamp }: Event) => {
        this.#since ??= timeStamp;
      };
      addEventListener(kind, note, { capture: true, passive: true });
    }
  }

  /** Called with each picture: ends the measurement if the eye has moved. */
  follow(hasMoved: boolean): void {
    if (hasMoved && this.#since !== undefined) {
      this.latency = performance.now() - this.#since;
    }
    this.#since = undefined;
  }
}
