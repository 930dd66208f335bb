/** A cube that shows the orientation, with the standard views, and the way back. */

import { useSignal } from "@preact/signals";
import { Button } from "../controls/button.tsx";
import { SIDES, type StandardView } from "../navigate/standardViews.ts";
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
  return (
    <section class="orientation" aria-label="Orientation">
      <Cube viewer={viewer} look={look} />
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
              fill-opacity={0.55 + 0.45 * facing}
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

/** The directions of a face: to the right and down on it, and out of it. */
function faceOf({ forward: [x, y, z] }: StandardView): { x: Point; y: Point; out: Point } {
  const out: Point = [-x || 0, -y || 0, Math.round(-z) || 0];
  if (y !== 0) {
    // The back is at the top of the upper face, and at the bottom of the lower one.
    return { x: [1, 0, 0], y: [0, 0, y < 0 ? 1 : -1], out };
  }
  return { x: [out[2], 0, -out[0]], y: [0, -1, 0], out };
}
