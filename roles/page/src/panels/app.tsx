/** All that is beside the picture. */

import { computed } from "@preact/signals";
import { render } from "preact";
import type { Viewer } from "../viewer/viewer.ts";

/** Shows the panels of `viewer` in `place`. */
export function showPanels(place: HTMLElement, viewer: Viewer): void {
  render(<App viewer={viewer} />, place);
}

function App({ viewer }: { readonly viewer: Viewer }) {
  const status = computed(() => viewer.session.trouble.value || viewer.said.value);
  return (
    <p id="status" role="status">
      {status}
    </p>
  );
}
