/** The commands for all that a query finds. */

import { useSignal } from "@preact/signals";
import { Button } from "../controls/button.tsx";
import { download } from "../controls/download.ts";
import { cssOf, PALETTE } from "../draw/palettes.ts";
import type { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import type { TableRows } from "../service/service.ts";
import type { KeptViewpoints } from "../tools/kept.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { hide, isolate, paint } from "./actions.ts";
import type { Finding } from "./finding.ts";
import type { Selection } from "./selection.ts";

/** The most runs of objects that a view can have: a culler takes a view of a few megabytes. */
const MOST_RUNS = 500_000;

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
  readonly finding: Finding;
  readonly kept: KeptViewpoints;
}

export function FoundActions({ viewer, selection, finding, kept }: Properties) {
  const { view, said } = viewer;
  const text = finding.found.value?.text ?? "";
  /** The rows that were written so far. */
  const rows = useSignal<number | undefined>(undefined);
  const act = (run: (objects: ObjectSet) => unknown) => async () => {
    try {
      const objects = await finding.objects();
      if (objects.runs.length > MOST_RUNS) {
        throw new Error(
          `These are ${objects.runs.length} separate runs of objects: ${MOST_RUNS} are the most.`,
        );
      }
      await run(objects);
    } catch (error) {
      said.value = messageOf(error);
    }
  };
  const save = async () => {
    const pieces: string[] = [];
    try {
      for (rows.value = 0; rows.value !== undefined; ) {
        const { csv, next }: TableRows = await viewer.service.rows(text, rows.value);
        pieces.push(csv);
        rows.value = next;
      }
      download(new Blob(pieces, { type: "text/csv" }), `${viewer.scene.name}-found.csv`);
    } catch (error) {
      said.value = messageOf(error);
    }
    rows.value = undefined;
  };
  const keep = () => {
    const name = kept.addSet(text);
    said.value = `The set “${name}” is kept: Views lists it.`;
  };
  const select = async () => {
    const box = viewer.service.box(text).catch(() => undefined);
    await act(async (objects) => selection.pickAll(objects, await box))();
  };
  const hideAll = act((objects) => {
    view.change(hide(view.current.peek(), objects));
    selection.clear();
  });
  return (
    <fieldset
      class="found-actions"
      aria-label="All that is found"
      // Another query may be in the field, without an answer yet.
      disabled={text !== finding.text.value}
      // The field keeps the focus: some browsers give it to no button, and the list would close.
      onMouseDown={(event) => event.preventDefault()}
    >
      <Button text="Select" title="Pick all of these" onClick={() => void select()} />
      <Button
        text="Isolate"
        title="Show only these"
        onClick={() => void act((objects) => view.change(isolate(view.current.peek(), objects)))()}
      />
      <Button text="Hide" title="Hide all of these" onClick={() => void hideAll()} />
      <Button
        text={rows.value ? `CSV ${rows.value.toLocaleString("en")}` : "CSV"}
        title="Save names, paths, levels and attributes for a spreadsheet"
        disabled={rows.value !== undefined}
        onClick={() => void save()}
      />
      <Button text="Keep" title="Keep the query as a set, beside the views" onClick={keep} />
      <span class="palette">
        {PALETTE.map(({ name, colour }) => (
          <Button
            text=""
            key={name}
            aria-label={`Colour ${name}`}
            title={`Colour: ${name}`}
            style={{ background: cssOf(colour) }}
            onClick={() =>
              void act((objects) => {
                view.change(paint(view.current.peek(), { label: text, colour, objects }));
              })()
            }
          />
        ))}
      </span>
    </fieldset>
  );
}
