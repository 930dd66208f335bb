/** A button that shows the coordinates of picked parts and measured points, or hides them. */

import { signal } from "@preact/signals";
import { Button } from "../controls/button.tsx";

/** They take several lines of a panel, so they are shown to those who want them. */
export const areCoordinatesShown = signal(false);

export function CoordinatesButton() {
  return (
    <Button
      text="Coordinates"
      class="link"
      aria-expanded={areCoordinatesShown.value}
      onClick={() => {
        areCoordinatesShown.value = !areCoordinatesShown.value;
      }}
    />
  );
}
