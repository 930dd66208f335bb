/** A field that finds parts by their names and attributes. */

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { isForControl } from "../navigate/typing.ts";
import { messageOf } from "../service/errors.ts";
import type { Parts } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { goTo } from "./commands.ts";
import { nameOf } from "./detailsPanel.tsx";
import type { Selection } from "./selection.ts";

/** Milliseconds without a key before the search. */
const PAUSE = 150;

/** The results shown so far. */
interface Found extends Parts {
  readonly text: string;
}

const NONE: Parts = { parts: [], total: 0 };

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function SearchBox({ viewer, selection }: Properties) {
  const found = useSignal<Found | undefined>(undefined);
  const isOpen = useSignal(false);
  const at = useSignal(0);
  const field = useRef<HTMLInputElement>(null);
  const list = useRef<HTMLDivElement>(null);
  const asked = useRef<AbortController | undefined>(undefined);

  useEffect(() => {
    const focus = (event: KeyboardEvent) => {
      if (event.key === "/" && !isForControl(event)) {
        event.preventDefault();
        field.current?.focus();
        field.current?.select();
      }
    };
    addEventListener("keydown", focus);
    return () => removeEventListener("keydown", focus);
  }, []);
  // Before the browser paints, so that the selected row is always visible.
  useLayoutEffect(() => {
    list.current?.querySelector("[aria-selected=true]")?.scrollIntoView({ block: "nearest" });
  }, [at.value, isOpen.value]);

  /** Searches for a text, from a row on; an earlier search is cancelled. */
  const ask = async (text: string, from: number, pause: number) => {
    asked.current?.abort();
    const asking = new AbortController();
    asked.current = asking;
    await new Promise((resolve) => setTimeout(resolve, pause));
    try {
      const isEmpty = text.trim() === "";
      const answer =
        isEmpty || asking.signal.aborted ? NONE : await viewer.service.search(text, from, asking.signal);
      if (asking.signal.aborted) {
        return;
      }
      const before = from === 0 ? [] : (found.peek()?.parts ?? []);
      found.value = isEmpty ? undefined : { ...answer, text, parts: [...before, ...answer.parts] };
      isOpen.value = !isEmpty;
      if (from === 0) {
        at.value = 0;
      }
    } catch (error) {
      if (!asking.signal.aborted) {
        viewer.said.value = messageOf(error);
      }
    }
  };
  const more = () => ask(found.peek()?.text ?? "", found.peek()?.parts.length ?? 0, 0);
  const close = () => {
    asked.current?.abort();
    isOpen.value = false;
  };
  const choose = async (index: number) => {
    const part = found.peek()?.parts[index];
    if (part !== undefined) {
      // It stays selected for when the person returns.
      at.value = index;
      close();
      viewer.canvas.focus();
      goTo(viewer, await selection.pick(part));
    }
  };
  const step = async (by: number) => {
    const { parts = [], total = 0 } = found.peek() ?? {};
    const next = Math.max(0, at.peek() + by);
    if (!isOpen.peek()) {
      isOpen.value = found.peek() !== undefined;
      return;
    }
    if (next >= parts.length && parts.length < total) {
      await more();
    }
    at.value = Math.min(Math.max(0, (found.peek()?.parts.length ?? 0) - 1), next);
  };
  const press = async (event: KeyboardEvent & { readonly currentTarget: HTMLInputElement }) => {
    const text = event.currentTarget.value;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      await step(event.key === "ArrowDown" ? 1 : -1);
    } else if (event.key === "Enter") {
      if (found.peek()?.text !== text) {
        await ask(text, 0, 0);
      }
      await choose(at.peek());
    } else if (event.key === "Escape") {
      close();
      viewer.canvas.focus();
    }
  };

  const shown = isOpen.value ? found.value : undefined;
  return (
    <search
      class="panel search"
      onFocusOut={({ currentTarget, relatedTarget }) => {
        if (!(relatedTarget instanceof Node && currentTarget.contains(relatedTarget))) {
          close();
        }
      }}
    >
      <input
        ref={field}
        type="text"
        role="combobox"
        placeholder="Search (/)"
        aria-label="Search names and attributes"
        aria-controls="found"
        aria-expanded={shown !== undefined}
        aria-activedescendant={shown && `found-${at.value}`}
        onInput={(event) => void ask(event.currentTarget.value, 0, PAUSE)}
        onFocus={() => {
          isOpen.value = found.peek() !== undefined;
        }}
        onKeyDown={(event) => void press(event)}
      />
      {shown && (
        <div id="found" ref={list}>
          <div role="listbox" aria-label="Found" onMouseDown={keepFocus}>
            {shown.parts.map((part, index) => (
              <Button
                text={nameOf(part)}
                role="option"
                id={`found-${index}`}
                tabIndex={-1}
                aria-selected={index === at.value}
                key={`${part.kind}${part.id}`}
                onClick={() => void choose(index)}
              />
            ))}
          </div>
          <p>
            {summary(shown)}{" "}
            {shown.parts.length < shown.total && (
              <Button text="Show more" class="link" onMouseDown={keepFocus} onClick={() => void more()} />
            )}
          </p>
        </div>
      )}
    </search>
  );
}

/** The field keeps the focus, so that the list stays open until something is chosen. */
function keepFocus(event: MouseEvent): void {
  event.preventDefault();
}

function summary({ parts, total }: Parts): string {
  return total === 0 ? "Nothing has that name." : total > parts.length ? `${parts.length} of ${total}` : "";
}
