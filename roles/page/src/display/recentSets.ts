/** Recent sets: a moving eye may see a drawable that one of them has and the newest lacks. */

import type { DrawableRecord } from "../proto/records.ts";

/** The longest time between the poses of two sets that both still count, milliseconds. */
const KEPT = 120;

interface RecentSet {
  /** When its pose was published. */
  readonly posed: number;
  readonly drawables: readonly DrawableRecord[];
}

export class RecentSets {
  /** The newest first. */
  #sets: readonly RecentSet[] = [];

  /** Adds a set, replacing one of the same pose. */
  add(newest: RecentSet): void {
    const others = this.#sets.filter(({ posed }) => posed < newest.posed && newest.posed - posed <= KEPT);
    this.#sets = [newest, ...others];
  }

  /** The newest set, and from earlier ones the drawables of nodes that no newer one has. */
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
