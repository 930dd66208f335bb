/** A picture of the view for a note. */

import type { Viewer } from "../viewer/viewer.ts";

/** The most pixels of a side. */
const LONGEST = 1024;

/** The picture as PNG in base64; null if the browser cannot make one. */
export async function snapshotOf(viewer: Viewer): Promise<string | null> {
  const { canvas } = viewer;
  const scale = Math.min(1, LONGEST / Math.max(canvas.width, canvas.height));
  const small = document.createElement("canvas");
  small.width = Math.max(1, Math.round(scale * canvas.width));
  small.height = Math.max(1, Math.round(scale * canvas.height));
  viewer.drawNow();
  small.getContext("2d")?.drawImage(canvas, 0, 0, small.width, small.height);
  const blob = await new Promise<Blob | null>((resolve) => small.toBlob(resolve));
  if (blob === null) {
    return null;
  }
  const bytes = new Uint8Array(await blob.arrayBuffer());
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}
