/** Explains why a part does not show after moving to it, and offers help. */

import type { Drawable } from "../draw/model.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { PartDetails } from "../service/service.ts";
import { type Box, centreOf, cornersOf } from "../space/box.ts";
import { dot, type Point, pointOf } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { show, visibility } from "./actions.ts";

type Part = Pick<PartDetails, "first" | "end" | "core">;

/** A part counts as hidden if less than this share of its pixels is visible. */
const SHOWN = 0.2;
/** The most layers to make see-through, one behind the other. */
const LAYERS = 8;
/** The timeout for an exact picture, milliseconds. */
const LONGEST = 10_000;

/**
 * Once the picture is exact, explains why a part does not show, and offers help. A moved eye or a changed view
 * ends that: the answer would be about another picture.
 */
export async function tellIfHidden(viewer: Viewer, part: Part): Promise<void> {
  const { view } = viewer;
  viewer.offer.value = undefined;
  const objects = ObjectSet.run(part.first, part.end);
  if (visibility(view.current.peek(), objects) === "none") {
    const run = () => view.change(show(view.current.peek(), objects));
    viewer.offer.value = { text: "It is hidden.", label: "Show it", run };
    return;
  }
  const asked = view.seen.peek();
  if (!(await becomesExact(viewer)) || view.seen.peek() !== asked || !isHidden(viewer, part)) {
    return;
  }
  if (!coverOf(viewer, part).isEmpty) {
    viewer.offer.value = {
      text: "Other parts are in front of it.",
      label: "See through them",
      run: () => void seeThroughTo(viewer, part),
    };
  } else if (view.current.peek().sections.length > 0) {
    const run = () => view.change({ sections: [] });
    viewer.offer.value = { text: "A section cuts it away.", label: "Remove sections", run };
  }
}

/** Makes everything in front of a part see-through, as one step of the history. */
async function seeThroughTo(viewer: Viewer, part: Part): Promise<void> {
  const { view } = viewer;
  const { seeThrough: before } = view.current.peek();
  let seeThrough = before;
  for (let layer = 0; layer < LAYERS && isHidden(viewer, part); layer += 1) {
    const next = seeThrough.union(coverOf(viewer, part));
    if (next.size === seeThrough.size) {
      break;
    }
    seeThrough = next;
    view.drag({ seeThrough });
    const isExact = await becomesExact(viewer);
    if (view.current.peek().seeThrough !== seeThrough) {
      // It was undone meanwhile, or changed by hand.
      return;
    }
    if (!isExact) {
      break;
    }
  }
  if (seeThrough !== before) {
    view.change({ seeThrough });
  }
}

/** Waits until the picture is exact. Returns whether it is, with the eye unmoved. */
export async function becomesExact(viewer: Viewer): Promise<boolean> {
  const { eye, forward } = viewer.navigator;
  const pose = [...eye, ...forward].join();
  // A change is only requested with the next picture.
  for (const begun = performance.now(); performance.now() - begun < LONGEST; ) {
    await new Promise((resolve) => setTimeout(resolve, 50));
    const { eye, forward } = viewer.navigator;
    if ([...eye, ...forward].join() !== pose) {
      return false;
    }
    if (viewer.isSettled) {
      return true;
    }
  }
  return false;
}

function isOf({ first, end }: Part, { object }: Pick<Drawable, "object">): boolean {
  return first <= object && object < end;
}

/** Whether little or nothing of a part is visible. */
function isHidden(viewer: Viewer, part: Part): boolean {
  const own = viewer.shown().filter((drawable) => isOf(part, drawable));
  const ids = new Set(own.map(({ id }) => id));
  const count = (items: Uint32Array) => items.reduce((sum, id) => sum + (ids.has(id) ? 1 : 0), 0);
  const { seeThrough } = viewer.look();
  const solid = viewer.shown().filter(({ object }) => ids.size > 0 && !seeThrough.has(object));
  const { camera, renderer } = viewer;
  const [alone, among] = [own, [...new Set([...solid, ...own])]].map((drawables) =>
    count(renderer.items(camera, drawables, viewer.look())),
  );
  return (among ?? 0) <= SHOWN * (alone ?? 0);
}

/** The visible objects in a part's place that are not behind its middle. */
function coverOf(viewer: Viewer, part: Part): ObjectSet {
  const { camera, canvas, renderer, navigator } = viewer;
  const { forward, eye } = navigator;
  const { seeThrough } = viewer.look();
  const solid = viewer.shown().filter(({ object }) => !seeThrough.has(object));
  const items = renderer.items(camera, solid, viewer.look());
  const met = new Set<number>();
  const { left, right, low, high } = rectangleOf(viewer, part.core);
  for (let y = low; y < high; y += 1) {
    for (let x = left; x < right; x += 1) {
      met.add(items[y * canvas.width + x] ?? 0);
    }
  }
  const depthOf = (point: Point) => dot(point, forward) - dot(eye, forward);
  const middle = depthOf(centreOf(part.core));
  const isBefore = ({ worldMin, worldMax }: Drawable) => {
    return depthOf(pointOf((axis) => (forward[axis] > 0 ? worldMin : worldMax)[axis])) < middle;
  };
  const cover = solid.filter((one) => met.has(one.id) && !isOf(part, one) && isBefore(one));
  return cover.reduce(
    (set, { object, objects }) => set.union(ObjectSet.run(object, object + objects)),
    ObjectSet.EMPTY,
  );
}

/** The pixels in which a box may show, rows from below. */
function rectangleOf({ canvas, projection, scale }: Viewer, box: Box) {
  const places = cornersOf(box).flatMap((corner) => projection.place(corner) ?? []);
  const [xs, ys] = [places.map(({ x }) => x * scale), places.map(({ y }) => canvas.height - y * scale)];
  return {
    left: Math.max(0, Math.floor(Math.min(...xs))),
    right: Math.min(canvas.width, Math.ceil(Math.max(...xs))),
    low: Math.max(0, Math.floor(Math.min(...ys))),
    high: Math.min(canvas.height, Math.ceil(Math.max(...ys))),
  };
}
