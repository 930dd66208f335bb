/** The model's hierarchy, with the visibility of its parts. One row has the focus: arrow keys move it. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import { nameOf, type Part, type PartDetails } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { hide, show, visibility } from "./actions.ts";
import { goTo } from "./commands.ts";
import type { Selection } from "./selection.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

interface Place {
  /** From 1 on. */
  readonly level: number;
  /** The key of the row that Tab leads to; empty for the first one. */
  readonly current: Signal<string>;
}

const ROWS = "[role=treeitem]";

export function TreePanel(properties: Properties) {
  const current = useSignal("");
  return (
    <section class="tree" aria-label="Model">
      <Branch {...properties} group={undefined} level={1} current={current} />
    </section>
  );
}

/** The parts of a group: some at first, more on request. */
function Branch(properties: Properties & Place & { readonly group: number | undefined }) {
  const { viewer, selection, group, level, current } = properties;
  const parts = useSignal<readonly Part[]>([]);
  const total = useSignal(0);
  const list = useRef<HTMLUListElement>(null);
  const isLoading = useRef(false);
  const more = async () => {
    if (isLoading.current) {
      return;
    }
    isLoading.current = true;
    try {
      const answer = await viewer.service.children(group, parts.value.length);
      parts.value = [...parts.value, ...answer.parts];
      total.value = answer.total;
    } catch (error) {
      viewer.said.value = messageOf(error);
    } finally {
      isLoading.current = false;
    }
  };
  // Once, when the branch opens.
  useEffect(() => void more(), []);
  const chain = chainOf(selection.located.value);
  const wanted = level === 1 || chain[level - 2] === `group${group}` ? chain[level - 1] : undefined;
  // The row of a located part may be far down.
  useEffect(() => {
    const { length } = parts.value;
    if (wanted !== undefined && length > 0 && length < total.value && !parts.value.some(isCalled(wanted))) {
      void more();
    }
  }, [wanted, parts.value]);
  /** The first of the new rows replaces the row that requested them. */
  const goOn = async () => {
    const shown = parts.value.length;
    await more();
    requestAnimationFrame(() => focusRow(list.current?.children[shown]));
  };
  return (
    <ul class="branch" ref={list} role={level === 1 ? "tree" : "group"} aria-label="Model">
      {parts.value.map((part, index) => (
        <Row
          {...properties}
          key={keyOf(part)}
          part={part}
          isCurrent={current.value === "" ? level === 1 && index === 0 : current.value === keyOf(part)}
        />
      ))}
      {parts.value.length < total.value && (
        <li
          role="treeitem"
          aria-level={level}
          tabIndex={-1}
          onKeyDown={(event) => {
            if (event.key === "Enter" || event.key === " ") {
              event.preventDefault();
              void goOn();
            } else {
              walk(event);
            }
          }}
          onClick={() => void goOn()}
        >
          <span class="link">{total.value - parts.value.length} more</span>
        </li>
      )}
    </ul>
  );
}

function Row({
  viewer,
  selection,
  part,
  level,
  current,
  isCurrent,
}: Properties & Place & { readonly part: Part; readonly isCurrent: boolean }) {
  const isOpen = useSignal(false);
  const item = useRef<HTMLLIElement>(null);
  const isGroup = part.kind === "group";
  const located = selection.located.value;
  useEffect(() => {
    const chain = chainOf(located);
    if (chain.at(-1) === keyOf(part)) {
      selection.located.value = undefined;
      focusRow(item.current);
    } else if (chain.includes(keyOf(part))) {
      isOpen.value = true;
    }
  }, [located]);
  const objects = ObjectSet.run(part.first, part.end);
  const drawn = visibility(viewer.view.current.value, objects);
  const name = nameOf(part);
  const isPicked = !viewer.selected.value.isEmpty && viewer.selected.value.covers(objects);
  const toggle = () => {
    const view = viewer.view.current.peek();
    viewer.view.change(drawn === "all" ? hide(view, objects) : show(view, objects));
  };
  const open = (isToBe: boolean) => {
    // The rows below go, perhaps with the row that Tab leads to.
    [isOpen.value, current.value] = [isToBe, keyOf(part)];
  };
  const press = (event: KeyboardEvent) => {
    const { key, target, currentTarget } = event;
    if (!(target instanceof Element) || target.closest(ROWS) !== currentTarget) {
      return;
    }
    if (key === "Enter") {
      void selection.pick(part);
    } else if (key === " " && target === currentTarget) {
      toggle();
    } else if (key === "ArrowRight" && isGroup && !isOpen.value) {
      open(true);
    } else if (key === "ArrowLeft" && isOpen.value) {
      open(false);
    } else {
      walk(event);
      return;
    }
    event.preventDefault();
  };
  return (
    <li
      ref={item}
      role="treeitem"
      aria-level={level}
      aria-label={name}
      aria-selected={isPicked}
      aria-expanded={isGroup ? isOpen.value : undefined}
      tabIndex={isCurrent ? 0 : -1}
      onKeyDown={press}
      onFocus={() => {
        current.value = keyOf(part);
      }}
    >
      <div class="row">
        {isGroup ? (
          <Button
            text={isOpen.value ? "▾" : "▸"}
            tabIndex={-1}
            aria-label={`What is in ${name}`}
            onClick={() => open(!isOpen.value)}
          />
        ) : (
          <span class="leaf" />
        )}
        <input
          type="checkbox"
          tabIndex={-1}
          aria-label={`Show ${name}`}
          checked={drawn === "all"}
          indeterminate={drawn === "some"}
          onChange={toggle}
        />
        <Button
          text={name}
          class="link"
          tabIndex={-1}
          aria-pressed={isPicked}
          onClick={(event) => {
            focusRow(event.currentTarget.closest(ROWS));
            selection.click(part, event);
          }}
          onDblClick={async () => goTo(viewer, await selection.pick(part))}
        />
      </div>
      {isOpen.value && (
        <Branch viewer={viewer} selection={selection} group={part.id} level={level + 1} current={current} />
      )}
    </li>
  );
}

function keyOf({ kind, id }: Pick<Part, "kind" | "id">): string {
  return `${kind}${id}`;
}

function isCalled(key: string): (part: Part) => boolean {
  return (part) => keyOf(part) === key;
}

/** The keys of the rows that lead to a part, and of its own row, from the outermost. */
function chainOf(part: PartDetails | undefined): readonly string[] {
  return part === undefined ? [] : [...part.path, part].map(keyOf);
}

/** Moves to another row, by the usual keys of trees. */
function walk(event: KeyboardEvent): void {
  const { target, key } = event;
  const row = target instanceof Element ? target.closest(ROWS) : null;
  const rows = [...(row?.closest("[role=tree]")?.querySelectorAll(ROWS) ?? [])];
  const at = row === null ? -1 : rows.indexOf(row);
  const ways: Readonly<Record<string, Element | null | undefined>> = {
    ArrowDown: rows[at + 1],
    ArrowUp: rows[at - 1],
    ArrowLeft: row?.parentElement?.closest(ROWS),
    ArrowRight: row?.querySelector(ROWS),
    Home: rows[0],
    End: rows.at(-1),
  };
  if (key in ways) {
    event.preventDefault();
    focusRow(ways[key]);
  }
}

function focusRow(row: Element | null | undefined): void {
  if (row instanceof HTMLElement) {
    row.focus();
    row.querySelector(".row")?.scrollIntoView({ block: "nearest" });
  }
}
