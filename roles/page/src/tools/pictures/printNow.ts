/** Prints the present view without the dialog, by the browser's key for printing. */

import { messageOf } from "../../service/errors.ts";
import type { PartDetails } from "../../service/service.ts";
import type { Viewer } from "../../viewer/viewer.ts";
import { captionText } from "./caption.ts";
import { PRINTED, paperLayout, print } from "./print.ts";
import { clearSheet } from "./sheet.ts";
import { pngOf, takePicture } from "./takePicture.ts";

const PAPER = "A4";

let isBusy = false;

/** Makes the picture for the paper, and opens the browser's dialog. `subject` is for its caption. */
export async function printNow(
  viewer: Viewer,
  subject: string,
  picked: PartDetails | undefined,
): Promise<void> {
  if (isBusy) {
    return;
  }
  isBusy = true;
  const [width, height] = viewer.scene.maxPicture;
  viewer.said.value = "The picture for the paper is being drawn.";
  try {
    const canvas = await takePicture(viewer, {
      layout: paperLayout(PAPER, true, { width, height }),
      printedHeight: PRINTED[PAPER],
      text: captionText.peek(),
      subject,
      picked,
      hasDimensions: true,
      signal: new AbortController().signal,
      onProgress: () => {},
    });
    addEventListener("afterprint", clearSheet, { once: true });
    await print(await pngOf(canvas), PAPER);
    viewer.said.value = "";
  } catch (error) {
    viewer.said.value = `There is no picture: ${messageOf(error)}.`;
  } finally {
    isBusy = false;
  }
}
