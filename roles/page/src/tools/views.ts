/** From the page's view to viewpoints, and back. */

import { distance } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import type { KeptViewpoint } from "./kept.ts";
import { decodeViewpoint, foreign, type Viewpoint } from "./viewpoint.ts";

/** The eye is still at a viewpoint if it is no farther from it than this: metres, and about radians. */
const STILL = 1e-6;

/** A viewpoint of the present pose and changes. */
export function viewpointOf({ scene, navigator, view }: Viewer): Viewpoint {
  const { eye, forward, vfovDeg } = navigator;
  const { name, fingerprint } = scene;
  const mode = navigator.mode.peek();
  return { scene: { name, fingerprint }, eye, forward, vfovDeg, mode, view: view.current.peek() };
}

/** Moves to a viewpoint of this scene. Its changes can be undone in one step. */
export function goTo({ navigator, view }: Viewer, viewpoint: Viewpoint): void {
  navigator.jumpTo(viewpoint);
  view.change(viewpoint.view);
}

/** Moves to the viewpoint in a link's address, if it has one; explains a failure. */
export function followLink(viewer: Viewer, address: URL): void {
  if (!address.hash.startsWith("#v=")) {
    return;
  }
  const viewpoint = decodeViewpoint(address.hash.slice(3));
  const why =
    viewpoint === undefined
      ? "it is cut short, or of another version of this page"
      : foreign(viewpoint, viewer.scene);
  if (viewpoint !== undefined && why === undefined) {
    goTo(viewer, viewpoint);
  } else {
    viewer.said.value = `The view in the address cannot be shown: ${why}.`;
  }
}

/** The name of the kept view that the eye is at; empty if it is at none. */
export function nameOfView({ navigator }: Viewer, kept: readonly KeptViewpoint[]): string {
  const { eye, forward } = navigator;
  const isHere = ({ viewpoint }: KeptViewpoint) => {
    return distance(viewpoint.eye, eye) <= STILL && distance(viewpoint.forward, forward) <= STILL;
  };
  return kept.filter(isHere).at(-1)?.name ?? "";
}
