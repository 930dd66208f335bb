/** The point that a person points at: snapped to what the picture shows, and then to full detail. */

import { signal } from "@preact/signals";
import type { Aim, Snapped } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { isCutAway } from "./sections.ts";
import { REACH, snap } from "./snap.ts";

/** A snapped point of the shown geometry, and the question for the same on full detail. */
export interface Meant {
  readonly shown: Snapped;
  readonly aim: Aim;
}

/** Follows the pointer over the picture. */
export class Pointed {
  /** The snapped point at the pointer. */
  readonly hover = signal<Snapped | undefined>(undefined);
  readonly #viewer: Viewer;
  #isDue = false;
  /** The next question for the point at the pointer; the service is asked one at a time. */
  #unasked: Meant | undefined;
  #isAsking = false;

  readonly #isOn: () => boolean;

  /** It follows while `isOn`. */
  constructor(viewer: Viewer, isOn: () => boolean) {
    [this.#viewer, this.#isOn] = [viewer, isOn];
    viewer.canvas.addEventListener("pointermove", ({ buttons }) => {
      if (buttons === 0) {
        this.update();
      }
    });
  }

  /** Finds the point at the pointer again: the pointer has moved, or the picture has changed. */
  update(): void {
    // A picture shows one marker, so one computation per picture is enough.
    if (!this.#isOn() || this.#isDue) {
      return;
    }
    this.#isDue = true;
    requestAnimationFrame(() => {
      this.#isDue = false;
      const { pointer } = this.#viewer;
      if (this.#isOn() && pointer !== undefined) {
        this.#unasked = meantAt(this.#viewer, pointer.x, pointer.y);
        this.hover.value = this.#unasked?.shown;
        void this.#follow();
      }
    });
  }

  /** Follows the pointer with questions, as long as it has moved. */
  async #follow(): Promise<void> {
    if (this.#isAsking) {
      return;
    }
    this.#isAsking = true;
    for (let meant = this.#unasked; meant !== undefined; meant = this.#unasked) {
      this.#unasked = undefined;
      const exact = await exactly(this.#viewer, meant.aim);
      if (exact !== undefined && this.hover.peek() === meant.shown) {
        this.hover.value = exact;
      }
    }
    this.#isAsking = false;
  }
}

/** The snapped point at a place of the canvas, in CSS pixels. */
export function meantAt(viewer: Viewer, x: number, y: number): Meant | undefined {
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

/** The snapped point on full detail; nothing if the service cannot tell. */
export async function exactly({ service, view }: Viewer, aim: Aim): Promise<Snapped | undefined> {
  const isHidden = ({ point }: Snapped) => isCutAway(view.current.peek().sections, point);
  try {
    const snapped = await service.snap(aim);
    // Geometry that a section has cut away is ignored.
    return snapped && isHidden(snapped) ? await service.snap({ ...aim, reach: aim.reach / 1000 }) : snapped;
  } catch {
    return undefined;
  }
}
