/** The model's hierarchy, with what of it is drawn. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Part } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { hide, show, visibility } from "./actions.ts";
import { goTo } from "./commands.ts";
import { nameOf } from "./detailsPanel.tsx";
import type { Selection } from "./selection.ts";

interface Properties {
  readonly viewer: Viewer;
  readonly selection: Selection;
}

export function TreePanel(properties: Properties) {
  return (
    <section class="panel tree" aria-label="Model">
      <Branch {...properties} group={undefined} />
    </section>
  );
}

/** The parts of a group: some at first, more when they are asked for. */
function Branch({ viewer, selection, group }: Properties & { readonly group: number | undefined }) {
  const parts = useSignal<readonly Part[]>([]);
  const total = useSignal(0);
  const more = async () => {
    try {
      const answer = await viewer.service.children(group, parts.value.length);
      parts.value = [...parts.value, ...answer.parts];
      total.value = answer.total;
    } catch (error) {
      viewer.said.value = error instanceof Error ? error.message : String(error);
    }
  };
  // Once, when the branch opens.
  useEffect(() => void more(), []);
  return (
    <ul class="branch">
      {parts.value.map((part) => (
        <Row key={`${part.kind}${part.id}`} viewer={viewer} selection={selection} part={part} />
      ))}
      {parts.value.length < total.value && (
        <li>
          <button type="button" class="link" onClick={() => void more()}>
            {total.value - parts.value.length} more
          </button>
        </li>
      )}
    </ul>
  );
}

function Row({ viewer, selection, part }: Properties & { readonly part: Part }) {
  const isOpen = useSignal(false);
  const objects = ObjectSet.run(part.first, part.end);
  const drawn = visibility(viewer.view.current.value, objects);
  const toggle = () => {
    const view = viewer.view.current.peek();
    viewer.view.change(drawn === "all" ? hide(view, objects) : show(view, objects));
  };
  const name = nameOf(part);
  const isPicked = !viewer.selected.value.isEmpty && viewer.selected.value.covers(objects);
  return (
    <li>
      <div class="row">
        {part.kind === "group" ? (
          <button
            type="button"
            aria-expanded={isOpen.value}
            aria-label={`What is in ${name}`}
            onClick={() => {
              isOpen.value = !isOpen.value;
            }}
          >
            {isOpen.value ? "▾" : "▸"}
          </button>
        ) : (
          <span class="leaf" />
        )}
        <input
          type="checkbox"
          aria-label={`Show ${name}`}
          checked={drawn === "all"}
          indeterminate={drawn === "some"}
          onChange={toggle}
        />
        <button
          type="button"
          class="link"
          aria-pressed={isPicked}
          onClick={() => void selection.pick(part)}
          onDblClick={async () => goTo(viewer, await selection.pick(part))}
        >
          {name}
        </button>
      </div>
      {isOpen.value && <Branch viewer={viewer} selection={selection} group={part.id} />}
    </li>
  );
}
