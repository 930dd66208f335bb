/** In which order drawables are drawn: the nearest box first, as in all displays. */

import type { DrawableRecord } from "../proto/records.ts";

export class DrawOrder {
  #distances = new Float32Array(0);
  #places = new Uint32Array(0);

  /**
   * The places of `drawables` by the squared distance of the eye from their nodes' boxes (0 inside, rounded to
   * 32 bits), then by number. It holds until the next call.
   */
  sort(eye: readonly [number, number, number], drawables: readonly DrawableRecord[]): Uint32Array {
    const count = drawables.length;
    if (count > this.#places.length) {
      this.#distances = new Float32Array(2 * count);
      this.#places = new Uint32Array(2 * count);
    }
    const distances = this.#distances;
    for (const [at, drawable] of drawables.entries()) {
      this.#places[at] = at;
      distances[at] = squaredDistance(eye, drawable);
    }
    const number = (at: number) => drawables[at]?.id ?? 0;
    return this.#places
      .subarray(0, count)
      .sort((a, b) => (distances[a] ?? 0) - (distances[b] ?? 0) || number(a) - number(b));
  }
}

function squaredDistance(
  eye: readonly [number, number, number],
  { worldMin, worldMax }: Pick<DrawableRecord, "worldMin" | "worldMax">,
): number {
  let sum = 0;
  for (const axis of [0, 1, 2] as const) {
    const away = Math.max(worldMin[axis] - eye[axis], eye[axis] - worldMax[axis], 0);
    sum += away * away;
  }
  return sum;
}
