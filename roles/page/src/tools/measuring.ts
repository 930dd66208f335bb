/** Distances between points that a person picks. */

import { signal } from "@preact/signals";
import type { Aim, Snapped } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import type { Distance } from "../viewer/viewHistory.ts";
import { isCutAway } from "./sections.ts";
import { REACH, snap } from "./snap.ts";

/** A snapped point of the shown geometry, and the question for the same on full detail. */
interface Meant {
  readonly shown: Snapped;
  readonly aim: Aim;
}

export class Measuring {
  /** Whether clicks pick points instead of objects. */
  readonly isOn = signal(false);
  /** The first picked point, until there is a second one. */
  readonly start = signal<Snapped | undefined>(undefined);
  /** The snapped point at the pointer. */
  readonly hover = signal<Snapped | undefined>(undefined);
  readonly #viewer: Viewer;
  #isDue = false;
  /** The next question for the point at the pointer; the service is asked one at a time. */
  #unasked: Meant | undefined;
  #isAsking = false;

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
    viewer.canvas.addEventListener("pointermove", (event) => {
      // A picture shows one marker, so one computation per picture is enough.
      if (this.isOn.peek() && event.buttons === 0 && !this.#isDue) {
        this.#isDue = true;
        requestAnimationFrame(() => {
          this.#isDue = false;
          if (this.isOn.peek()) {
            this.#unasked = this.#at(event.offsetX, event.offsetY);
            this.hover.value = this.#unasked?.shown;
            void this.#follow();
          }
        });
      }
    });
  }

  toggle(): void {
    this.isOn.value = !this.isOn.value;
    [this.start.value, this.hover.value] = [undefined, undefined];
  }

  /** Picks a point: every second one ends a distance. On the background it picks none. */
  pick(x: number, y: number): void {
    const meant = this.#at(x, y);
    if (meant === undefined) {
      return;
    }
    const start = this.start.peek();
    if (start === undefined) {
      this.start.value = meant.shown;
    } else {
      this.#set([...this.#viewer.distances.peek(), { from: start, to: meant.shown }]);
      this.start.value = undefined;
    }
    void this.#settle(meant);
  }

  /** Undoes the first point of a distance. Returns whether there was one. */
  takeBack(): boolean {
    const hadOne = this.start.peek() !== undefined;
    this.start.value = undefined;
    return hadOne;
  }

  remove(distance: Distance): void {
    this.#set(this.#viewer.distances.peek().filter((one) => one !== distance));
  }

  #set(distances: readonly Distance[]): void {
    this.#viewer.view.change({ distances });
  }

  /** The snapped point at a place of the canvas, in CSS pixels. */
  #at(x: number, y: number): Meant | undefined {
    const viewer = this.#viewer;
    const { canvas, pictured } = viewer;
    const picked = viewer.pick(x, y);
    const drawable = viewer.display?.shown?.drawables.find(({ id }) => id === picked?.drawable);
    const triangles = drawable && viewer.renderer.triangles(drawable.geometry);
    if (picked === undefined || drawable === undefined || triangles === undefined) {
      return undefined;
    }
    const place = { x, y, depth: picked.depth };
    const metres = pictured.metresEach(picked.depth);
    // The error of an exact picture's levels. That of stand-ins is unknown.
    const pixel = (metres * canvas.clientHeight) / canvas.height;
    const error = viewer.isExact ? viewer.errorPx * pixel : undefined;
    return {
      shown: { ...snap(place, drawable, triangles, pictured), error },
      aim: {
        drawable: drawable.id,
        eye: pictured.eye,
        at: pictured.point(place),
        reach: REACH * metres,
      },
    };
  }

  /** Follows the pointer with questions, as long as it has moved. */
  async #follow(): Promise<void> {
    if (this.#isAsking) {
      return;
    }
    this.#isAsking = true;
    for (let meant = this.#unasked; meant !== undefined; meant = this.#unasked) {
      this.#unasked = undefined;
      const exact = await this.#exact(meant.aim);
      if (exact !== undefined && this.hover.peek() === meant.shown) {
        this.hover.value = exact;
      }
    }
    this.#isAsking = false;
  }

  /** Replaces a picked point by the one of full detail. */
  async #settle({ shown, aim }: Meant): Promise<void> {
    const exact = await this.#exact(aim);
    if (exact === undefined) {
      return;
    }
    if (this.start.peek() === shown) {
      this.start.value = exact;
    }
    const settled = <End>(end: End) => (Object.is(end, shown) ? exact : end);
    this.#viewer.view.amend(({ distances }) => ({
      distances: distances.map((one) =>
        one.from === shown || one.to === shown ? { from: settled(one.from), to: settled(one.to) } : one,
      ),
    }));
  }

  /** The snapped point on full detail; nothing if the service cannot tell. */
  async #exact(aim: Aim): Promise<Snapped | undefined> {
    const { service, view } = this.#viewer;
    const isHidden = ({ point }: Snapped) => isCutAway(view.current.peek().sections, point);
    try {
      const snapped = await service.snap(aim);
      // Geometry that a section has cut away is ignored.
      return snapped && isHidden(snapped) ? await service.snap({ ...aim, reach: aim.reach / 1000 }) : snapped;
    } catch {
      return undefined;
    }
  }
}
