/** What the page does, in numbers, and what can be changed of it while it goes on. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { OCCLUSION_TESTS, type OcclusionTest } from "../proto/settings.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** Milliseconds between two looks. */
const PERIOD = 500;

const EPSILONS = [0.5, 1, 2, 4, 8, 16];
const TESTS: Readonly<Record<OcclusionTest, string>> = {
  query: "the device's queries",
  raster: "a count of pixels",
  hzb: "a hierarchical Z-buffer",
};

export function StatusPanel({ viewer }: { readonly viewer: Viewer }) {
  const rows = useSignal<readonly (readonly [string, string])[]>([]);
  useEffect(() => {
    let [pictures, time] = [viewer.pictures, performance.now()];
    const look = () => {
      const now = performance.now();
      rows.value = rowsOf(viewer, (1000 * (viewer.pictures - pictures)) / (now - time));
      [pictures, time] = [viewer.pictures, now];
    };
    const timer = setInterval(look, PERIOD);
    return () => clearInterval(timer);
  }, [viewer]);
  return (
    <section class="panel status" aria-label="Status">
      <table>
        <tbody>
          {rows.value.map(([name, value]) => (
            <tr key={name}>
              <th scope="row">{name}</th>
              <td>{value}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <label>
        Error of silhouettes, pixels{" "}
        <select
          value={viewer.epsilon.value}
          onChange={(event) => {
            viewer.epsilon.value = Number(event.currentTarget.value);
          }}
        >
          {EPSILONS.map((epsilon) => (
            <option key={epsilon} value={epsilon}>
              {epsilon}
            </option>
          ))}
        </select>
      </label>
      <label>
        Hidden or not, says{" "}
        <select
          value={viewer.occlusionTest.value}
          onChange={(event) => {
            const chosen = OCCLUSION_TESTS.find((test) => test === event.currentTarget.value);
            viewer.occlusionTest.value = chosen ?? viewer.occlusionTest.value;
          }}
        >
          {OCCLUSION_TESTS.map((test) => (
            <option key={test} value={test}>
              {TESTS[test]}
            </option>
          ))}
        </select>
      </label>
      <label>
        Simulated network to the culler{" "}
        <select
          value={viewer.session.network.value}
          onChange={(event) => {
            viewer.session.moveTo(event.currentTarget.value);
            // The keys walk on.
            event.currentTarget.blur();
          }}
        >
          <option value="">none</option>
          {viewer.scene.networks.map(({ name, about }) => (
            <option key={name} value={name} title={about}>
              {name}
            </option>
          ))}
        </select>
      </label>
    </section>
  );
}

function rowsOf(viewer: Viewer, picturesASecond: number): readonly (readonly [string, string])[] {
  const { display, renderer, canvas } = viewer;
  const { drawables, triangles, milliseconds } = renderer.drawn;
  const bytes = display?.link.bytes;
  const count = (number: number) => number.toLocaleString("en");
  const megabytes = (bytes: number) => `${(bytes / 1e6).toFixed(2)} MB`;
  return [
    ["pictures a second", picturesASecond.toFixed(0)],
    ["a picture takes", `${milliseconds.toFixed(1)} ms of this thread`],
    ["camera to set", `${(display?.latency ?? 0).toFixed(0)} ms`],
    ["set is old", viewer.isSettled ? "it is exact" : `${viewer.setAge.toFixed(0)} ms`],
    ["drawn", `${count(drawables)} drawables, ${count(triangles)} triangles`],
    ["picture", `${canvas.width} x ${canvas.height}, ${renderer.samples} samples`],
    ["geometry here", megabytes(renderer.bytes)],
    ["cameras sent", megabytes(bytes?.latest.sent ?? 0)],
    ["ids received", megabytes(bytes?.frames.received ?? 0)],
    ["geometry received", megabytes(bytes?.bulk.received ?? 0)],
    ["device", renderer.device],
  ];
}
