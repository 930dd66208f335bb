/** The sheet that is printed in place of the page. */

import type { Viewer } from "../../viewer/viewer.ts";
import type { Paper } from "./print.ts";

/** Has the browser print this picture alone, until `clearSheet`. */
export function showSheet(paper: Paper, picture: HTMLElement): void {
  clearSheet();
  const sheet = document.createElement("div");
  sheet.className = `sheet ${paper.toLowerCase()}`;
  sheet.append(picture);
  document.body.append(sheet);
}

/** Removes the picture to print. */
export function clearSheet(): void {
  for (const sheet of document.querySelectorAll(".sheet")) {
    URL.revokeObjectURL(sheet.querySelector("img")?.src ?? "");
    sheet.remove();
  }
}

/**
 * The browser's menu prints at once, and waits for no picture of the paper's size: without a sheet it gets a
 * copy of the screen's picture.
 */
export function coverPrints(viewer: Viewer): void {
  addEventListener("beforeprint", () => {
    if (document.querySelector(".sheet") !== null) {
      return;
    }
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [viewer.canvas.width, viewer.canvas.height];
    viewer.drawNow();
    copy.getContext("2d")?.drawImage(viewer.canvas, 0, 0);
    showSheet("A4", copy);
    addEventListener("afterprint", clearSheet, { once: true });
  });
}
