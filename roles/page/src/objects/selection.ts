/** The picked parts, and their details from the service. */

import { computed, effect, signal } from "@preact/signals";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import type { Part, PartDetails, Snapped } from "../service/service.ts";
import { around, type Box } from "../space/box.ts";
import type { PlantFrame } from "../space/plantFrame.ts";
import { exactly, type Meant, meantAt } from "../tools/pointed.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { atLevel, chosenLevel, keepLevel, type Level, levelsOf, parentOf } from "./levels.ts";

/** The longest time and motion of a click: milliseconds and CSS pixels. */
const LONGEST = 400;
const FARTHEST = 4;
/** How near to an object a click on the background picks it, CSS pixels: with the pointer, and by touch. */
const NEAR = 4;
const NEAR_BY_TOUCH = 8;

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
  /** The object that was clicked last, and where. */
  readonly #clicked = signal<{ readonly object: number; readonly point: Snapped } | undefined>(undefined);
  /** The point that was clicked last, snapped as in measuring; none unless its object is picked. */
  readonly point = computed(() => {
    const clicked = this.#clicked.value;
    return clicked && this.#viewer.selected.value.has(clicked.object) ? clicked.point : undefined;
  });
  /** The plant's coordinates. */
  readonly plant: PlantFrame;
  /** The box around objects that were picked without their parts. */
  readonly #box = signal<Box | undefined>(undefined);
  /** The box around all that is picked. */
  readonly bounds = computed(() => this.#box.value ?? around(this.parts.value));
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
    this.plant = viewer.scene.plant;
    this.levels = levelsOf(viewer.scene);
    if (!this.levels.includes(this.level.peek())) {
      this.level.value = "Primitive";
    }
    this.#listen(viewer.canvas);
    effect(() => {
      if (viewer.selected.value.isEmpty) {
        [this.#picked.value, viewer.picksMore.value] = [[], false];
        [this.#clicked.value, this.#box.value] = [undefined, undefined];
      }
    });
  }

  /** Picks only this part, and returns its details. */
  pick(part: PartKey): Promise<PartDetails | undefined> {
    this.#viewer.selected.value = objectsOf(part);
    return this.#add([], part);
  }

  /** Picks these objects, of whatever parts. `box` is the one around them, if it is known. */
  pickAll(objects: ObjectSet, box?: Box): void {
    [this.#picked.value, this.#box.value] = [[], box];
    this.#viewer.selected.value = objects;
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

  #click(event: PointerEvent): void {
    if (this.#clicks(event.offsetX, event.offsetY)) {
      return;
    }
    const viewer = this.#viewer;
    const reach = event.pointerType === "touch" ? NEAR_BY_TOUCH : NEAR;
    const place = viewer.meant(event.offsetX, event.offsetY, reach);
    const picked = place && viewer.pick(place.x, place.y);
    if (place === undefined || picked === undefined) {
      // A missed click with a modifier keeps the picked parts.
      if (!(event.ctrlKey || event.metaKey || event.shiftKey)) {
        this.clear();
      }
      return;
    }
    const meant = meantAt(viewer, place.x, place.y);
    if (picked.object !== undefined) {
      this.#clickObject(picked.object, meant, event);
    } else {
      this.#then(() => this.#clickAmong(meant, event));
    }
  }

  #clickObject(object: number, meant: Meant | undefined, event: MouseEvent): void {
    void this.#keepPoint(object, meant);
    const part = { kind: "object", id: object, first: object, end: object + 1 } as const;
    if (event.altKey && this.#viewer.selected.peek().has(object)) {
      this.pickParent();
    } else if (this.level.peek() === "Primitive") {
      this.click(part, event);
    } else {
      this.#then(() => this.#clickGroup(part, event));
    }
  }

  /** Clicks one of several objects that are drawn as one. The service knows which. */
  async #clickAmong(meant: Meant | undefined, event: MouseEvent): Promise<void> {
    const { service, said } = this.#viewer;
    try {
      const object = meant && (await service.objectAt(meant.aim));
      if (object === undefined) {
        said.value = "These are several objects: come nearer to pick one.";
      } else {
        this.#clickObject(object, meant, event);
      }
    } catch (error) {
      said.value = messageOf(error);
    }
  }

  /** Keeps the clicked point of an object, and then that of full detail. */
  async #keepPoint(object: number, meant: Meant | undefined): Promise<void> {
    this.#clicked.value = meant && { object, point: meant.shown };
    const exact = meant && (await exactly(this.#viewer, meant.aim));
    if (exact !== undefined && this.#clicked.peek()?.point === meant?.shown) {
      this.#clicked.value = { object, point: exact };
    }
  }

  /** Picks the group of an object at the chosen level. */
  async #clickGroup(object: PartKey, event: MouseEvent): Promise<void> {
    const { service, said } = this.#viewer;
    try {
      this.click(atLevel(await service.details(object), this.level.peek()), event);
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
    if (!objectsOf(part).has(this.#clicked.peek()?.object ?? -1)) {
      this.#clicked.value = undefined;
    }
    this.#picked.value = [...others, { part, details: undefined }];
    this.#box.value = undefined;
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
