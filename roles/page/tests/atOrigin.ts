/** A navigator without a page. */

import { Navigator } from "../src/navigate/navigator.ts";
import type { SceneDescription } from "../src/service/service.ts";
import { cornersOf } from "../src/space/box.ts";

/** A navigator of an eye at the origin, its canvas, and the events of its window. */
export function navigatorAtOrigin(): { walker: Navigator; events: EventTarget; canvas: EventTarget } {
  const scope = globalThis as { addEventListener?: unknown };
  const canvas = Object.assign(new EventTarget(), { clientWidth: 800, clientHeight: 600 });
  const scene = {
    start: { eye: [0, 0, 0], forward: [0, 0, -1] },
    core: { min: [-1, -1, -1], max: [1, 1, 1] },
    outermost: cornersOf({ min: [-1, -1, -1], max: [1, 1, 1] }),
    hasFloors: false,
    eyeHeight: 1.7,
    tileSide: 16,
    vfovDeg: 60,
  } as unknown as SceneDescription;
  const events = new EventTarget();
  scope.addEventListener = events.addEventListener.bind(events);
  Object.defineProperty(globalThis, "navigator", { value: { getGamepads: () => [] }, configurable: true });
  const service = { tile: () => Promise.reject(new Error("nothing is fetched")) };
  return { walker: new Navigator(canvas as unknown as HTMLCanvasElement, scene, service), events, canvas };
}
