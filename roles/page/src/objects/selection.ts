/** The picked parts, and their details from the service. */

import { computed, effect, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import type { Part, PartDetails } from "../service/service.ts";
import { around } from "../space/box.ts";
import type { Viewer } from "../viewer/viewer.ts";

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
  readonly #viewer: Viewer;
  /** Handles clicks instead of the selection, and returns whether it does. */
  readonly #clicks: (x: number, y: number) => boolean;

  constructor(viewer: Viewer, clicks: (x: number, y: number) => boolean) {
    [this.#viewer, this.#clicks] = [viewer, clicks];
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
    const { object } = picked;
    if (object === undefined) {
      viewer.said.value = "These are several objects: come nearer to pick one.";
      return;
    }
    this.click({ kind: "object", id: object, first: object, end: object + 1 }, event);
  }

  /** Picks a part in addition to others, and gets its details. */
  async #add(others: readonly Picked[], part: PartKey): Promise<PartDetails | undefined> {
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
