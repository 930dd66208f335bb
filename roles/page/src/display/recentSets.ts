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

  /** The newest set, and of earlier ones what is of nodes that no newer one has, or of the same level. */
  union(): DrawableRecord[] {
    /** The levels of each node in newer sets: several where one of them stands in for a part of the other. */
    const levels = new Map<number, Set<number>>();
    const drawables = new Map<number, DrawableRecord>();
    for (const set of this.#sets) {
      const others = set.drawables.filter(({ node, level }) => levels.get(node)?.has(level) ?? true);
      for (const drawable of others) {
        drawables.set(drawable.id, drawable);
      }
      for (const { node, level } of others) {
        levels.set(node, (levels.get(node) ?? new Set()).add(level));
      }
    }
    return [...drawables.values()];
  }
}
