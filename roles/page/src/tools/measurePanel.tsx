/** The choice of a measure, and a list of the measures. */

import type { ComponentChildren } from "preact";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { CopyButton } from "../controls/copyButton.tsx";
import { Quantities } from "../controls/quantities.tsx";
import { minus } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { errorText, placeText, wayText } from "./coordinates.ts";
import { areCoordinatesShown, CoordinatesButton } from "./coordinatesButton.tsx";
import { lengthText, measuredText, type Unit, unit } from "./lengths.ts";
import { angleAt, angleError, FEWEST, MEASURES, type Measure } from "./measures.ts";
import type { Finding, Measuring } from "./measuring.ts";
import { areaText, polygonTexts } from "./polygons.ts";
import { measured } from "./snap.ts";
import { UnitChoice } from "./unitChoice.tsx";

interface Properties {
  readonly viewer: Viewer;
  readonly measuring: Measuring;
  /** Measures the distance between parts. */
  readonly children: ComponentChildren;
}

const ALL = Object.keys(MEASURES) as Measure[];

export function MeasurePanel({ viewer, measuring, children }: Properties) {
  const measure = measuring.measure.value;
  const hasMeasures = viewer.distances.value.length + measuring.findings.value.length > 0;
  return (
    <section class="panel sections" aria-label="Distances">
      <Choice
        label="What is measured"
        options={ALL.map((value) => ({ value, text: MEASURES[value].text }))}
        value={measure}
        onChoose={(chosen) => measuring.choose(chosen)}
      />
      <p>
        {MEASURES[measure].hint}
        {measure !== "parts" &&
          " The marker shows what is met: a vertex, an edge or a face. Escape takes back."}
      </p>
      {measure === "polygon" && (
        <Button
          text="Close the polygon"
          disabled={measuring.corners.value.length < FEWEST}
          onClick={() => measuring.closePolygon()}
        />
      )}
      {measure === "parts" && children}
      <UnitChoice />
      {viewer.distances.value.length > 0 && <CoordinatesButton />}
      {hasMeasures && <Button text="Clear" title="Remove all measures" onClick={() => measuring.clear()} />}
      <ol>
        {viewer.distances.value.map((one, index) => {
          const { from, to } = one;
          const { metres, error } = measured(one);
          const text = measuredText(metres, error, unit.value);
          const { plant } = viewer.scene;
          const way = wayText(plant, minus(to.point, from.point), unit.value);
          const ends = [
            ["from", from],
            ["to", to],
          ] as const;
          return (
            <li key={index}>
              <strong>{text}</strong>
              <CopyButton text={text} label={`Copy distance ${index + 1}`} />
              <Button
                text="×"
                aria-label={`Remove distance ${index + 1}`}
                onClick={() => measuring.remove(one)}
              />
              {areCoordinatesShown.value && (
                <>
                  <p>
                    <span>
                      <Quantities text={way} />
                    </span>{" "}
                    <CopyButton text={way} label={`Copy parts of distance ${index + 1}`} />
                  </p>
                  {ends.map(([name, end]) => {
                    const place = placeText(plant, end.point, unit.value);
                    return (
                      <p key={name}>
                        {name}{" "}
                        <span>
                          <Quantities text={place + errorText(end, unit.value)} />
                        </span>{" "}
                        <CopyButton text={place} label={`Copy ${name} of distance ${index + 1}`} />
                      </p>
                    );
                  })}
                </>
              )}
            </li>
          );
        })}
      </ol>
      <ul aria-label="Angles and surfaces">
        {measuring.findings.value.map((finding, index) => (
          <li key={index}>
            <strong>{textOf(finding, unit.value)}</strong>
            <CopyButton text={textOf(finding, unit.value)} label={`Copy measure ${index + 1}`} />
            <Button
              text="×"
              aria-label={`Remove measure ${index + 1}`}
              onClick={() => measuring.drop(finding)}
            />
          </li>
        ))}
      </ul>
    </section>
  );
}

/** An angle, an area or a diameter. */
export function textOf(finding: Finding, unit: Unit): string {
  if (finding.kind === "angle") {
    const [a, b, c] = finding.ends;
    const degrees = angleAt([a.point, b.point, c.point]);
    const error = angleError(finding.ends);
    if (degrees === undefined) {
      return "no angle: two of the points are one";
    }
    const text = `${degrees.toFixed(2)}°`;
    return error === undefined ? `about ${text}` : error < 0.005 ? text : `${text} ± ${error.toFixed(2)}°`;
  }
  if (finding.kind === "polygon") {
    return polygonTexts(finding.corners, unit).join(", ");
  }
  const { area, cylinder } = finding;
  if (cylinder !== null) {
    const length = lengthText(cylinder.length, unit);
    return `diameter ${measuredText(cylinder.diameter, 2 * cylinder.residual, unit)}, length ${length}`;
  }
  return areaText(area, 0, unit);
}
