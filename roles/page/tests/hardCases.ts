/**
 * Draws hard cases of culling in a browser, for a test program: one case in JSON per line on standard input,
 * its result per line on standard output.
 */

import { createInterface } from "node:readline";

import type { Camera, Drawable } from "../src/draw/model.ts";
import { DrawBrowser } from "./drawBrowser.ts";

/** A scene, and its frames with what was found. */
interface HardCase {
  readonly width: number;
  readonly height: number;
  readonly pieces: readonly { readonly vertices: readonly number[]; readonly indices: readonly number[] }[];
  /** By their numbers. */
  readonly drawables: readonly Drawable[];
  readonly frames: readonly {
    readonly camera: Camera;
    /** All of the LOD cut. */
    readonly whole: readonly number[];
    /** What each of several cullers found. */
    readonly found: readonly (readonly number[])[];
  }[];
}

const browser = await DrawBrowser.open();
for await (const line of createInterface({ input: process.stdin })) {
  const wrong = await browser?.page.evaluate(wrongPixels, JSON.parse(line) as HardCase);
  console.log(JSON.stringify(wrong === undefined ? { skipped: true } : { wrong, faults: browser?.faults }));
}
await browser?.close();

/** The pixels that show another drawable with a culler's set than with all, one number per culler. */
function wrongPixels({ width, height, pieces, drawables, frames }: HardCase): number[] {
  const stage = new window.draw.Stage(width, height);
  stage.set(
    ...pieces.map(({ vertices, indices }) => ({
      vertices: Uint8Array.from(vertices),
      indices: Uint32Array.from(indices),
    })),
  );
  const drawn = (camera: Camera, ids: readonly number[]) =>
    stage.renderer.items(
      camera,
      ids.flatMap((id) => drawables[id] ?? []),
    );
  const wrong: number[] = [];
  for (const { camera, whole, found } of frames) {
    const exact = drawn(camera, whole);
    for (const [culler, ids] of found.entries()) {
      const shown = drawn(camera, ids);
      const differing = exact.reduce((sum, id, pixel) => sum + (id === shown[pixel] ? 0 : 1), 0);
      wrong[culler] = (wrong[culler] ?? 0) + differing;
    }
  }
  stage.end();
  return wrong;
}
