/** Viewpoints, links, pictures and recorded walks. */

import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { copyText } from "../controls/copyButton.tsx";
import { called } from "../service/service.ts";
import type { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type KeptViewpoint, KeptViewpoints, ViewpointsError } from "./kept.ts";
import { Recording } from "./recording.ts";
import { decodeViewpoint, encodeViewpoint, foreign, type Viewpoint } from "./viewpoint.ts";

/** Sides of a thumbnail, pixels. */
const THUMBNAIL = [160, 90] as const;

export function ViewsPanel({ viewer, people }: { readonly viewer: Viewer; readonly people: People }) {
  const kept = useMemo(() => new KeptViewpoints(viewer.scene), [viewer]);
  const recording = useMemo(() => new Recording(viewer), [viewer]);
  const { name } = viewer.scene;

  const save = () => kept.add({ thumbnail: thumbnailOf(viewer), viewpoint: viewpointOf(viewer) });
  const copyLink = async () => {
    const link = new URL(location.href);
    link.hash = `v=${encodeViewpoint(viewpointOf(viewer))}`;
    const isCopied = await copyText(link.href);
    viewer.said.value = isCopied
      ? "The link is copied. Everybody who has it can see the model."
      : "The browser does not let this page copy.";
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
      viewer.said.value = `${file?.name} cannot be opened as views: ${error.message}.`;
    }
  };
  return (
    <section class="panel views" aria-label="Views">
      <div>
        <Button text="Keep this view" onClick={save} />
        <Button text="Copy link" title="The address has the token" onClick={() => void copyLink()} />
        <Button text="Picture" onClick={() => void picture(viewer)} />
        <Button
          text={recording.isOn.value ? "Stop" : "Record a walk"}
          aria-pressed={recording.isOn.value}
          onClick={record}
        />
      </div>
      <ul>
        {kept.list.value.map((one) => (
          <Row key={one.name} viewer={viewer} kept={kept} one={one} />
        ))}
      </ul>
      <div>
        <Button
          text="Save as a file"
          disabled={kept.list.value.length === 0}
          onClick={() => download(new Blob([kept.toJson()]), `${name}-views.json`)}
        />
        <label class="file">
          Open a file
          <input
            type="file"
            class="file-input"
            accept="application/json,.json"
            onChange={(event) => {
              void take(event.currentTarget.files?.[0]);
              // Allows choosing the same file again.
              event.currentTarget.value = "";
            }}
          />
        </label>
      </div>
      <PeopleList people={people} />
    </section>
  );
}

/** A saved viewpoint with its commands: move there, rename, remove. */
function Row({
  viewer,
  kept,
  one,
}: {
  readonly viewer: Viewer;
  readonly kept: KeptViewpoints;
  readonly one: KeptViewpoint;
}) {
  const isNaming = useSignal(false);
  const end = (name: string | undefined) => {
    // A removed field loses the focus, and so ends a second time.
    if (isNaming.peek()) {
      isNaming.value = false;
      if (name !== undefined) {
        kept.rename(one, name);
      }
    }
  };
  return (
    <li>
      {isNaming.value ? (
        <input
          ref={(field) => field?.select()}
          aria-label={`Name of ${one.name}`}
          maxLength={80}
          defaultValue={one.name}
          onBlur={(event) => end(event.currentTarget.value)}
          onKeyDown={({ key, currentTarget }) => {
            if (key === "Enter" || key === "Escape") {
              end(key === "Enter" ? currentTarget.value : undefined);
            }
          }}
        />
      ) : (
        <button type="button" class="link" onClick={() => goTo(viewer, one.viewpoint)}>
          {one.thumbnail && <img src={one.thumbnail} alt="" width={80} height={45} />}
          {one.name}
        </button>
      )}
      <Button
        text="✎"
        aria-label={`Rename ${one.name}`}
        title="Rename"
        onClick={() => {
          isNaming.value = true;
        }}
      />
      <Button text="×" aria-label={`Remove ${one.name}`} onClick={() => kept.remove(one)} />
    </li>
  );
}

/** The other people here. Empty if there are none. */
function PeopleList({ people }: { readonly people: People }) {
  const { you, others } = people.company.value;
  const { followed } = people;
  return (
    <ul aria-label="People">
      {others.length > 0 && <li>You are person {you}</li>}
      {others.map((person) => (
        <li key={person.number}>
          {called(person)}
          <Button
            text="Follow"
            aria-pressed={followed.value === person.number}
            onClick={() => people.follow(followed.value === person.number ? undefined : person.number)}
          />
        </li>
      ))}
    </ul>
  );
}

/** A viewpoint of the present pose and changes. */
export function viewpointOf({ scene, navigator, view }: Viewer): Viewpoint {
  const { eye, forward, vfovDeg } = navigator;
  const { name, fingerprint } = scene;
  const mode = navigator.mode.peek();
  return { scene: { name, fingerprint }, eye, forward, vfovDeg, mode, view: view.current.peek() };
}

/** Moves to a viewpoint of this scene. Its changes can be undone in one step. */
export function goTo({ navigator, view }: Viewer, viewpoint: Viewpoint): void {
  navigator.jumpTo(viewpoint);
  view.change(viewpoint.view);
}

/** Moves to the viewpoint in a link's address, if it has one; explains a failure. */
export function followLink(viewer: Viewer, address: URL): void {
  if (!address.hash.startsWith("#v=")) {
    return;
  }
  const viewpoint = decodeViewpoint(address.hash.slice(3));
  const why =
    viewpoint === undefined
      ? "it is cut short, or of another version of this page"
      : foreign(viewpoint, viewer.scene);
  if (viewpoint !== undefined && why === undefined) {
    goTo(viewer, viewpoint);
  } else {
    viewer.said.value = `The view in the address cannot be shown: ${why}.`;
  }
}

function thumbnailOf(viewer: Viewer): string {
  const small = document.createElement("canvas");
  [small.width, small.height] = THUMBNAIL;
  viewer.drawNow();
  small.getContext("2d")?.drawImage(viewer.canvas, 0, 0, ...THUMBNAIL);
  return small.toDataURL("image/jpeg", 0.8);
}

/** The picture as a file, in its size on the screen. */
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
