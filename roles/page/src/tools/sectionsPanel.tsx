/** A list of the sections, and buttons to make them. */

import { useSignal } from "@preact/signals";
import { Button } from "../controls/button.tsx";
import { CopyButton } from "../controls/copyButton.tsx";
import { Quantities } from "../controls/quantities.tsx";
import type { Section } from "../proto/viewState.ts";
import type { Box } from "../space/box.ts";
import type { PlantFrame } from "../space/plantFrame.ts";
import { beyond } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { rangeTexts } from "./coordinates.ts";
import { type BoxFace, facesOf, planeText } from "./faces.ts";
import { unit } from "./lengths.ts";
import { boxAround, flipped, MOST, moved, planeFacing, replaced, resized } from "./sections.ts";
import { UnitChoice } from "./unitChoice.tsx";

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
    const { eye, forward, focus, projection } = navigator;
    const free = projection.peek() === "parallel" ? focus : beyond(eye, forward, 2 * scene.eyeHeight);
    const met = picked && beyond(eye, forward, picked.depth + scene.eyeHeight / 8);
    add(planeFacing(met ?? free, forward));
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
      {sections.length > 0 && <UnitChoice />}
      <ol>
        {sections.map((section, index) => (
          <li key={index}>
            {section.kind === "plane" ? (
              <PlaneRow
                section={section}
                plant={scene.plant}
                step={scene.eyeHeight / 17}
                set={(to) => set(index, to)}
              />
            ) : (
              <BoxRow
                section={section}
                plant={scene.plant}
                step={scene.eyeHeight / 17}
                set={(to) => set(index, to)}
              />
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
  readonly plant: PlantFrame;
  readonly step: number;
  readonly set: (section: Section) => void;
}

function PlaneRow({ section, plant, step, set }: RowProperties) {
  const place = planeText(plant, section, unit.value);
  return (
    <span>
      Plane <Button text="−" aria-label="Cut away less" onClick={() => set(moved(section, step))} />
      <Button text="+" aria-label="Cut away more" onClick={() => set(moved(section, -step))} />
      <Button text="Flip" onClick={() => set(flipped(section))} />
      <br />
      <span class="place">
        <Quantities text={place} />
      </span>{" "}
      <CopyButton text={place} label="Copy plane" />
    </span>
  );
}

function BoxRow({ section, plant, step, set }: RowProperties) {
  const isOpen = useSignal(false);
  if (section.kind === "plane") {
    return null;
  }
  const isMm = unit.value === "mm";
  const side = ({ name, side, axis, at, atOf }: BoxFace) => (
    <input
      type="number"
      step={isMm ? Math.round(1000 * step) : step}
      value={isMm ? Math.round(1000 * at) : Number(at.toFixed(3))}
      aria-label={`${name} in ${isMm ? "millimetres" : "metres"}`}
      onChange={(event) => {
        const metres = event.currentTarget.valueAsNumber / (isMm ? 1000 : 1);
        set(resized(section, side, axis, atOf(metres)));
      }}
    />
  );
  const box = { min: section.lower, max: section.upper };
  const ranges = rangeTexts(plant, box, unit.value).join(", ");
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
        facesOf(plant, section).map(({ letter, low, high }) => (
          <span class="sides" key={letter}>
            {letter} {side(low)} {side(high)}
          </span>
        ))}
      <br />
      <span class="place">
        <Quantities text={ranges} />
      </span>{" "}
      <CopyButton text={ranges} label="Copy box of section" />
    </span>
  );
}
