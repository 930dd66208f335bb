/** A field for queries, and the list of all that they find. */

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { counted } from "../controls/counted.ts";
import { lazy } from "../controls/lazy.tsx";
import { isForControl } from "../navigate/typing.ts";
import { nameOf, type QueryFault } from "../service/service.ts";
import type { KeptViewpoints } from "../tools/kept.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { goTo } from "./commands.ts";
import type { Finding, Found } from "./finding.ts";
import { heightOf, rowsAt, scrolledTo } from "./rowWindow.ts";
import type { Selection } from "./selection.ts";

const FoundActions = lazy(async () => (await import("./foundActions.tsx")).FoundActions);

/** Milliseconds without a key before the search. */
const PAUSE = 150;
/** Rows that the keys of pages move by. */
const PAGE = 10;
/** Heights of a row, for a mouse and for a finger, CSS pixels: as in the style sheet. */
const [ROW, TOUCHED_ROW] = [26, 44];
/** A name and an attribute, as one may search for them. */
const EXAMPLES = "20-CE50 or type=VALV";

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
  readonly finding: Finding;
  readonly kept: KeptViewpoints;
}

export function SearchBox({ viewer, selection, finding, kept }: Properties) {
  const at = useSignal(0);
  const isFocused = useSignal(false);
  const field = useRef<HTMLInputElement>(null);
  finding.focus = () => field.current?.focus();

  useEffect(() => {
    const focus = (event: KeyboardEvent) => {
      if (event.key === "/" && !isForControl(event)) {
        event.preventDefault();
        field.current?.focus();
        field.current?.select();
        finding.open();
      }
    };
    addEventListener("keydown", focus);
    return () => removeEventListener("keydown", focus);
  }, []);
  // With the list, before the next key.
  useLayoutEffect(() => {
    at.value = 0;
  }, [finding.found.value]);

  const leave = () => {
    finding.close();
    viewer.canvas.focus();
  };
  const choose = async (index: number) => {
    const part = await finding.arrived(index);
    if (part !== undefined) {
      // It stays selected for when the person returns.
      at.value = index;
      leave();
      goTo(viewer, await selection.pick(part));
    }
  };
  const step = (by: number) => {
    const { total = 0 } = finding.found.peek() ?? {};
    if (finding.isOpen.peek()) {
      at.value = Math.max(0, Math.min(total - 1, at.peek() + by));
    } else {
      finding.open();
    }
  };
  const press = async (event: KeyboardEvent & { readonly currentTarget: HTMLInputElement }) => {
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: PAGE, PageUp: -PAGE }[event.key];
    if (by !== undefined) {
      event.preventDefault();
      step(by);
    } else if (event.key === "Enter") {
      const text = event.currentTarget.value;
      if (finding.found.peek()?.text !== text) {
        await finding.ask(text);
        at.value = 0;
      }
      // Without an answer, or after another key, nothing is chosen.
      if (finding.found.peek()?.text === text) {
        await choose(at.peek());
      }
    }
  };

  const shown = finding.isOpen.value ? finding.found.value : undefined;
  const trouble = finding.isOpen.value ? finding.trouble.value : "";
  const hasRows = shown !== undefined && shown.total > 0;
  return (
    <search
      class="panel search"
      onKeyDown={(event) => {
        if (event.key === "Escape") {
          event.stopPropagation();
          leave();
        }
      }}
      onFocusOut={({ currentTarget, relatedTarget }) => {
        if (!(relatedTarget instanceof Node && currentTarget.contains(relatedTarget))) {
          finding.close();
        }
      }}
    >
      <input
        ref={field}
        type="text"
        role="combobox"
        placeholder={isFocused.value ? EXAMPLES : "Search (/)"}
        aria-label="Search names and attributes"
        aria-controls="found"
        aria-expanded={hasRows}
        aria-activedescendant={hasRows ? `found-${at.value}` : undefined}
        aria-invalid={shown?.fault !== undefined}
        aria-describedby="found-summary"
        autocomplete="off"
        spellcheck={false}
        value={finding.text.value}
        onInput={(event) => void finding.ask(event.currentTarget.value, PAUSE)}
        onFocus={() => {
          isFocused.value = true;
        }}
        onBlur={() => {
          isFocused.value = false;
        }}
        // With Tab one passes the field, and the list stays closed.
        onClick={() => finding.open()}
        onKeyDown={(event) => void press(event)}
      />
      {hasRows && <FoundList finding={finding} found={shown} at={at.value} choose={choose} />}
      {shown && (
        <p id="found-summary" role="status">
          {shown.fault ? <Fault query={shown.text} fault={shown.fault} /> : summaryOf(shown)}
        </p>
      )}
      {trouble !== "" && (
        <p id="found-summary" role="status">
          {trouble}
        </p>
      )}
      {hasRows && <FoundActions viewer={viewer} selection={selection} finding={finding} kept={kept} />}
    </search>
  );
}

