/** Sets that were shown lately: a moving eye may see what one of them has and the newest one has not. */

import type { DrawableRecord } from "../proto/records.ts";

/** Milliseconds between the poses of two sets of which both still count. */
const KEPT = 120;

interface RecentSet {
  /** When its pose was published. */
  readonly posed: number;
  readonly drawables: readonly DrawableRecord[];
}

export class RecentSets {
  /** The newest first. */
  #sets: readonly RecentSet[] = [];

  /** Adds a set, in place of one of the same pose. */
  add(newest: RecentSet): void {
    const others = this.#sets.filter(({ posed }) => posed < newest.posed && newest.posed - posed <= KEPT);
    this.#sets = [newest, ...others];
  }

  /** The newest set, and of those before it what shows nodes that no newer one does. */
  union(): DrawableRecord[] {
    const nodes = new Set<number>();
    const drawables: DrawableRecord[] = [];
    for (const set of this.#sets) {
      const others = set.drawables.filter(({ node }) => !nodes.has(node));
      for (const drawable of others) {
        nodes.add(drawable.node);
        drawables.push(drawable);
      }
    }
    return drawables;
  }
}
