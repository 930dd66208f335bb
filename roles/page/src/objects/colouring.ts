/** Colours for the classes of objects by an attribute. */

import type { Colouring, Paint } from "../draw/colours.ts";
import { PALETTE, scaleAt } from "../draw/palettes.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Classes } from "../service/service.ts";

/** The most entries of a scale's legend. */
const ENTRIES = 8;

/** Values have colours of the palette. Numbers have those of a scale, and some steps share an entry. */
export function colouringBy(by: string, classes: Classes): Colouring {
  const { legend, objects } = classes;
  if (legend.kind === "values") {
    const paints = legend.labels.map((label, index): Paint => {
      const colour = PALETTE[index % PALETTE.length]?.colour ?? 0;
      return { label, colour, objects: objects[index] ?? ObjectSet.EMPTY };
    });
    return { by, paints };
  }
  const { least, largest, unit, counts } = legend;
  const steps = counts.length;
  const paints = counts.map((_, step): Paint => {
    const colour = scaleAt(steps > 1 ? step / (steps - 1) : 0);
    const entry = Math.floor((step * ENTRIES) / steps);
    const at = (entry: number) => numberText(least + ((largest - least) * entry) / ENTRIES);
    const label = `${at(entry)} to ${at(entry + 1)}${unit && ` ${unit}`}`;
    return { label, colour, objects: objects[step] ?? ObjectSet.EMPTY };
  });
  if (least === largest) {
    const label = `${numberText(least)}${unit && ` ${unit}`}`;
    return { by, paints: paints.slice(0, 1).map((paint) => ({ ...paint, label })) };
  }
  return { by, paints };
}

/** A number in a few digits. */
function numberText(value: number): string {
  return Number(value.toPrecision(4)).toLocaleString("en", { maximumSignificantDigits: 4 });
}
