/** The picked parts, and their details from the service. */

import { computed, effect, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import type { Part, PartDetails } from "../service/service.ts";
import { around } from "../space/box.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { atLevel, chosenLevel, keepLevel, type Level, levelsOf, parentOf } from "./levels.ts";

/** The longest time and motion of a click: milliseconds and CSS pixels. */
const LONGEST = 400;
const FARTHEST = 4;

/** Identifies a part. */
type PartKey = Pick<Part, "kind" | "id" | "first" | "end">;

/** A picked part, with its details once the service has answered. */
interface Picked {
  readonly part: PartKey;
  readonly details: PartDetails | undefined;
}

export class Selection {
  /** The picked parts, in order. At least one object of each is still selected. */
  readonly #picked = signal<readonly Picked[]>([]);
  /** How many parts are picked. */
  readonly count = computed(() => this.#picked.value.length);
  /** The details of the last picked part that is still selected. */
  readonly details = computed(() => this.#picked.value.at(-1)?.details);
  /** The details of each. */
  readonly parts = computed(() => this.#picked.value.flatMap(({ details }) => details ?? []));
  /** The box around all picked parts. */
  readonly bounds = computed(() => around(this.parts.value));
  /** The levels that the model has. */
  readonly levels: readonly Level[];
  /** The level at which clicks pick. */
  readonly level = signal(chosenLevel());
  /** The part whose row in the tree is to get the focus. */
  readonly located = signal<PartDetails | undefined>(undefined);
  /** The last pick, until its details are there. */
  #adding: Promise<unknown> = Promise.resolve();
  /** The clicks that wait for the service, in their order. */
  #clicking = Promise.resolve();
  readonly #viewer: Viewer;
  /** Handles clicks instead of the selection, and returns whether it does. */
  readonly #clicks: (x: number, y: number) => boolean;

  constructor(viewer: Viewer, clicks: (x: number, y: number) => boolean) {
    [this.#viewer, this.#clicks] = [viewer, clicks];
    this.levels = levelsOf(viewer.scene);
    if (!this.levels.includes(this.level.peek())) {
      this.level.value = "Primitive";
    }
    this.#listen(viewer.canvas);
    effect(() => {
      if (viewer.selected.value.isEmpty) {
        [this.#picked.value, viewer.picksMore.value] = [[], false];
      }
    });
  }

  /** Picks only this part, and returns its details. */
  pick(part: PartKey): Promise<PartDetails | undefined> {
    this.#viewer.selected.value = objectsOf(part);
    return this.#add([], part);
  }

  /** Toggles whether a part is picked. */
  toggle(part: PartKey): void {
    const { selected } = this.#viewer;
    const objects = objectsOf(part);
    if (!selected.peek().covers(objects)) {
      selected.value = selected.peek().union(objects);
      void this.#add(this.#picked.peek(), part);
      return;
    }
    const left = selected.peek().minus(objects);
    selected.value = left;
    this.#picked.value = this.#picked.peek().filter(({ part }) => !left.isApartFrom(objectsOf(part)));
  }

  /** Picks like a click with these keys: only this part, or with Ctrl or Shift in addition. */
  click(part: PartKey, { ctrlKey, metaKey, shiftKey }: MouseEvent): void {
    const { selected, picksMore } = this.#viewer;
    const isPicked = selected.peek().covers(objectsOf(part));
    if (ctrlKey || metaKey || picksMore.peek() || (shiftKey && !isPicked)) {
      this.toggle(part);
    } else if (!shiftKey) {
      void this.pick(part);
    }
  }

  /** Picks at this level from now on, in this browser. */
  setLevel(level: Level): void {
    this.level.value = level;
    keepLevel(level);
  }

  /** Picks at the next larger level, or again at the smallest. */
  nextLevel(): void {
    const next = this.levels[this.levels.indexOf(this.level.peek()) + 1] ?? "Primitive";
    this.setLevel(next);
    this.#viewer.said.value = `A click picks at the level: ${next}.`;
  }

  /** Picks the group around the part that was picked last. */
  pickParent(): void {
    this.#then(async () => {
      await this.#adding;
      const details = this.details.peek();
      const parent = details && parentOf(details);
      if (parent !== undefined) {
        await this.pick(parent);
      } else if (details !== undefined) {
        this.#viewer.said.value = "There is no larger group around it.";
      }
    });
  }

  /** Shows the row of the part that was picked last, once the tree is open. */
  locate(): void {
    this.located.value = this.details.peek();
  }

  clear(): void {
    this.#viewer.selected.value = ObjectSet.EMPTY;
  }

  #listen(canvas: HTMLCanvasElement): void {
    let down: PointerEvent | undefined;
    canvas.addEventListener("pointerdown", (event) => {
      // A second finger makes no click.
      down = event.isPrimary && event.button === 0 ? event : undefined;
    });
    canvas.addEventListener("pointerup", (event) => {
      const isClick =
        down !== undefined &&
        event.timeStamp - down.timeStamp < LONGEST &&
        Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < FARTHEST;
      down = undefined;
      if (isClick) {
        this.#click(event);
      }
    });
  }

  #click(event: MouseEvent): void {
    if (this.#clicks(event.offsetX, event.offsetY)) {
      return;
    }
    const viewer = this.#viewer;
    const picked = viewer.pick(event.offsetX, event.offsetY);
    if (picked === undefined) {
      // A missed click with a modifier keeps the picked parts.
      if (!(event.ctrlKey || event.metaKey || event.shiftKey)) {
        this.clear();
      }
      return;
    }
    const { object, first, end } = picked;
    const part = { kind: "object", id: first, first, end: first + 1 } as const;
    if (event.altKey && viewer.selected.peek().has(first)) {
      this.pickParent();
    } else if (this.level.peek() === "Primitive" && object !== undefined) {
      this.click(part, event);
    } else {
      this.#then(() => this.#clickGroup(part, end, event));
    }
  }

  /** Picks the group of an object at the chosen level. It must have the objects up to `end` as well. */
  async #clickGroup(object: PartKey, end: number, event: MouseEvent): Promise<void> {
    const { service, said } = this.#viewer;
    const level = this.level.peek();
    try {
      const group = atLevel(await service.details(object), level);
      if (group.end < end) {
        said.value = "These are several objects: come nearer to pick one.";
      } else {
        this.click(group, event);
      }
    } catch (error) {
      said.value = messageOf(error);
    }
  }

  /** Does this after the clicks before. */
  #then(act: () => Promise<void>): void {
    this.#clicking = this.#clicking.then(act);
  }

  /** Picks a part in addition to others, and gets its details. */
  #add(others: readonly Picked[], part: PartKey): Promise<PartDetails | undefined> {
    const adding = this.#ask(others, part);
    this.#adding = adding;
    return adding;
  }

  async #ask(others: readonly Picked[], part: PartKey): Promise<PartDetails | undefined> {
    this.#picked.value = [...others, { part, details: undefined }];
    const { service, said } = this.#viewer;
    try {
      const details = await service.details(part);
      this.#picked.value = this.#picked.peek().map((one) => (one.part === part ? { part, details } : one));
      return details;
    } catch (error) {
      said.value = messageOf(error);
      return undefined;
    }
  }
}

function objectsOf({ first, end }: PartKey): ObjectSet {
  return ObjectSet.run(first, end);
}
