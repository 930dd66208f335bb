/** Prints a picture alone on a page. */

import type { Size } from "../../space/size.ts";
import { type Layout, largest, layoutOf } from "./layout.ts";
import { showSheet } from "./sheet.ts";

/** Landscape. */
export const PAPERS = ["A4", "A3"] as const;
export type Paper = (typeof PAPERS)[number];

/** The printed area in millimetres: the paper of `page.css` without its margins of 10 mm. */
const AREAS: Readonly<Record<Paper, Size>> = {
  A4: { width: 277, height: 190 },
  A3: { width: 400, height: 277 },
};
/** The height of a printed picture in metres, as `page.css` sets it. */
export const PRINTED: Readonly<Record<Paper, number>> = { A4: 0.189, A3: 0.276 };
/** Pixels per millimetre: 300 in an inch. */
const DENSITY = 300 / 25.4;

/** The layout that fills a paper, as fine as the service can cull for. */
export function paperLayout(paper: Paper, isCaptioned: boolean, most: Size): Layout {
  const area = AREAS[paper];
  const limit = largest(most);
  const density = Math.min(DENSITY, limit.width / area.width, limit.height / area.height);
  const size = { width: Math.floor(area.width * density), height: Math.floor(area.height * density) };
  return layoutOf({ size, keepsShape: false, isCaptioned }, size, most);
}

/** Opens the browser's dialog for printing a picture. */
export async function print(picture: Blob, paper: Paper): Promise<void> {
  const image = document.createElement("img");
  image.alt = "The picture to print";
  image.src = URL.createObjectURL(picture);
  showSheet(paper, image);
  await image.decode();
  window.print();
}
