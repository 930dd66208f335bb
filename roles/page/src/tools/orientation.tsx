/** A cube that shows the orientation, with the standard views, and the way back. */

import { useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { SIDES, type StandardView } from "../navigate/standardViews.ts";
import { isForControl } from "../navigate/typing.ts";
import { wayInPicture } from "../space/plantFrame.ts";
import { dot, type Point } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { useProjection } from "./useProjection.ts";

/** A command of navigation, as a button. */
export interface NavigationCommand {
  readonly label: string;
  /** The text on the button. */
  readonly sign: string;
  readonly key: string;
  readonly run: () => void;
  readonly isPossible: () => boolean;
}

interface Properties {
  readonly viewer: Viewer;
  /** Shows a standard view. */
  readonly look: (view: StandardView) => void;
  readonly commands: readonly NavigationCommand[];
  readonly views: readonly StandardView[];
}

export function Orientation({ viewer, look, commands, views }: Properties) {
  const isOpen = useSignal(false);
  const section = useRef<HTMLElement>(null);
  useLayoutEffect(() => {
    if (!isOpen.value) {
      return;
    }
    const press = (event: KeyboardEvent) => {
      if (event.key === "Escape" && !isForControl(event)) {
        // This Escape closes the list and does nothing else.
        event.stopPropagation();
        isOpen.value = false;
      }
    };
    const point = ({ target }: PointerEvent) => {
      if (target instanceof Node && !section.current?.contains(target)) {
        isOpen.value = false;
      }
    };
    addEventListener("keydown", press, { capture: true });
    addEventListener("pointerdown", point, { capture: true });
    return () => {
      removeEventListener("keydown", press, { capture: true });
      removeEventListener("pointerdown", point, { capture: true });
    };
  }, [isOpen.value]);
  return (
    <section class="orientation" aria-label="Orientation" ref={section}>
      <div class="compassed">
        <Compass viewer={viewer} />
        <Cube viewer={viewer} look={look} />
      </div>
      <div class="panel bar">
        {commands.map(({ label, sign, key, run, isPossible }) => (
          <Button
            text={sign}
            key={label}
            aria-label={label}
            title={`${label} (${key})`}
            disabled={!isPossible()}
            onClick={run}
          />
        ))}
        <Button
          text="▾"
          aria-label="Standard views"
          title="Standard views"
          aria-expanded={isOpen.value}
          onClick={() => {
            isOpen.value = !isOpen.value;
          }}
        />
      </div>
      {isOpen.value && (
        <fieldset class="panel standard" aria-label="Standard views">
          {views.map((view) => (
            <Button
              text={view.name}
              key={view.name}
              title={`${view.name} (${view.key})`}
              onClick={() => look(view)}
            />
          ))}
          <Button
            text="Parallel"
            title="Parallel lines, and the same scale everywhere (R)"
            aria-pressed={viewer.navigator.projection.value === "parallel"}
            onClick={() => viewer.navigator.toggleProjection()}
          />
        </fieldset>
      )}
    </section>
  );
}

/** Half of a side of the cube, in units of its picture. */
const HALF = 27;
/** A face seen at a flatter angle than this (its sine) is not drawn. */
const FLATTEST = 0.04;

/** The cube as it lies in the picture, without perspective. */
function Cube({ viewer, look }: Pick<Properties, "viewer" | "look">) {
  // It is drawn anew with each picture.
  useProjection(viewer);
  const [right, up, ahead] = viewer.navigator.axes;
  const flat = (way: Point): readonly [number, number] => [HALF * dot(way, right), -HALF * dot(way, up)];
  return (
    <svg class="cube" viewBox="-50 -50 100 100" aria-hidden="true">
      {SIDES.map((view) => {
        const { x, y, out } = faceOf(view);
        const facing = -dot(out, ahead);
        if (facing < FLATTEST) {
          return null;
        }
        const [[xx, xy], [yx, yy], [ox, oy]] = [flat(x), flat(y), flat(out)];
        const corner = (right: number, down: number) =>
          `${ox + right * xx + down * yx},${oy + right * xy + down * yy}`;
        return (
          // Keys and the buttons below do the same.
          <g key={view.name} data-name={view.name} onPointerUp={() => look(view)}>
            <title>{`${view.name} (${view.key})`}</title>
            <polygon
              points={[corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)].join(" ")}
              fill-opacity={0.8 + 0.2 * facing}
            />
            <text transform={`matrix(${[xx / HALF, xy / HALF, yx / HALF, yy / HALF, ox, oy].join()})`}>
              {view.name}
            </text>
          </g>
        );
      })}
    </svg>
  );
}

/** The distance of letters from the middle of the cube, in units of its picture. */
const AROUND = 56;
/** The letters of the plant's directions: east, north and up. */
const WAYS: readonly (readonly [letter: string, way: Point])[] = [
  ["N", [0, 1, 0]],
  ["E", [1, 0, 0]],
  ["S", [0, -1, 0]],
  ["W", [-1, 0, 0]],
  ["U", [0, 0, 1]],
];

/** The plant's directions around the cube's foot, and above it. */
function Compass({ viewer }: Pick<Properties, "viewer">) {
  useProjection(viewer);
  const { axes } = viewer.navigator;
  const placed = ([x, y, z]: Point): readonly [number, number] => {
    // The letters of the ground lie around the lower face.
    const way: Point = [AROUND * x, AROUND * y, AROUND * z - (z === 0 ? HALF : 0)];
    return wayInPicture(viewer.scene.plant, axes, way);
  };
  const [foot, north] = [placed([0, 0, -HALF / AROUND]), placed([0, 0.8, 0])];
  return (
    <svg class="compass" viewBox="-62 -62 124 124" aria-hidden="true">
      <line x1={foot[0]} y1={foot[1]} x2={north[0]} y2={north[1]} />
      {WAYS.map(([letter, way]) => {
        const [x, y] = placed(way);
        // One that leads to the eye or away from it would be on the cube.
        return Math.hypot(x, y) < HALF ? null : (
          <text class={letter} key={letter} x={x} y={y}>
            {letter}
          </text>
        );
      })}
    </svg>
  );
}

/** The directions of a face: to the right and down on it, and out of it. */
function faceOf({ forward: [x, y, z] }: StandardView): { x: Point; y: Point; out: Point } {
  const out: Point = [-x || 0, -y || 0, Math.round(-z) || 0];
  if (y !== 0) {
    // The back is at the top of the upper face, and at the bottom of the lower one.
    return { x: [1, 0, 0], y: [0, 0, y < 0 ? 1 : -1], out };
  }
  return { x: [out[2], 0, -out[0]], y: [0, -1, 0], out };
}
