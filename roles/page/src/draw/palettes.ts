/** Palettes that colour-blind people can tell apart. */

import type { Rgb } from "./colours.ts";

/** The scheme "muted" of Paul Tol (SRON/EPS/TN/09-002, 2021), the most different first. */
export const PALETTE: readonly { readonly name: string; readonly colour: Rgb }[] = [
  { name: "rose", colour: 0xcc6677 },
  { name: "indigo", colour: 0x332288 },
  { name: "sand", colour: 0xddcc77 },
  { name: "green", colour: 0x117733 },
  { name: "cyan", colour: 0x88ccee },
  { name: "wine", colour: 0x882255 },
  { name: "teal", colour: 0x44aa99 },
  { name: "olive", colour: 0x999933 },
  { name: "purple", colour: 0xaa4499 },
];

/** Colours of viridis (Smith, van der Walt 2015) at equal steps, from dark to bright. */
const SCALE: readonly Rgb[] = [
  0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b, 0xfde725,
];

/** The colour of a scale at a share from 0 to 1. */
export function scaleAt(share: number): Rgb {
  const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const below = Math.min(Math.floor(place), SCALE.length - 2);
  const [low = 0, high = 0] = [SCALE[below], SCALE[below + 1]];
  const mixed = [16, 8, 0].map((shift) => {
    const [from, to] = [(low >> shift) & 255, (high >> shift) & 255];
    return Math.round(from + (to - from) * (place - below)) << shift;
  });
  return mixed.reduce((sum, part) => sum | part, 0);
}

/** A colour for a style sheet. */
export function cssOf(colour: Rgb): string {
  return `#${colour.toString(16).padStart(6, "0")}`;
}
