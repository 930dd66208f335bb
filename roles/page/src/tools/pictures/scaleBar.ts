/** The scale bar of a picture. */

import { INCH, type Unit } from "../lengths.ts";

/** Inches that divide a foot well. */
const INCHES = [6, 3, 2, 1];

/** The longest round length in a unit that is not above `most`. Metres. */
export function roundLength(most: number, unit: Unit): number {
  const inches = most / INCH;
  if (unit !== "ft-in") {
    return oneTwoFive(most);
  }
  if (inches >= 12) {
    return oneTwoFive(inches / 12) * 12 * INCH;
  }
  return (INCHES.find((length) => length <= inches) ?? oneTwoFive(inches)) * INCH;
}

/** The largest of 1, 2 and 5 times a power of ten that is not above `most`. */
function oneTwoFive(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return ([5, 2].find((times) => times * power <= most) ?? 1) * power;
}
