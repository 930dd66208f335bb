/** Searches for clashes, and lists them. */

import type { Signal } from "@preact/signals";
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { counted } from "../controls/counted.ts";
import { download } from "../controls/download.ts";
import { Quantities } from "../controls/quantities.tsx";
import type { Level } from "../objects/levels.ts";
import type { Selection } from "../objects/selection.ts";
import type { Clash, ClashPart } from "../service/service.ts";
import { placeText } from "../tools/coordinates.ts";
import { measuredText, unit } from "../tools/lengths.ts";
import { UnitChoice } from "../tools/unitChoice.tsx";
import type { Viewer } from "../viewer/viewer.ts";
import {
  type Choice as Chosen,
  Clashes,
  type ClashGroup,
  csvOf,
  groupsOf,
  type Ignored,
  nameOf,
  type Rest,
} from "./clashes.ts";

/** Rows of the list that are added at a time. */
const ROWS = 100;
const HARD = "Hard: the surfaces touch or intersect";

/** The searches of viewers: they go on while another panel is open. */
const searches = new WeakMap<Viewer, Clashes>();

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
  /** Whether no panel is open. Another one, such as that of notes, keeps the clash in the picture. */
  readonly isClosed: () => boolean;
}

export function ClashPanel({ viewer, selection, isClosed }: Properties) {
  const clashes = searches.get(viewer) ?? new Clashes(viewer, selection);
  searches.set(viewer, clashes);
  useEffect(() => {
    return () => {
      if (isClosed()) {
        clashes.leave();
      }
    };
  }, []);
  const running = clashes.running.value;
  const found = clashes.found.value;
  const picked = choiceOf(viewer, selection);
  return (
    <section
      class="panel clashes"
      aria-label="Clashes"
      onKeyDown={({ key }) => {
        if (key === "Escape") {
          clashes.leave();
        }
      }}
    >
      <SetRow name="Between" set={clashes.between} none="all objects" picked={picked} />
      <SetRow name="And" set={clashes.and} none="all others" picked={picked} />
      <label>
        Tolerance, mm{" "}
        <input
          type="text"
          inputMode="decimal"
          size={6}
          value={clashes.tolerance.value}
          onInput={({ currentTarget }) => {
            clashes.tolerance.value = currentTarget.value;
          }}
          onKeyDown={({ key }) => {
            if (key === "Enter") {
              void clashes.run();
            }
          }}
        />
      </label>
      <LevelChoice
        label="Ignore"
        level={clashes.ignore}
        selection={selection}
        none="nothing"
        text={(level) => `in the same ${level}`}
      />
      {running === undefined ? (
        <Button text="Run" onClick={() => void clashes.run()} />
      ) : (
        <>
          <progress
            aria-label="Compared objects"
            value={running.of === 0 ? undefined : running.done}
            max={Math.max(1, running.of)}
          />
          <Button text="Cancel" onClick={() => clashes.cancel()} />
        </>
      )}
      <p role="status" title={found?.length ? HARD : undefined}>
        {clashes.fault.value || (found && summary(found, clashes.ignored.value))}
      </p>
      {found !== undefined && found.length > 0 && (
        <Found viewer={viewer} selection={selection} clashes={clashes} found={found} key={found} />
      )}
    </section>
  );
}

/** A set of a search, with the ways to change it. */
function SetRow({
  name,
  set,
  none,
  picked,
}: {
  readonly name: string;
  readonly set: Signal<Chosen | undefined>;
  readonly none: string;
  readonly picked: Chosen | undefined;
}) {
  return (
    <p>
      {name}: <strong>{set.value?.label ?? none}</strong>{" "}
      <Button
        text="Take what is picked"
        aria-label={`${name}: take what is picked`}
        disabled={picked === undefined}
        onClick={() => {
          set.value = picked;
        }}
      />
      {set.value !== undefined && (
        <Button
          text={`Take ${none}`}
          aria-label={`${name}: take ${none}`}
          onClick={() => {
            set.value = undefined;
          }}
        />
      )}
    </p>
  );
}

/** A choice among the levels of groups that the model has. */
function LevelChoice({
  label,
  level,
  selection,
  none,
  text,
}: {
  readonly label: string;
  readonly level: Signal<Level>;
  readonly selection: Selection;
  readonly none: string;
  readonly text: (level: string) => string;
}) {
  return selection.levels.length === 1 ? null : (
    <Choice
      label={label}
      options={selection.levels.map((value) => ({
        value,
        text: value === "Primitive" ? none : text(value.toLowerCase()),
      }))}
      value={level.value}
      onChoose={(chosen) => {
        level.value = chosen;
      }}
    />
  );
}

