/** A list of the distances. */

import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { CopyButton } from "../controls/copyButton.tsx";
import { minus } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { chooseUnit, lengthText, measuredText, UNITS, unit } from "./lengths.ts";
import type { Measuring } from "./measuring.ts";
import { measured } from "./snap.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly measuring: Measuring;
}

export function MeasurePanel({ viewer, measuring }: Properties) {
  return (
    <section class="panel sections" aria-label="Distances">
      <p>Click two points. The marker shows what is met: a vertex, an edge or a face. Escape takes back.</p>
      <Choice
        label="Unit"
        options={UNITS.map((value) => ({ value, text: value }))}
        value={unit.value}
        onChoose={chooseUnit}
      />
      <ol>
        {viewer.distances.value.map((one, index) => {
          const { from, to } = one;
          const { metres, error } = measured(one);
          const text = measuredText(metres, error, unit.value);
          const way = minus(to.point, from.point);
          const along = way.map((metres) => lengthText(Math.abs(metres), unit.value));
          return (
            <li key={index}>
              <strong>{text}</strong>
              <CopyButton text={text} label={`Copy distance ${index + 1}`} />
              <Button
                text="×"
                aria-label={`Remove distance ${index + 1}`}
                onClick={() => measuring.remove(one)}
              />
              <br />x {along[0]}, height {along[1]}, z {along[2]}
            </li>
          );
        })}
      </ol>
    </section>
  );
}
