/** What a person has changed of the view, and how to take that back. */

import { computed, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import type { ViewState } from "../proto/viewState.ts";

/** What of a view state a person changes by hand. */
export type UserView = Pick<ViewState, "sections" | "hidden" | "isolated" | "seeThrough">;

export const WHOLE: UserView = {
  sections: [],
  hidden: ObjectSet.EMPTY,
  isolated: undefined,
  seeThrough: ObjectSet.EMPTY,
};

/** Steps that can be taken back. */
const MOST = 100;

/** A view, and those before it. */
export class ViewHistory {
  readonly #views = signal<{ readonly list: readonly UserView[]; readonly at: number }>({
    list: [WHOLE],
    at: 0,
  });
  readonly current = computed<UserView>(() => this.#views.value.list[this.#views.value.at] ?? WHOLE);
  readonly canUndo = computed(() => this.#views.value.at > 0);
  readonly canRedo = computed(() => this.#views.value.at + 1 < this.#views.value.list.length);
  /** A change that is not a step yet: something is being dragged. */
  #isOpen = false;

  /** Makes a step. What was taken back before it is gone. */
  change(change: Partial<UserView>): void {
    this.#set(change, this.#isOpen);
    this.#isOpen = false;
  }

  /** Changes while something is dragged: all of it, and the `change` that ends it, is one step. */
  drag(change: Partial<UserView>): void {
    this.#set(change, this.#isOpen);
    this.#isOpen = true;
  }

  undo(): void {
    this.#go(-1);
  }

  redo(): void {
    this.#go(1);
  }

  #set(change: Partial<UserView>, isSameStep: boolean): void {
    const { list, at } = this.#views.peek();
    const kept = list.slice(0, isSameStep ? at : at + 1).slice(-MOST);
    const view = { ...this.current.peek(), ...change };
    this.#views.value = { list: [...kept, view], at: kept.length };
  }

  #go(steps: number): void {
    this.#isOpen = false;
    const { list, at } = this.#views.peek();
    this.#views.value = { list, at: Math.max(0, Math.min(list.length - 1, at + steps)) };
  }
}