/** The found clashes, with the ways to walk through them. */
function Found({
  viewer,
  selection,
  clashes,
  found,
}: {
  readonly viewer: Viewer;
  readonly selection: Selection;
  readonly clashes: Clashes;
  readonly found: readonly Clash[];
}) {
  const groupBy = clashes.groupBy.value;
  const shown = clashes.shown.value;
  return (
    <>
      <div>
        <Button text="Previous" onClick={() => clashes.step(-1)} />
        <Button text="Next" onClick={() => clashes.step(1)} />
        <Choice
          label="All others"
          options={(["ghosts", "hidden"] as const).map((value: Rest) => ({ value, text: value }))}
          value={clashes.rest.value}
          onChoose={(rest) => {
            clashes.rest.value = rest;
            if (clashes.shown.peek() !== undefined) {
              clashes.step(0);
            }
          }}
        />
        <Button
          text="CSV"
          title="Save the list as comma-separated values"
          onClick={() =>
            download(
              new Blob([csvOf(found, clashes.ignored.value)], { type: "text/csv" }),
              `${viewer.scene.name}-clashes.csv`,
            )
          }
        />
        <LevelChoice
          label="Group by"
          level={clashes.groupBy}
          selection={selection}
          none="nothing"
          text={(level) => level}
        />
        <UnitChoice />
      </div>
      {shown && (
        <p class="place">
          <Quantities text={placeText(viewer.scene.plant, shown.points[0], unit.value)} />
        </p>
      )}
      {groupBy === "Primitive" ? (
        <Rows clashes={clashes} found={found} />
      ) : (
        <Groups clashes={clashes} groups={groupsOf(found, groupBy)} key={groupBy} />
      )}
    </>
  );
}

/** A list. Its rows are added as they are wanted. */
function List<T>({ all, row }: { readonly all: readonly T[]; readonly row: (one: T) => ComponentChildren }) {
  const rows = useSignal(ROWS);
  return (
    <>
      <ol>{all.slice(0, rows.value).map(row)}</ol>
      {all.length > rows.value && (
        <Button
          text={`Show more of ${all.length.toLocaleString("en")}`}
          onClick={() => {
            rows.value += ROWS;
          }}
        />
      )}
    </>
  );
}

function Rows({ clashes, found }: { readonly clashes: Clashes; readonly found: readonly Clash[] }) {
  const shown = clashes.shown.value;
  const row = (clash: Clash) => (
    <li key={clash.parts.map(({ object }) => object).join()}>
      <button
        type="button"
        class="link"
        aria-current={clash === shown}
        title={clash.parts.map(pathOf).join("\n")}
        onClick={() => clashes.show(clash)}
      >
        <strong title={clash.kind === "hard" ? HARD : undefined}>{distanceOf(clash)}</strong>{" "}
        {clash.parts.map(nameOf).join(" · ")}
      </button>
    </li>
  );
  return <List all={found} row={row} />;
}

/** Pairs of groups. A click shows the clashes of one. */
function Groups({ clashes, groups }: { readonly clashes: Clashes; readonly groups: readonly ClashGroup[] }) {
  const opened = useSignal("");
  const row = (group: ClashGroup) => {
    const key = group.paths.join("\n");
    const isOpen = opened.value === key;
    return (
      <li key={key}>
        <button
          type="button"
          class="link"
          aria-expanded={isOpen}
          title={key}
          onClick={() => {
            opened.value = isOpen ? "" : key;
          }}
        >
          <strong>{counted(group.clashes.length, "clash", "clashes")}</strong> {group.names.join(" · ")}
        </button>
        {isOpen && <Rows clashes={clashes} found={group.clashes} />}
      </li>
    );
  };
  return <List all={groups} row={row} />;
}

/** The objects that are picked, and what they are called; nothing if none are. */
function choiceOf(viewer: Viewer, selection: Selection): Chosen | undefined {
  const objects = viewer.selected.value;
  const [part] = selection.parts.value;
  const { size } = objects;
  const count = counted(size, "object");
  const isOne = selection.count.value === 1 && part !== undefined && part.name !== "";
  return size === 0 ? undefined : { label: isOne ? `${part.name} (${count})` : count, objects };
}

function summary(found: readonly Clash[], ignored: Ignored | undefined): string {
  const hard = found.filter(({ kind }) => kind === "hard").length;
  const count = (of: number) => of.toLocaleString("en");
  const told =
    found.length === 0 ? "No clashes." : `Clashes: ${count(found.length)}, of them hard: ${count(hard)}.`;
  return ignored ? `${told} Ignored in the same ${ignored.level}: ${count(ignored.count)}.` : told;
}

function distanceOf({ kind, distance, error }: Clash): string {
  return kind === "hard" ? "hard" : measuredText(distance, error, unit.value);
}

function pathOf(part: ClashPart): string {
  return [...part.path, nameOf(part)].join(" > ");
}
