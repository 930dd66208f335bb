/** Where the eye is and what it sees, in the plant's coordinates, and the way to others. */

import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { CopyButton } from "../controls/copyButton.tsx";
import { Quantities } from "../controls/quantities.tsx";
import { becomesExact } from "../objects/reveal.ts";
import type { Selection } from "../objects/selection.ts";
import type { Snapped } from "../service/service.ts";
import { type Box, sizeOf } from "../space/box.ts";
import { toScene } from "../space/plantFrame.ts";
import { distance, type Point, pointOf } from "../space/point.ts";
import { errorText, gazeText, placeText, rangeTexts } from "../tools/coordinates.ts";
import { CoordinatesError, coordinatesOf, EXAMPLE } from "../tools/coordinatesInput.ts";
import { lengthText, unit } from "../tools/lengths.ts";
import { Marker } from "../tools/measureOverlay.tsx";
import { exactly, meantAt, Pointed } from "../tools/pointed.ts";
import { UnitChoice } from "../tools/unitChoice.tsx";
import { useProjection } from "../tools/useProjection.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** Milliseconds after the last picture until its points are found. */
const REST = 200;
/** A point this much nearer than another one covers it: a share of the picture's height there. */
const COVERED = 0.01;

/** The point that the person has gone to. */
const target = signal<Point | undefined>(undefined);
/** The point at the pointer, once the panel was open. */
let pointed: Pointed | undefined;
/** Whether the panel is open. */
const isOpen = signal(false);

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function WherePanel({ viewer, selection }: Properties) {
  const { navigator } = viewer;
  const { plant } = viewer.scene;
  const middle = useMiddle(viewer);
  const pointed = pointedOf(viewer);
  const { hover } = pointed;
  // It is told anew with each picture.
  const { eye } = useProjection(viewer);
  useEffect(() => {
    isOpen.value = true;
    const leave = onRest(viewer, () => pointed.update());
    return () => {
      leave();
      [isOpen.value, hover.value, target.value] = [false, undefined, undefined];
    };
  }, [viewer, pointed, hover]);
  return (
    <section class="where" aria-label="Where">
      <UnitChoice />
      {navigator.projection.value === "perspective" ? (
        <PlaceRow name="eye" text={placeText(plant, eye, unit.value)} />
      ) : (
        // The eye is far away from all that it shows.
        <PlaceRow name="plane" text={placeText(plant, navigator.focus, unit.value)} />
      )}
      <p>looks {gazeText(plant, navigator.forward)}</p>
      <SnappedRow name="pointer" viewer={viewer} snapped={hover.value} />
      <SnappedRow name="middle" viewer={viewer} snapped={middle} />
      <SnappedRow name="picked" viewer={viewer} snapped={selection.point.value} />
      <GoTo viewer={viewer} />
    </section>
  );
}

/** The markers of the point gone to, and of the one at the pointer. */
export function WhereOverlay({ viewer }: { readonly viewer: Viewer }) {
  const projection = useProjection(viewer);
  const hover = pointedOf(viewer).hover.value;
  const place = target.value && projection.place(target.value);
  return (
    <svg class="overlay" aria-hidden="true">
      {place && (
        <path
          class="target"
          d={`M${place.x - 12} ${place.y}h24M${place.x} ${place.y - 12}v24M${place.x - 6} ${place.y}a6 6 0 1 0 12 0a6 6 0 1 0 -12 0`}
        />
      )}
      <Marker snapped={hover} place={hover && projection.place(hover.point)} />
    </svg>
  );
}

function pointedOf(viewer: Viewer): Pointed {
  pointed ??= new Pointed(viewer, () => isOpen.peek());
  return pointed;
}

function PlaceRow({
  name,
  text,
  more = "",
}: {
  readonly name: string;
  readonly text: string;
  readonly more?: string;
}) {
  return (
    <p data-name={name}>
      {name}{" "}
      <span>
        <Quantities text={text + more} />
      </span>{" "}
      <CopyButton text={text} label={`Copy ${name}`} />
    </p>
  );
}

