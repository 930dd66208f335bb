/** A list of the sections, and buttons to make them. */

import { useSignal } from "@preact/signals";
import { Button } from "../controls/button.tsx";
import type { Section } from "../proto/viewState.ts";
import type { Box } from "../space/box.ts";
import { beyond } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { AXES } from "./handles.ts";
import { boxAround, flipped, MOST, moved, planeFacing, replaced, resized } from "./sections.ts";

interface Properties {
  readonly viewer: Viewer;
  /** The box around the picked parts. */
  readonly bounds: Box | undefined;
}

export function SectionsPanel({ viewer, bounds }: Properties) {
  const { view, navigator, scene } = viewer;
  const { sections } = view.current.value;
  const add = (section: Section) => view.change({ sections: [...sections, section] });
  const set = (index: number, section: Section | undefined) =>
    view.change({ sections: replaced(sections, index, section) });
  const cutHere = () => {
    // Through the object in the middle of the picture.
    const picked = viewer.pick(viewer.canvas.clientWidth / 2, viewer.canvas.clientHeight / 2);
    const reach = picked === undefined ? 2 * scene.eyeHeight : picked.depth + scene.eyeHeight / 8;
    const { eye, forward } = navigator;
    add(planeFacing(beyond(eye, forward, reach), forward));
  };
  return (
    <section class="panel sections" aria-label="Sections">
      <div>
        <Button text="Plane ahead" disabled={sections.length >= MOST} onClick={cutHere} />
        <Button
          text="Box around"
          disabled={sections.length >= MOST || bounds === undefined}
          title="Around what is picked"
          onClick={() => bounds && add(boxAround(bounds))}
        />
      </div>
      <ol>
        {sections.map((section, index) => (
          <li key={index}>
            {section.kind === "plane" ? (
              <PlaneRow section={section} step={scene.eyeHeight / 17} set={(to) => set(index, to)} />
            ) : (
              <BoxRow section={section} step={scene.eyeHeight / 17} set={(to) => set(index, to)} />
            )}
            <Button
              text="×"
              aria-label={`Remove section ${index + 1}`}
              onClick={() => set(index, undefined)}
            />
          </li>
        ))}
      </ol>
    </section>
  );
}

interface RowProperties {
  readonly section: Section;
  readonly step: number;
  readonly set: (section: Section) => void;
}

function PlaneRow({ section, step, set }: RowProperties) {
  return (
    <span>
      Plane <Button text="−" aria-label="Cut away less" onClick={() => set(moved(section, step))} />
      <Button text="+" aria-label="Cut away more" onClick={() => set(moved(section, -step))} />
      <Button text="Flip" onClick={() => set(flipped(section))} />
    </span>
  );
}

function BoxRow({ section, step, set }: RowProperties) {
  const isOpen = useSignal(false);
  if (section.kind === "plane") {
    return null;
  }
  const side = (which: "lower" | "upper", axis: 0 | 1 | 2, name: string) => (
    <input
      type="number"
      step={step}
      value={Number(section[which][axis].toFixed(3))}
      aria-label={`${which} ${name} in metres`}
      onChange={(event) => set(resized(section, which, axis, event.currentTarget.valueAsNumber))}
    />
  );
  return (
    <span>
      <Button
        text={`Box ${isOpen.value ? "▾" : "▸"}`}
        aria-expanded={isOpen.value}
        onClick={() => {
          isOpen.value = !isOpen.value;
        }}
      />
      {isOpen.value &&
        AXES.map(([axis, name]) => (
          <span class="sides" key={axis}>
            {name} {side("lower", axis, name)} {side("upper", axis, name)}
          </span>
        ))}
    </span>
  );
}
