/** Viewpoints, links, pictures and recorded walks. */

import { useMemo } from "preact/hooks";
import type { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { KeptViewpoints, ViewpointsError } from "./kept.ts";
import { Recording } from "./recording.ts";
import { encodeViewpoint, type Viewpoint } from "./viewpoint.ts";

/** Sides of a thumbnail, pixels. */
const THUMBNAIL = [160, 90] as const;

export function ViewsPanel({ viewer, people }: { readonly viewer: Viewer; readonly people: People }) {
  const kept = useMemo(() => new KeptViewpoints(viewer.scene.fingerprint), [viewer]);
  const recording = useMemo(() => new Recording(viewer), [viewer]);
  const { name } = viewer.scene;

  const save = () => {
    const number = kept.list.value.length + 1;
    kept.add({ name: `View ${number}`, thumbnail: thumbnailOf(viewer), viewpoint: viewpointOf(viewer) });
  };
  const copyLink = async () => {
    const link = new URL(location.href);
    link.hash = `v=${encodeViewpoint(viewpointOf(viewer))}`;
    try {
      await navigator.clipboard.writeText(link.href);
      viewer.said.value = "The link is copied. Whoever has it can see the model.";
    } catch {
      viewer.said.value = link.href;
    }
  };
  const record = () => {
    if (recording.isOn.value) {
      download(new Blob([recording.stop()], { type: "application/json" }), `${name}-walk.json`);
    } else {
      recording.start();
    }
  };
  const take = async (file: File | undefined) => {
    try {
      kept.addJson((await file?.text()) ?? "[]");
    } catch (error) {
      if (!(error instanceof ViewpointsError)) {
        throw error;
      }
      viewer.said.value = `${file?.name}: ${error.message}`;
    }
  };
  return (
    <section class="panel views" aria-label="Views">
      <div>
        <button type="button" onClick={save}>
          Keep this view
        </button>
        <button type="button" title="The address has the token" onClick={() => void copyLink()}>
          Copy link
        </button>
        <button type="button" onClick={() => void picture(viewer)}>
          Picture
        </button>
        <button type="button" aria-pressed={recording.isOn.value} onClick={record}>
          {recording.isOn.value ? "Stop" : "Record a walk"}
        </button>
      </div>
      <ul>
        {kept.list.value.map((one, index) => (
          <li key={index}>
            <button type="button" class="link" onClick={() => goTo(viewer, one.viewpoint)}>
              {one.thumbnail && <img src={one.thumbnail} alt="" width={80} height={45} />}
              {one.name}
            </button>
            <button type="button" aria-label={`Remove ${one.name}`} onClick={() => kept.remove(one)}>
              ×
            </button>
          </li>
        ))}
      </ul>
      <div>
        <button
          type="button"
          disabled={kept.list.value.length === 0}
          onClick={() => download(new Blob([kept.toJson()]), `${name}-views.json`)}
        >
          Save as a file
        </button>
        <label class="file">
          Open a file
          <input
            type="file"
            class="file-input"
            accept="application/json,.json"
            onChange={(event) => void take(event.currentTarget.files?.[0])}
          />
        </label>
      </div>
      <PeopleList people={people} />
    </section>
  );
}

/** Who else is here. Nothing where nobody is. */
function PeopleList({ people }: { readonly people: People }) {
  const { you, others } = people.company.value;
  const { followed } = people;
  return (
    <ul aria-label="People">
      {others.length > 0 && <li>You are person {you}</li>}
      {others.map(({ number }) => (
        <li key={number}>
          Person {number}
          <button
            type="button"
            aria-pressed={followed.value === number}
            onClick={() => people.follow(followed.value === number ? undefined : number)}
          >
            Follow
          </button>
        </li>
      ))}
    </ul>
  );
}

/** Where a person is now, and what is changed. */
export function viewpointOf({ navigator, view, distances }: Viewer): Viewpoint {
  const [x, y, z] = navigator.eye;
  const { forward, vfovDeg } = navigator;
  return { eye: [x, y, z], forward, vfovDeg, view: view.current.peek(), distances: distances.peek() };
}

/** Goes to a viewpoint. What it changes can be taken back in one step. */
export function goTo({ navigator, view, distances }: Viewer, viewpoint: Viewpoint): void {
  const { eye, forward, vfovDeg } = viewpoint;
  navigator.setMode("fly");
  navigator.setVfov(vfovDeg);
  navigator.goTo([...eye], [...forward]);
  view.change(viewpoint.view);
  distances.value = viewpoint.distances;
}

function thumbnailOf(viewer: Viewer): string {
  const small = document.createElement("canvas");
  [small.width, small.height] = THUMBNAIL;
  viewer.drawNow();
  small.getContext("2d")?.drawImage(viewer.canvas, 0, 0, ...THUMBNAIL);
  return small.toDataURL("image/jpeg", 0.8);
}

/** The picture as a file, as large as it is on the screen. */
async function picture(viewer: Viewer): Promise<void> {
  viewer.drawNow();
  const blob = await new Promise<Blob | null>((resolve) => viewer.canvas.toBlob(resolve));
  if (blob !== null) {
    download(blob, `${viewer.scene.name}.png`);
  }
}

function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
