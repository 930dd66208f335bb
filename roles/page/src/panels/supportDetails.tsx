/** The figures of the roles, and settings of culling that can be changed while the page runs. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Choice, type Option } from "../controls/choice.tsx";
import { type Row, Rows } from "../controls/rows.tsx";
import type { OcclusionTest } from "../proto/settings.ts";
import { type Audited, LiveAudit } from "../viewer/liveAudit.ts";
import type { Cullers, Viewer } from "../viewer/viewer.ts";
import { TimelineChart } from "./timelineChart.tsx";

/** Milliseconds between two updates. */
const PERIOD = 500;

const EPSILONS = [0.5, 1, 2, 4, 8, 16].map((value) => ({ value, text: String(value) }));
const TESTS: readonly Option<OcclusionTest>[] = [
  { value: "query", text: "the device's queries" },
  { value: "raster", text: "a count of pixels" },
  { value: "hzb", text: "a hierarchical Z-buffer" },
];
const CULLERS: readonly Option<Cullers>[] = [
  { value: "1", text: "one" },
  { value: "2", text: "two, each for itself" },
  { value: "switch", text: "two that take turns, as in the paper" },
  { value: "3", text: "three" },
  { value: "4", text: "four" },
];
const MEMORIES = [16, 32, 64, 128, 256, 512, 1024].map((mebibytes) => ({
  value: mebibytes * 2 ** 20,
  text: String(mebibytes),
}));

export function SupportDetails({ viewer }: { readonly viewer: Viewer }) {
  const rows = useSignal<readonly Row[]>([]);
  useEffect(() => {
    const audit = new LiveAudit(viewer);
    const stop = audit.start();
    const look = () => {
      rows.value = rowsOf(viewer, audit.found.peek());
    };
    look();
    const timer = setInterval(look, PERIOD);
    return () => {
      clearInterval(timer);
      stop();
    };
  }, [viewer]);
  return (
    <>
      <Rows rows={rows.value} />
      <TimelineChart viewer={viewer} />
      <Setting label="Error of silhouettes, pixels" options={EPSILONS} of={viewer.epsilon} />
      <Setting label="Hidden or not, says" options={TESTS} of={viewer.occlusionTest} />
      <Choice
        label="Cullers"
        options={CULLERS}
        value={viewer.cullers.value}
        onChoose={(cullers) => viewer.share(cullers)}
      />
      <Setting label="Geometry kept here, MiB" options={MEMORIES} of={viewer.memory} />
      <Choice
        label="Simulated network to the culler"
        options={[
          { value: "", text: "none" },
          ...viewer.scene.networks.map(({ name, about }) => ({ value: name, text: name, title: about })),
        ]}
        value={viewer.session.network.value}
        onChoose={(network) => viewer.session.moveTo(network)}
      />
    </>
  );
}

/** The choice of a signal's value. */
function Setting<T>(properties: { label: string; options: readonly Option<T>[]; of: Signal<T> }) {
  const { of, ...shown } = properties;
  const choose = (value: T) => {
    of.value = value;
  };
  return <Choice {...shown} value={of.value} onChoose={choose} />;
}

function rowsOf(viewer: Viewer, audited: Audited | undefined): readonly Row[] {
  const { display, renderer, canvas } = viewer;
  const { drawables, triangles, milliseconds: taken } = renderer.drawn;
  const { cameras = 0, ids = 0 } = display?.counts ?? {};
  const bytes = display?.bytes;
  const count = (number: number) => number.toLocaleString("en");
  const size = (bytes: number) =>
    bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(2)} MB`;
  return [
    ["a picture takes", `${taken.toFixed(1)} ms of this thread`],
    ["hand to picture", milliseconds(viewer.hand.latency)],
    ["camera to ids", milliseconds(display?.latency)],
    ["camera to geometry", milliseconds(display?.geometryLatency)],
    ["set is old", viewer.isSettled ? "it is exact" : milliseconds(viewer.setAge)],
    ["wrong pixels", wrong(viewer, audited)],
    [
      "visible",
      audited === undefined ? "" : `${count(audited.visible)} of ${count(audited.drawn)} drawables`,
    ],
    ["drawn", `${count(drawables)} drawables, ${count(triangles)} triangles`],
    ["picture", `${canvas.width} x ${canvas.height}, ${renderer.samples} samples`],
    ["edges and smoothing", renderer.isFine ? "shown" : "come once the picture rests"],
    ["cameras sent", `${size(bytes?.latest.sent ?? 0)}; by 72 bytes each ${size(72 * cameras)}`],
    ["ids received", `${size(bytes?.frames.received ?? 0)}; by 4 bytes each ${size(4 * ids)}`],
    ["geometry received", size(bytes?.bulk.received ?? 0)],
    ["device", renderer.device],
  ];
}

function milliseconds(time = 0): string {
  return `${time.toFixed(0)} ms`;
}

/** The result of the last audited picture. */
function wrong({ isSettled }: Viewer, audited: Audited | undefined): string {
  if (isSettled) {
    return "none: it is exact";
  }
  return audited === undefined ? "" : `${audited.wrongPercent.toFixed(3)} %`;
}
