/** Viewpoints, links, pictures and recorded walks. */

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useMemo } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { copyText } from "../controls/copyButton.tsx";
import { download } from "../controls/download.ts";
import { lazy } from "../controls/lazy.tsx";
import type { PartDetails } from "../service/service.ts";
import type { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type KeptViewpoints, ViewpointsError } from "./kept.ts";
import { PeopleList } from "./peopleList.tsx";
import { Recording } from "./recording.ts";
import { encodeViewpoint } from "./viewpoint.ts";
import { goTo, nameOfView, viewpointOf } from "./views.ts";

const PictureDialog = lazy(async () => (await import("./pictures/pictureDialog.tsx")).PictureDialog);

/** Sides of a thumbnail, pixels. */
const THUMBNAIL = [160, 90] as const;

interface Properties {
  readonly viewer: Viewer;
  readonly people: People;
  readonly kept: KeptViewpoints;
  /** Searches for all of a set. */
  readonly openSet: (query: string) => void;
  /** The part that is picked last. */
  readonly picked: PartDetails | undefined;
}

export function ViewsPanel({ viewer, people, kept, openSet, picked }: Properties) {
  const takesPicture = useSignal(false);
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
        <Button
          text="Picture"
          onClick={() => {
            // A picture is of one's own view.
            people.follow(undefined);
            takesPicture.value = true;
          }}
        />
        <Button
          text={recording.isOn.value ? "Stop" : "Record a walk"}
          aria-pressed={recording.isOn.value}
          onClick={record}
        />
      </div>
      <ul>
        {kept.list.value.map((one) => (
          <Row
            key={one.name}
            name={one.name}
            open={() => goTo(viewer, one.viewpoint)}
            rename={(name) => kept.rename(one, name)}
            remove={() => kept.remove(one)}
          >
            {one.thumbnail && <img src={one.thumbnail} alt="" width={80} height={45} />}
            {one.name}
          </Row>
        ))}
      </ul>
      {kept.sets.value.length > 0 && <p>Sets</p>}
      <ul aria-label="Sets">
        {kept.sets.value.map((one) => (
          <Row
            key={one.name}
            name={one.name}
            title={one.query}
            open={() => openSet(one.query)}
            rename={(name) => kept.renameSet(one, name)}
            remove={() => kept.removeSet(one)}
          >
            {one.name}
          </Row>
        ))}
      </ul>
      <div>
        <Button
          text="Save as a file"
          disabled={kept.list.value.length + kept.sets.value.length === 0}
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
      <PeopleList people={people} picked={picked} />
      {takesPicture.value && (
        <PictureDialog
          viewer={viewer}
          subject={picked?.name || nameOfView(viewer, kept.list.value)}
          picked={picked}
          onClose={() => {
            takesPicture.value = false;
          }}
        />
      )}
    </section>
  );
}

/** A saved viewpoint or set with its commands: open, rename, remove. */
function Row({
  name,
  title,
  open,
  rename,
  remove,
  children,
}: {
  readonly name: string;
  readonly title?: string;
  readonly open: () => void;
  readonly rename: (name: string) => void;
  readonly remove: () => void;
  readonly children: ComponentChildren;
}) {
  const isNaming = useSignal(false);
  const end = (name: string | undefined) => {
    // A removed field loses the focus, and so ends a second time.
    if (isNaming.peek()) {
      isNaming.value = false;
      if (name !== undefined) {
        rename(name);
      }
    }
  };
  return (
    <li>
      {isNaming.value ? (
        <input
          ref={(field) => field?.select()}
          aria-label={`Name of ${name}`}
          maxLength={80}
          defaultValue={name}
          onBlur={(event) => end(event.currentTarget.value)}
          onKeyDown={({ key, currentTarget }) => {
            if (key === "Enter" || key === "Escape") {
              end(key === "Enter" ? currentTarget.value : undefined);
            }
          }}
        />
      ) : (
        <button type="button" class="link" title={title} onClick={open}>
          {children}
        </button>
      )}
      <Button
        text="✎"
        aria-label={`Rename ${name}`}
        title="Rename"
        onClick={() => {
          isNaming.value = true;
        }}
      />
      <Button text="×" aria-label={`Remove ${name}`} onClick={remove} />
    </li>
  );
}

function thumbnailOf(viewer: Viewer): string {
  const small = document.createElement("canvas");
  [small.width, small.height] = THUMBNAIL;
  viewer.drawNow();
  small.getContext("2d")?.drawImage(viewer.canvas, 0, 0, ...THUMBNAIL);
  return small.toDataURL("image/jpeg", 0.8);
}
