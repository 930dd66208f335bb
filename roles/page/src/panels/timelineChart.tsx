/** A timeline of the last second: the culler's work, and the page's at the same time. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { FrameTimes } from "../display/timeline.ts";
import { Samples } from "../viewer/samples.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** The shown span, and the time between two updates, milliseconds. */
const SPAN = 1000;
const PERIOD = 250;
/** Units of the drawing. */
const [WIDTH, LANE, BAR] = [280, 16, 12];

/** A stretch of time, in milliseconds of `performance.now()`. */
export interface Stretch {
  readonly from: number;
  readonly to: number;
}

/** One lane of the chart. */
export interface Lane {
  readonly name: string;
  readonly about: string;
  readonly stretches: readonly Stretch[];
}

/**
 * The lanes of frames and of pictures. The clocks of culler and page are not compared: HC is drawn to end
 * when the ids arrive, so it is late by their delay.
 */
export function lanesOf(frames: readonly FrameTimes[], pictures: readonly Stretch[]): readonly Lane[] {
  const worked = frames.flatMap(({ came, work }) => (work === undefined ? [] : [{ came, ...work }]));
  return [
    {
      name: "ids",
      about: "from a camera until its ids are there",
      stretches: frames.map(({ posed, came }) => ({ from: posed, to: came })),
    },
    {
      name: "OR",
      about: "a culler draws what hides other things",
      stretches: worked.map(({ came, or, hc }) => ({ from: came - hc - or, to: came - hc })),
    },
    {
      name: "HC",
      about: "a culler tests what is hidden",
      stretches: worked.map(({ came, hc }) => ({ from: came - hc, to: came })),
    },
    { name: "RVG", about: "the page hands a picture to its device", stretches: pictures },
  ];
}

export function TimelineChart({ viewer }: { readonly viewer: Viewer }) {
  const lanes = useSignal<readonly Lane[]>([]);
  const device = useSignal("");
  const end = useSignal(0);
  useEffect(() => {
    let pictures: Stretch[] = [];
    const stop = viewer.onPicture(() => {
      const now = performance.now();
      pictures.push({ from: now - viewer.renderer.drawn.milliseconds, to: now });
    });
    const timer = setInterval(() => {
      const now = performance.now();
      pictures = pictures.filter(({ to }) => to > now - SPAN);
      const frames = (viewer.display?.timeline.frames ?? []).filter(({ came }) => came > now - SPAN);
      lanes.value = lanesOf(frames, pictures);
      device.value = passesOf(frames);
      end.value = now;
    }, PERIOD);
    return () => {
      clearInterval(timer);
      stop();
    };
  }, [viewer]);
  const at = (time: number) => (WIDTH * Math.max(0, time - end.value + SPAN)) / SPAN;
  return (
    <figure class="timeline">
      <figcaption>Roles in the last second, median milliseconds</figcaption>
      {lanes.value.map(({ name, about, stretches }) => (
        <div key={name} title={about}>
          <span>{name}</span>
          <svg viewBox={`0 0 ${WIDTH} ${LANE}`} role="img" aria-label={about}>
            <title>{about}</title>
            {stretches.map(({ from, to }) => (
              <rect
                key={`${from} ${to}`}
                class={name}
                x={at(from)}
                y={(LANE - BAR) / 2}
                width={Math.max(1, at(to) - at(from))}
                height={BAR}
              />
            ))}
          </svg>
          <span>{median(stretches)}</span>
        </div>
      ))}
      {device.value && <p>of it on the culler's device: {device.value}</p>}
    </figure>
  );
}

/** The median times of passes on the culler's device; empty if none was measured. */
export function passesOf(frames: readonly FrameTimes[]): string {
  const passes = (["occluders", "pyramid", "culling"] as const).map((pass) => {
    const times = frames.map(({ work }) => work?.onDevice[pass] ?? 0).filter((time) => time > 0);
    return [pass, median(times.map((to) => ({ from: 0, to })))] as const;
  });
  const measured = passes.filter(([, time]) => time !== "");
  return measured.map(([pass, time]) => `${pass} ${time}`).join(", ");
}

/** The median length; empty without stretches. */
export function median(stretches: readonly Stretch[]): string {
  const lengths = new Samples();
  for (const { from, to } of stretches) {
    lengths.add(to - from);
  }
  const length = lengths.share(0.5);
  return lengths.count === 0 ? "" : length.toFixed(length < 10 ? 1 : 0);
}
