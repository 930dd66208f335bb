/** The details of the picked part. */

import { Button } from "../controls/button.tsx";
import { type Row, Rows } from "../controls/rows.tsx";
import type { Part, PartDetails } from "../service/service.ts";
import { sizeOf } from "../space/box.ts";
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
        <Button text="×" aria-label="Close" onClick={() => selection.clear()} />
      </header>
      {selection.count.value > 1 && <p>The last of {selection.count.value} that are picked.</p>}
      <nav aria-label="Path">
        {details.path.map((part) => (
          <Button text={nameOf(part)} class="link" key={part.id} onClick={() => void selection.pick(part)} />
        ))}
      </nav>
      <Rows rows={rowsOf(details)} />
    </section>
  );
}

export function nameOf({ name, kind, id }: Pick<Part, "name" | "kind" | "id">): string {
  return name || `${kind} ${id}`;
}

function rowsOf(details: PartDetails): readonly Row[] {
  const objects = details.end - details.first;
  const left = details.attributeCount - details.attributes.length;
  return [
    [
      "size",
      sizeOf(details)
        .map((side) => lengthText(side, unit.value))
        .join(" × "),
    ],
    ["triangles", details.triangles.toLocaleString("en")],
    ...(details.kind === "group" ? [["objects", objects.toLocaleString("en")] as const] : []),
    ...details.attributes,
    ...(left > 0 ? [["and", `${left.toLocaleString("en")} more attributes`] as const] : []),
  ];
}
