/** A field that finds parts by their names and attributes. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { isForControl } from "../navigate/typing.ts";
import type { Part, Parts } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { messageOf } from "../wire/errors.ts";
import { goTo } from "./commands.ts";
import { nameOf } from "./detailsPanel.tsx";
import type { Selection } from "./selection.ts";

/** Milliseconds without a key until it is asked. */
const PAUSE = 150;

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function SearchBox({ viewer, selection }: Properties) {
  const found = useSignal<Parts | undefined>(undefined);
  const at = useSignal(0);
  const field = useRef<HTMLInputElement>(null);
  const asked = useRef<AbortController | undefined>(undefined);

  useEffect(() => {
    const focus = (event: KeyboardEvent) => {
      if (event.key === "/" && !isForControl(event)) {
        event.preventDefault();
        field.current?.focus();
      }
    };
    addEventListener("keydown", focus);
    return () => removeEventListener("keydown", focus);
  }, []);

  const ask = async (text: string) => {
    asked.current?.abort();
    const asking = new AbortController();
    asked.current = asking;
    await new Promise((resolve) => setTimeout(resolve, PAUSE));
    if (asking.signal.aborted) {
      return;
    }
    try {
      const answer = text.trim() === "" ? undefined : await viewer.service.search(text, asking.signal);
      [found.value, at.value] = [answer, 0];
    } catch (error) {
      if (!asking.signal.aborted) {
        viewer.said.value = messageOf(error);
      }
    }
  };
  const choose = async (part: Part | undefined) => {
    if (part !== undefined) {
      found.value = undefined;
      viewer.canvas.focus();
      goTo(viewer, await selection.pick(part));
    }
  };
  const press = (event: KeyboardEvent) => {
    const parts = found.value?.parts ?? [];
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      const step = event.key === "ArrowDown" ? 1 : -1;
      at.value = Math.max(0, Math.min(parts.length - 1, at.value + step));
    } else if (event.key === "Enter") {
      void choose(parts[at.value]);
    } else if (event.key === "Escape") {
      found.value = undefined;
      viewer.canvas.focus();
    }
  };

  return (
    <search class="panel search">
      <input
        ref={field}
        type="search"
        placeholder="Search (/)"
        aria-label="Search names and attributes"
        aria-controls="found"
        onInput={(event) => void ask(event.currentTarget.value)}
        onKeyDown={press}
      />
      {found.value && (
        <div id="found" role="listbox" aria-label="Found">
          {found.value.parts.map((part, index) => (
            <button
              type="button"
              role="option"
              aria-selected={index === at.value}
              key={`${part.kind}${part.id}`}
              onClick={() => void choose(part)}
            >
              {nameOf(part)}
            </button>
          ))}
          <p>{summary(found.value)}</p>
        </div>
      )}
    </search>
  );
}

function summary({ parts, total }: Parts): string {
  return total === 0 ? "Nothing has that name." : total > parts.length ? `${parts.length} of ${total}` : "";
}
