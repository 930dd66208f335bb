/** Measures of points that a person picks. */

import { computed, signal } from "@preact/signals";
import type { Aim, Snapped, Surface } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import type { Distance } from "../viewer/viewHistory.ts";
import type { Spot } from "./dimensions.ts";
import { FEWEST, MEASURES, type Measure, perpendicular } from "./measures.ts";
import { exactly, type Meant, meantAt, Pointed } from "./pointed.ts";
import { REACH } from "./snap.ts";

/** A second click on a point is this near to it, CSS pixels. */
const SAME = 4;

/** A measure that is no distance. */
export type Finding =
  | { readonly kind: "angle"; readonly ends: readonly [Snapped, Snapped, Snapped] }
  | { readonly kind: "polygon"; readonly corners: readonly Snapped[] }
  | ({ readonly kind: "surface" } & Surface);

export class Measuring {
  /** Whether clicks pick points instead of objects. */
  readonly isOn = signal(false);
  /** The chosen measure. */
  readonly measure = signal<Measure>("points");
  /** Whether it takes points of the picture. */
  readonly takesPoints = computed(() => this.isOn.value && this.measure.value !== "parts");
  /** The picked points, until there are enough. */
  readonly #ends = signal<readonly Snapped[]>([]);
  /** The last of them. */
  readonly start = computed(() => this.#ends.value.at(-1));
  /** The corners of the polygon that is being picked. */
  readonly corners = computed(() => (this.measure.value === "polygon" ? this.#ends.value : []));
  /** The snapped point at the pointer. */
  readonly hover;
  /** Angles, surfaces and polygons. A view has only distances. */
  readonly findings = signal<readonly Finding[]>([]);
  readonly #viewer: Viewer;
  /** Whether the last point was picked by the keyboard. */
  #isByKey = false;
  /** The picked points on full detail, in their order. */
  #settling: Promise<Snapped>[] = [];

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
    this.hover = new Pointed(viewer, () => this.takesPoints.peek()).hover;
  }

  toggle(): void {
    this.isOn.value = !this.isOn.value;
    this.#forget();
  }

  /** Measures this from now on. */
  choose(measure: Measure): void {
    this.measure.value = measure;
    this.#forget();
  }

  /**
   * Picks a point, unless parts are picked; on the background it picks none. `isByKey` says that there was no
   * click. Returns whether it does.
   */
  pick(x: number, y: number, isByKey = false): boolean {
    if (!this.takesPoints.peek()) {
      return false;
    }
    this.#isByKey = isByKey;
    const meant = meantAt(this.#viewer, x, y);
    const measure = this.measure.peek();
    if (this.#closes(x, y, meant?.shown)) {
      this.closePolygon();
      return true;
    }
    if (meant === undefined) {
      return true;
    }
    if (measure === "surface") {
      void this.#measureSurface(meant.aim);
      return true;
    }
    const ends = [...this.#ends.peek(), meant.shown];
    this.#settling = [...this.#settling.slice(0, ends.length - 1), this.#settle(meant)];
    if (ends.length < MEASURES[measure].points) {
      this.#ends.value = ends;
      return true;
    }
    const settling = this.#settling;
    this.#forget();
    const [from, to] = ends;
    if (measure === "points" && from && to) {
      this.#add({ from, to });
      // They may have settled meanwhile.
      void Promise.all(settling).then(([exactFrom, exactTo]) => {
        this.#viewer.view.amend(({ distances }) => ({
          distances: distances.map((one) =>
            one.from === from && one.to === to && exactFrom && exactTo
              ? { from: exactFrom, to: exactTo }
              : one,
          ),
        }));
      });
    } else {
      void this.#finish(measure, settling);
    }
    return true;
  }

  /**
   * The key Enter: closes the polygon whose corners were clicked. Otherwise it picks the point at the
   * crosshair, if that shows. Returns whether there is something to do.
   */
  enter(): boolean {
    if (!this.#isByKey && this.corners.peek().length > 0) {
      return this.closePolygon();
    }
    const { canvas, said } = this.#viewer;
    if (!this.takesPoints.peek() || !canvas.matches(":focus-visible")) {
      return false;
    }
    const [x, y] = [canvas.clientWidth / 2, canvas.clientHeight / 2];
    if (this.#viewer.pick(x, y) === undefined) {
      said.value = "There is nothing at the crosshair.";
    }
    this.hover.value = undefined;
    return this.pick(x, y, true);
  }

  /** Measures the polygon of the picked corners. Returns whether there are any. */
  closePolygon(): boolean {
    const count = this.corners.peek().length;
    if (count >= FEWEST) {
      // Corners may have been taken back.
      const settling = this.#settling.slice(0, count);
      this.#forget();
      void this.#finish("polygon", settling);
    } else if (count > 0) {
      this.#viewer.said.value = "A polygon has at least three corners.";
    }
    return count > 0;
  }

  /** Undoes the last point of a measure that lacks some. Returns whether there was one. */
  takeBack(): boolean {
    const hadOne = this.start.peek() !== undefined;
    this.#ends.value = this.#ends.peek().slice(0, -1);
    return hadOne;
  }

  remove(distance: Distance): void {
    this.#set(this.#viewer.distances.peek().filter((one) => one !== distance));
  }

  drop(finding: Finding): void {
    this.findings.value = this.findings.peek().filter((one) => one !== finding);
  }

  /** Removes all measures. */
  clear(): void {
    this.#forget();
    this.findings.value = [];
    if (this.#viewer.distances.peek().length > 0) {
      this.#set([]);
    }
  }

  /** Whether a click closes the polygon: it is on the first corner, or once more on the last one. */
  #closes(x: number, y: number, shown: Snapped | undefined): boolean {
    const { pictured } = this.#viewer;
    const corners = this.corners.peek();
    const [first, last, again] = [corners[0], corners.at(-1), shown].map((one) => {
      return one && pictured.place(one.point);
    });
    const isNear = (a: Spot, b: Spot, reach: number) => Math.hypot(a.x - b.x, a.y - b.y) < reach;
    return (
      (first !== undefined && corners.length >= FEWEST && isNear(first, { x, y }, REACH)) ||
      (last !== undefined && again !== undefined && isNear(last, again, SAME))
    );
  }

