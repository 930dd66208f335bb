/** The camera's places, in the order in which a person has jumped to them: back and forward as in a browser. */

import { computed, signal } from "@preact/signals";
import type { Point } from "../space/point.ts";
import type { Mode } from "./navigator.ts";

/** Where the eye is, and how it moves. */
export interface CameraPose {
  readonly eye: Point;
  readonly forward: Point;
  readonly vfovDeg: number;
  readonly mode: Mode;
}

/** The most places. */
const MOST = 100;

export class CameraHistory {
  readonly #places = signal<{ readonly list: readonly (CameraPose | undefined)[]; readonly at: number }>({
    list: [undefined],
    at: 0,
  });
  readonly canGoBack = computed(() => this.#places.value.at > 0);
  readonly canGoForward = computed(() => this.#places.value.at + 1 < this.#places.value.list.length);

  /** The eye jumps from `now` to elsewhere. Places after this one are discarded. */
  leave(now: CameraPose): void {
    const { list, at } = this.#places.peek();
    const kept = [...list.slice(0, at), now].slice(-MOST);
    this.#places.value = { list: [...kept, undefined], at: kept.length };
  }

  /** The place before (-1) or after (1) this one, to which the eye moves from `now`; nothing if there is none. */
  go(steps: -1 | 1, now: CameraPose): CameraPose | undefined {
    const { list, at } = this.#places.peek();
    const there = list[at + steps];
    if (there !== undefined) {
      this.#places.value = { list: list.map((place, index) => (index === at ? now : place)), at: at + steps };
    }
    return there;
  }
}
