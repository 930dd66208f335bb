/** The progress of cooking, before there is a scene. */

import { render } from "preact";
import type { Cooking } from "../service/service.ts";

/** Shows how far cooking is, in `place`. */
export function showCooking(place: HTMLElement, { stage, done, total }: Cooking): void {
  const count = (number: number) => number.toLocaleString("en");
  render(
    <div class="panel notice">
      <p id="status" role="status">
        The model is being prepared for the first time: {stage}
      </p>
      <progress max={total || undefined} value={total > 0 ? done : undefined} aria-label={stage} />
      <p>{total > 0 ? `${count(done)} of ${count(total)}` : " "}</p>
    </div>,
    place,
  );
}
