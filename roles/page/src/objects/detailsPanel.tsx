/** The details of the picked part. */

import { Button } from "../controls/button.tsx";
import { CopyButton } from "../controls/copyButton.tsx";
import { Quantities } from "../controls/quantities.tsx";
import { type Row, Rows } from "../controls/rows.tsx";
import { nameOf, type PartDetails } from "../service/service.ts";
import { sizeOf } from "../space/box.ts";
import { errorText, placeText, rangeTexts } from "../tools/coordinates.ts";
import { areCoordinatesShown, CoordinatesButton } from "../tools/coordinatesButton.tsx";
import { lengthText, unit } from "../tools/lengths.ts";
import type { Selection } from "./selection.ts";

export function DetailsPanel({ selection }: { readonly selection: Selection }) {
  const details = selection.details.value;
  if (details === undefined) {
    return null;
  }
  return (
    <section class="panel details" aria-label="Details">
      <header>
        <h2>{details.name || "without a name"}</h2>
        <div class="buttons">
          <CoordinatesButton />
          <Button text="×" aria-label="Close" onClick={() => selection.clear()} />
        </div>
      </header>
      {selection.count.value > 1 && <p>The last of {selection.count.value} that are picked.</p>}
      <nav aria-label="Path">
        {details.path.map((part) => (
          <Button text={nameOf(part)} class="link" key={part.id} onClick={() => void selection.pick(part)} />
        ))}
      </nav>
      {areCoordinatesShown.value && <PickedPlace selection={selection} details={details} />}
      <Rows rows={rowsOf(details)} />
      {details.attributeCount === 0 && <p>No attributes in the model.</p>}
    </section>
  );
}

/** The box around a part and the clicked point, in the plant's coordinates. */
function PickedPlace({
  selection,
  details,
}: {
  readonly selection: Selection;
  readonly details: PartDetails;
}) {
  const { plant, point } = selection;
  const ranges = rangeTexts(plant, details, unit.value);
  const clicked = point.value && placeText(plant, point.value.point, unit.value);
  return (
    <div class="places">
      <ul aria-label="Box">
        {ranges.map((range) => (
          <li key={range}>
            <Quantities text={range} />
          </li>
        ))}
      </ul>
      <CopyButton text={ranges.join(", ")} label="Copy box" />
      {point.value && clicked && (
        <p>
          <span>
            {point.value.to}: <Quantities text={clicked + errorText(point.value, unit.value)} />
          </span>{" "}
          <CopyButton text={clicked} label="Copy clicked point" />
        </p>
      )}
    </div>
  );
}

function rowsOf(details: PartDetails): readonly Row[] {
  const objects = details.end - details.first;
  const left = details.attributeCount - details.attributes.length;
  const sides = sizeOf(details).map((side) => lengthText(side, unit.value));
  return [
    ["size", <Quantities text={sides.join(" × ")} key="size" />],
    ["triangles", details.triangles.toLocaleString("en")],
    ...(details.kind === "group" ? [["objects", objects.toLocaleString("en")] as const] : []),
    ...details.attributes.map(attributeRow),
    ...(left > 0 ? [["and", `${left.toLocaleString("en")} more attributes`] as const] : []),
  ];
}

function attributeRow([name, value]: readonly [string, string]): Row {
  return [
    name,
    <>
      {value}{" "}
      <span class="copy">
        <CopyButton text={value} label={`Copy value of ${name}`} />
      </span>
    </>,
  ];
}
