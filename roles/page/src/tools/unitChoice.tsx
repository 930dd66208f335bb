/** The choice of this person's unit of length. */

import { Choice } from "../controls/choice.tsx";
import { chooseUnit, UNITS, unit } from "./lengths.ts";

export function UnitChoice() {
  return (
    <Choice
      label="Unit"
      options={UNITS.map((value) => ({ value, text: value }))}
      value={unit.value}
      onChoose={chooseUnit}
    />
  );
}
