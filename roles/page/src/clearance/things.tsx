/** The shortest distance between two parts, one picked after the other. */

import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Selection } from "../objects/selection.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import { nameOf, type PartDetails } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function Things({ viewer, selection }: Properties) {
  const parts = useSignal<readonly PartDetails[]>([]);
  const said = useSignal("");
  const asked = useRef<AbortController | undefined>(undefined);
  useEffect(() => () => asked.current?.abort(), []);
  // Each part that is picked is the next one.
  useSignalEffect(() => {
    const picked = selection.details.value;
    const before = parts.peek();
    const last = before.at(-1);
    if (picked === undefined || (picked.kind === last?.kind && picked.id === last.id)) {
      return;
    }
    parts.value = [...(before.length === 1 ? before : []), picked];
    const [first, second] = parts.peek();
    asked.current?.abort();
    said.value = "";
    if (first !== undefined && second !== undefined) {
      void measure(first, second);
    }
  });
  const measure = async (first: PartDetails, second: PartDetails) => {
    const { service, view } = viewer;
    const asking = new AbortController();
    asked.current = asking;
    said.value = "Measuring…";
    try {
      const { distance, isHard, error, points, fault } = await service.clearance(
        first,
        second,
        asking.signal,
      );
      if (asking.signal.aborted) {
        return;
      }
      said.value = fault ?? (isHard || distance === 0 ? "They touch or intersect." : "");
      if (fault === undefined) {
        const [from, to] = points.map((point) => ({ point, error: error / 2 }));
        const { distances } = view.current.peek();
        view.change(from && to ? { distances: [...distances, { from, to }] } : {});
        // Both show which parts are meant.
        viewer.selected.value = ObjectSet.run(first.first, first.end).union(
          ObjectSet.run(second.first, second.end),
        );
      }
    } catch (error) {
      if (!asking.signal.aborted) {
        said.value = messageOf(error);
      }
    }
  };
  return (
    <>
      <ol aria-label="Parts">
        {parts.value.map((part) => (
          <li key={`${part.kind}${part.id}`}>{nameOf(part)}</li>
        ))}
      </ol>
      <p role="status">{said.value}</p>
    </>
  );
}