/** The list of all found parts. Only the rows that show are elements. */
function FoundList({
  finding,
  found,
  at,
  choose,
}: {
  readonly finding: Finding;
  readonly found: Found;
  readonly at: number;
  readonly choose: (index: number) => Promise<void>;
}) {
  const place = useRef<HTMLDivElement>(null);
  const scrolled = useSignal(0);
  const view = useSignal(0);
  const row = matchMedia("(pointer: coarse)").matches ? TOUCHED_ROW : ROW;
  const list = { total: found.total, row, view: view.value };
  // Before the browser paints, so that the selected row is always visible.
  useLayoutEffect(() => {
    if (place.current !== null) {
      view.value = place.current.clientHeight;
      place.current.scrollTop = scrolledTo({ ...list, view: view.value }, at, place.current.scrollTop);
      scrolled.value = place.current.scrollTop;
    }
  }, [at, found]);
  const { first, end, top } = rowsAt(list, scrolled.value);
  return (
    <div
      id="found"
      ref={place}
      onScroll={({ currentTarget }) => {
        [view.value, scrolled.value] = [currentTarget.clientHeight, currentTarget.scrollTop];
      }}
    >
      <div
        class="found-rows"
        role="listbox"
        aria-label="Found"
        style={{ height: `${heightOf(list)}px` }}
        onMouseDown={keepFocus}
      >
        {Array.from({ length: end - first }, (_, place) => {
          const index = first + place;
          const part = finding.part(index);
          const name = part === undefined ? "…" : nameOf(part);
          return (
            <Button
              text={parted(name).map((piece, at) => <span key={at}>{piece}</span>)}
              title={name}
              aria-label={name}
              role="option"
              id={`found-${index}`}
              key={index}
              tabIndex={-1}
              style={{ top: `${top + place * row}px` }}
              aria-selected={index === at}
              aria-posinset={index + 1}
              aria-setsize={found.total}
              onClick={() => void choose(index)}
            />
          );
        })}
      </div>
    </div>
  );
}

/** The query with its wrong place marked, and what is wrong. */
function Fault({ query, fault }: { readonly query: string; readonly fault: QueryFault }) {
  const { at, end, text } = fault;
  return (
    <>
      <code>
        {query.slice(0, at)}
        <mark>{query.slice(at, end) || "␣"}</mark>
        {query.slice(end)}
      </code>
      <br />
      {text}
    </>
  );
}

/** The field keeps the focus, so that the list stays open until something is chosen. */
function keepFocus(event: MouseEvent): void {
  event.preventDefault();
}

/** The beginning of a name, and its last letters, which show however long it is. */
export function parted(name: string): readonly string[] {
  return /^(.*?)(.{0,12})$/su.exec(name)?.slice(1) ?? [name];
}

/** How much is found. */
export function summaryOf({ total, objects }: Pick<Found, "total" | "objects">): string {
  if (total === 0) {
    return `Nothing is found. Search for a name or an attribute, such as ${EXAMPLES}.`;
  }
  return `${counted(total, "part")}, ${counted(objects, "object")}`;
}
