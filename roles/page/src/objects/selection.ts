/** What a person has picked, and what the service says of it. */

import { computed, effect, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Part, PartDetails } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { messageOf } from "../wire/errors.ts";

/** A click is no longer, and moves no farther: milliseconds and CSS pixels. */
const LONGEST = 400;
const FARTHEST = 4;

/** Which part is meant. */
type PartKey = Pick<Part, "kind" | "id" | "first" | "end">;

/** Where parts are. */
export type Bounds = Pick<PartDetails, "min" | "max">;

/** A part that was picked, and what is known of it once the service has answered. */
interface Picked {
  readonly part: PartKey;
  readonly details: PartDetails | undefined;
}

export class Selection {
  /** What was picked, in order. Of each some object is still selected. */
  readonly #picked = signal<readonly Picked[]>([]);
  /** How many parts are picked. */
  readonly count = computed(() => this.#picked.value.length);
  /** What is known of the part that was picked last, of those that still are. */
  readonly details = computed(() => this.#picked.value.at(-1)?.details);
  /** What is known of each. */
  readonly parts = computed(() => this.#picked.value.flatMap(({ details }) => details ?? []));
  /** The box around all that is picked. */
  readonly bounds = computed(() => around(this.parts.value));
  readonly #viewer: Viewer;
  /** Takes clicks in place of the selection, and gives whether it does. */
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

  /** Picks a part alone, and tells what it is. */
  pick(part: PartKey): Promise<PartDetails | undefined> {
    this.#viewer.selected.value = objectsOf(part);
    return this.#add([], part);
  }

  /** Picks one part more, or where it is picked, no longer. */
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

  /** Picks as a click with these keys does: alone, or with Ctrl or Shift beside what is picked. */
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
      // Who adds to what is picked, and misses, loses nothing.
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

  /** Picks a part beside others, and asks what it is. */
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

/** The box around parts; nothing where there is none. */
export function around(parts: readonly Bounds[]): Bounds | undefined {
  const side = (of: "min" | "max", axis: 0 | 1 | 2) => Math[of](...parts.map((part) => part[of][axis]));
  const corner = (of: "min" | "max") => [side(of, 0), side(of, 1), side(of, 2)] as const;
  return parts.length === 0 ? undefined : { min: corner("min"), max: corner("max") };
}