/** A point of the surface; a line without one if there is none. */
function SnappedRow({
  name,
  viewer,
  snapped,
}: {
  readonly name: string;
  readonly viewer: Viewer;
  readonly snapped: Snapped | undefined;
}) {
  if (snapped === undefined) {
    return (
      <p data-name={name}>
        {name} <span>–</span>
      </p>
    );
  }
  const text = placeText(viewer.scene.plant, snapped.point, unit.value);
  return <PlaceRow name={name} text={text} more={`${errorText(snapped, unit.value)} (${snapped.to})`} />;
}

/** The point in the middle of the picture, once the eye rests. */
function useMiddle(viewer: Viewer): Snapped | undefined {
  const middle = useSignal<Snapped | undefined>(undefined);
  useEffect(
    () =>
      onRest(viewer, async () => {
        const { clientWidth, clientHeight } = viewer.canvas;
        const meant = meantAt(viewer, clientWidth / 2, clientHeight / 2);
        const shown = meant?.shown;
        middle.value = shown;
        const exact = meant && (await exactly(viewer, meant.aim));
        if (exact !== undefined && middle.peek() === shown) {
          middle.value = exact;
        }
      }),
    [viewer],
  );
  return middle.value;
}

/** Calls `run` once no picture has followed another one for a while, until the returned function is called. */
function onRest(viewer: Viewer, run: () => unknown): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const leave = viewer.onPicture(() => {
    clearTimeout(timer);
    timer = setTimeout(run, REST);
  });
  return () => {
    clearTimeout(timer);
    leave();
  };
}

/** How far from a point that was asked for the eye stays, in heights of the eye. */
const STEPS_AWAY = 4;

/** A field for coordinates, and the way there. */
function GoTo({ viewer }: { readonly viewer: Viewer }) {
  const text = useSignal("");
  const fault = useSignal("");
  const go = () => {
    try {
      fault.value = "";
      goToPoint(viewer, coordinatesOf(text.value, unit.value));
      viewer.canvas.focus({ preventScroll: true });
    } catch (error) {
      if (!(error instanceof CoordinatesError)) {
        throw error;
      }
      fault.value = error.message;
    }
  };
  return (
    <>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          go();
        }}
      >
        <input
          value={text.value}
          placeholder={EXAMPLE}
          aria-label="Go to coordinates"
          autocomplete="off"
          enterkeyhint="go"
          onInput={(event) => {
            text.value = event.currentTarget.value;
          }}
          onKeyDown={({ key }) => {
            if (key === "Escape") {
              viewer.canvas.focus({ preventScroll: true });
            }
          }}
        />
        <Button text="Go" type="submit" />
      </form>
      {fault.value && <p role="alert">{fault.value}</p>}
    </>
  );
}

/**
 * Moves to a view of the point of these coordinates, from the present side and a few steps away. Throws a
 * `CoordinatesError` if it is far outside of the model.
 */
function goToPoint(viewer: Viewer, coordinates: Point): void {
  const { scene, navigator } = viewer;
  const point = toScene(scene.plant, coordinates);
  const outside = distance(point, within(scene, point));
  if (outside > Math.hypot(...sizeOf(scene))) {
    const extent = rangeTexts(scene.plant, scene, unit.value).join(", ");
    throw new CoordinatesError(
      `That is ${lengthText(outside, unit.value)} outside of the model, which has ${extent}.`,
    );
  }
  target.value = point;
  navigator.lookAt(point, STEPS_AWAY * scene.eyeHeight);
  if (outside > 0) {
    viewer.said.value = `The point is ${lengthText(outside, unit.value)} outside of the model.`;
  } else {
    void tellIfCovered(viewer, point);
  }
}

/** The point of a box that is nearest to another point. */
function within({ min, max }: Box, point: Point): Point {
  return pointOf((axis) => Math.min(max[axis], Math.max(min[axis], point[axis])));
}

/** Tells the person if something is in front of the point. */
async function tellIfCovered(viewer: Viewer, point: Point): Promise<void> {
  if (!(await becomesExact(viewer))) {
    return;
  }
  const { pictured } = viewer;
  const place = pictured.place(point);
  const picked = place && viewer.pick(place.x, place.y);
  if (picked && place.depth - picked.depth > COVERED * pictured.heightAt(place.depth)) {
    viewer.said.value = "Something is in front of the point.";
  }
}
