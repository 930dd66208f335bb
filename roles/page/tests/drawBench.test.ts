/** Measures the time of pictures on a software renderer; only with TRIMARAN_DRAW_BENCH=1. */

import { test } from "node:test";

import { DrawBrowser } from "./drawBrowser.ts";

const isWanted = process.env.TRIMARAN_DRAW_BENCH === "1";

/** Numbers of drawables and triangles: 2 triangles for each side and part, and 2 more for each side. */
const SCENES = [
  // One drawable of as many triangles is the baseline: the excess is the cost of drawables.
  { drawables: 1, sides: 1000, parts: 719 },
  { drawables: 10_000, sides: 12, parts: 5 },
  { drawables: 10_000, sides: 12, parts: 5, samples: 4 },
  { drawables: 10_000, sides: 12, parts: 5, extensions: false },
  { drawables: 3_000, sides: 12, parts: 5 },
  { drawables: 1_000, sides: 12, parts: 5 },
  { drawables: 1, sides: 3, parts: 1 },
];

test("pictures of 1024 by 1024 pixels", { skip: !isWanted, timeout: 600_000 }, async () => {
  const browser = await DrawBrowser.open();
  for (const scene of browser === undefined ? [] : SCENES) {
    const found = await browser?.page.evaluate(measure, scene);
    console.log(JSON.stringify(scene), JSON.stringify(found));
  }
  await browser?.close();
});

/** Milliseconds of the fastest picture, and the median. Runs in the page. */
function measure(wanted: (typeof SCENES)[number]): unknown {
  const { cameraAt, pipes, Stage } = window.draw;
  const { samples = 1, extensions = true } = wanted;
  const stage = new Stage(1024, 1024, { samples, extensions });
  const { meshes, drawables } = pipes(wanted.drawables, wanted.sides, wanted.parts);
  const begun = performance.now();
  stage.set(...meshes);
  const upload = performance.now() - begun;
  const [whole, own]: [number[], number[]] = [[], []];
  const pixel = new Uint8Array(4);
  for (let picture = 0; picture < 14; picture += 1) {
    const start = performance.now();
    stage.renderer.draw(cameraAt([0, 0, picture / 100]), drawables);
    own.push(stage.renderer.drawn.milliseconds);
    // Reading waits for the picture.
    stage.gl.readPixels(0, 0, 1, 1, stage.gl.RGBA, stage.gl.UNSIGNED_BYTE, pixel);
    whole.push(performance.now() - start);
  }
  const { calls, triangles } = stage.renderer.drawn;
  stage.end();
  const ends = (times: number[]) => {
    const sorted = times.slice(2).sort((a, b) => a - b);
    return [sorted[0], sorted[sorted.length >> 1]].map((time) => Number(time?.toFixed(1)));
  };
  return { upload: Math.round(upload), picture: ends(whole), script: ends(own), calls, triangles };
}
