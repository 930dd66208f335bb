/** Repeats a walk by itself, and reports to the service: see `trimaran view --drive`. */

import type { Service } from "../service/service.ts";
import { Samples } from "../viewer/samples.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { Album, audit } from "./audit.ts";
import { LongTasks } from "./longTasks.ts";
import { Moments } from "./moments.ts";
import { Path } from "./path.ts";
import { each, until } from "./time.ts";

/** Picks are timed at this many places in a row, and in as many rows. */
const PICKS = 5;

/**
 * Walks along the service's path from its first pose to its last, and reports. Then the page closes itself,
 * if the browser allows that: a page that stays open slows down the next walk.
 */
export async function drive(viewer: Viewer, service: Service): Promise<void> {
  const written = await service.path();
  const { vfov_deg } = written;
  const path = new Path(written);
  const first = path.at(0, 0);
  if (first === undefined) {
    return;
  }
  const { navigator, renderer } = viewer;
  navigator.isHeld = true;
  navigator.vfov.value = vfov_deg;
  navigator.goTo(first.eye, first.forward);
  await until(() => viewer.display?.shown !== undefined);
  const firstPictureS = performance.now() / 1000;
  await until(() => viewer.isSettled);
  const exactPictureS = performance.now() / 1000;

  const [intervals, ages] = [new Samples(), new Samples()];
  const album = new Album();
  const moments = new Moments(viewer, path.seconds);
  const longTasks = new LongTasks();
  const begun = performance.now();
  let [last, geometryBytes] = [begun, renderer.bytes];
  let jumpedAt = Number.NEGATIVE_INFINITY;
  let hasJumped = false;
  const stop = viewer.onPicture((camera, drawables) => {
    const now = performance.now();
    intervals.add(now - last);
    ages.add(viewer.setAge);
    [last, geometryBytes] = [now, Math.max(geometryBytes, renderer.bytes)];
    const set = viewer.display?.shown;
    hasJumped &&= !(set?.isExact === true && set.posed >= jumpedAt);
    album.add({ at: now, camera, forward: navigator.forward, drawables, hasJumped });
  });
  let before = 0;
  await each((now) => {
    const seconds = (now - begun) / 1000;
    const step = path.at(seconds, before);
    moments.pass(seconds);
    before = seconds;
    if (step?.isJump) {
      navigator.goTo(step.eye, step.forward);
      [jumpedAt, hasJumped] = [now, true];
    } else if (step !== undefined) {
      navigator.follow(step.eye, step.forward);
    }
    return step !== undefined;
  });
  const end = performance.now();
  const tasks = longTasks.end();
  await until(() => viewer.isSettled);
  const restMs = performance.now() - end;
  stop();
  const receivedBytes = received(viewer);
  moments.add((performance.now() - begun) / 1000);
  await until(() => renderer.isFine);
  const picks = await pickAll(viewer);
  viewer.said.value = "The walk is over. Its pictures are held against the exact ones.";
  const wrong = await audit(viewer, album.pictures);
  navigator.isHeld = false;
  await service.report({
    device: renderer.device,
    width: viewer.canvas.width,
    height: viewer.canvas.height,
    firstPictureS,
    exactPictureS,
    walkS: (end - begun) / 1000,
    pictures: album.pictures.filter(({ at }) => at <= end).length,
    pictureMs: intervals.share(0.5),
    pictureP95Ms: intervals.share(0.95),
    setAgeMs: ages.share(0.5),
    setAgeP95Ms: ages.share(0.95),
    restMs,
    longTasks: tasks,
    pickMs: picks.share(0.5),
    longestPickMs: picks.share(1),
    receivedBytes,
    geometryBytes,
    moments: moments.list,
    wrong,
  });
  viewer.said.value = "The walk is over.";
  window.close();
}

/**
 * How long picks at places all over the picture take, milliseconds: one before each picture. The first fine
 * picture must be there: a pick waits for its shaders to be compiled, once a session.
 */
async function pickAll(viewer: Viewer): Promise<Samples> {
  const { clientWidth, clientHeight } = viewer.canvas;
  const picks = new Samples();
  await each(() => {
    const [column, row] = [picks.count % PICKS, Math.floor(picks.count / PICKS)];
    const begun = performance.now();
    viewer.pick(((column + 0.5) * clientWidth) / PICKS, ((row + 0.5) * clientHeight) / PICKS);
    picks.add(performance.now() - begun);
    return picks.count < PICKS * PICKS;
  });
  return picks;
}

function received(viewer: Viewer): number {
  const lanes = Object.values(viewer.display?.bytes ?? {});
  return lanes.reduce((sum, lane) => sum + lane.received, 0);
}
