/** What a person has picked, and what the service says of it. */

import { effect, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Part, PartDetails } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { messageOf } from "../wire/errors.ts";

/** A click is no longer, and moves no farther: milliseconds and CSS pixels. */
const LONGEST = 400;
const FARTHEST = 4;

export class Selection {
  /** What is known of the part that was picked last. */
  readonly details = signal<PartDetails | undefined>(undefined);
  readonly #viewer: Viewer;
  /** Takes clicks in place of the selection, and gives whether it does. */
  readonly #clicks: (x: number, y: number) => boolean;
  /** Counts questions: an answer to an old one is not for the part that is picked now. */
  #asked = 0;

  constructor(viewer: Viewer, clicks: (x: number, y: number) => boolean) {
    [this.#viewer, this.#clicks] = [viewer, clicks];
    this.#listen(viewer.canvas);
    effect(() => {
      if (viewer.selected.value.isEmpty) {
        this.#asked += 1;
        [this.details.value, viewer.picksMore.value] = [undefined, false];
      }
    });
  }

  /** Picks a part, and tells what it is. */
  async pick(part: Pick<Part, "kind" | "id" | "first" | "end">): Promise<PartDetails | undefined> {
    const { selected, service, said } = this.#viewer;
    selected.value = ObjectSet.run(part.first, part.end);
    this.#asked += 1;
    const asked = this.#asked;
    try {
      const details = await service.details(part);
      if (asked === this.#asked) {
        this.details.value = details;
      }
      return details;
    } catch (error) {
      said.value = messageOf(error);
      return undefined;
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
      this.clear();
      return;
    }
    const { object } = picked;
    if (object === undefined) {
      viewer.said.value = "These are several objects: come nearer to pick one.";
      return;
    }
    const one = ObjectSet.run(object, object + 1);
    if (event.ctrlKey || event.metaKey || viewer.picksMore.peek()) {
      const { selected } = viewer;
      selected.value = selected.value.covers(one) ? selected.value.minus(one) : selected.value.union(one);
    } else {
      void this.pick({ kind: "object", id: object, first: object, end: object + 1 });
    }
  }
}
