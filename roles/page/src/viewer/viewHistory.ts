/** A person's changes of the view, with undo. */

import { computed, signal } from "@preact/signals";
import { type Colouring, NO_COLOURS } from "../draw/colours.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { ViewState } from "../proto/viewState.ts";
import type { End } from "../service/service.ts";

/** Between two points that a person has picked, or of a clash. */
export interface Distance {
  readonly from: End;
  readonly to: End;
  /** It belongs to a clash that is shown, and goes with it. */
  readonly isOfClash?: true;
}

/** The distances that a person has measured. */
export function measuredOf(distances: readonly Distance[]): readonly Distance[] {
  return distances.filter(({ isOfClash }) => !isOfClash);
}

/** The part of a view state that a person changes. */
export interface SeenView extends Pick<ViewState, "sections" | "hidden" | "isolated"> {
  readonly seeThrough: ObjectSet;
}

/** All that a person changes. */
export interface UserView extends SeenView {
  /** The measured distances. */
  readonly distances: readonly Distance[];
  readonly colouring: Colouring;
}

export const WHOLE: UserView = {
  sections: [],
  hidden: ObjectSet.EMPTY,
  isolated: undefined,
  seeThrough: ObjectSet.EMPTY,
  distances: [],
  colouring: NO_COLOURS,
};

/** Those of these that are drawn. */
export function drawnOf(
  { isolated, hidden }: Pick<SeenView, "isolated" | "hidden">,
  objects: ObjectSet,
): ObjectSet {
  return (isolated === undefined ? objects : objects.minus(objects.minus(isolated))).minus(hidden);
}

/** Whether the picture is one of ghosts: at least half of all objects are see-through, beyond the model's. */
export function hasGhosts(
  { seeThrough }: Pick<SeenView, "seeThrough">,
  objectCount: number,
  model = ObjectSet.EMPTY,
): boolean {
  return 2 * seeThrough.size >= objectCount && !model.covers(seeThrough);
}

/** The most steps of undo. */
const MOST = 100;

/** A view, and those before it. */
export class ViewHistory {
  readonly #views;
  /** The model's see-through objects. */
  readonly modelSeeThrough: ObjectSet;
  readonly current;
  readonly canUndo;
  readonly canRedo;
  /** The part of it for cullers: a new object only if that changes. */
  readonly seen;
  #seen: SeenView | undefined;
  /** Whether a drag is under way, whose change is not a step yet. */
  #isOpen = false;

  /** For a model with these see-through objects. */
  constructor(modelSeeThrough = ObjectSet.EMPTY) {
    this.modelSeeThrough = modelSeeThrough;
    const whole: UserView = { ...WHOLE, seeThrough: modelSeeThrough };
    this.#views = signal<{ readonly list: readonly UserView[]; readonly at: number }>({
      list: [whole],
      at: 0,
    });
    this.current = computed<UserView>(() => this.#views.value.list[this.#views.value.at] ?? whole);
    this.canUndo = computed(() => this.#views.value.at > 0);
    this.canRedo = computed(() => this.#views.value.at + 1 < this.#views.value.list.length);
    this.seen = computed<SeenView>(() => {
      const { sections, hidden, isolated, seeThrough } = this.current.value;
      const known = this.#seen;
      const isSame =
        known?.sections === sections &&
        known.hidden === hidden &&
        known.isolated === isolated &&
        known.seeThrough === seeThrough;
      this.#seen = isSame ? known : { sections, hidden, isolated, seeThrough };
      return this.#seen;
    });
  }

  /** Makes a step. Undone steps are discarded. */
  change(change: Partial<UserView>): void {
    this.#set(change, this.#isOpen);
    this.#isOpen = false;
  }

  /** Changes during a drag: the whole drag, with the `change` that ends it, is one step. */
  drag(change: Partial<UserView>): void {
    this.#set(change, this.#isOpen);
    this.#isOpen = true;
  }

  /** Corrects all views, without making a step. */
  amend(correct: (view: UserView) => Partial<UserView>): void {
    const { list, at } = this.#views.peek();
    this.#views.value = { list: list.map((view) => ({ ...view, ...correct(view) })), at };
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