  #forget(): void {
    [this.#ends.value, this.hover.value] = [[], undefined];
    this.#settling = [];
  }

  #add(distance: Distance): void {
    this.#set([...this.#viewer.distances.peek(), distance]);
  }

  #set(distances: readonly Distance[]): void {
    this.#viewer.view.change({ distances });
  }

  /** Measures what takes points of full detail. */
  async #finish(measure: Measure, settling: readonly Promise<Snapped>[]): Promise<void> {
    const ends = await Promise.all(settling);
    const [a, b, c] = ends;
    if (measure === "polygon") {
      this.findings.value = [...this.findings.peek(), { kind: "polygon", corners: ends }];
    } else if (measure === "angle" && a && b && c) {
      this.findings.value = [...this.findings.peek(), { kind: "angle", ends: [a, b, c] }];
    } else if (a && b) {
      const distance = perpendicular(a, b);
      if (distance !== undefined) {
        this.#add(distance);
      } else {
        this.#viewer.said.value = "The service does not say how the face lies: nothing is measured.";
      }
    }
  }

  async #measureSurface(aim: Aim): Promise<void> {
    try {
      const surface = await this.#viewer.service.surface(aim);
      if (surface !== undefined) {
        this.findings.value = [...this.findings.peek(), { kind: "surface", ...surface }];
        return;
      }
    } catch {
      // The same as no answer.
    }
    this.#viewer.said.value = "The service does not know the surface there: nothing is measured.";
  }

  /** The picked point on full detail, which takes the place of the shown one. */
  async #settle({ shown, aim }: Meant): Promise<Snapped> {
    const exact = (await exactly(this.#viewer, aim)) ?? shown;
    this.#ends.value = this.#ends.peek().map((end) => (end === shown ? exact : end));
    return exact;
  }
}
