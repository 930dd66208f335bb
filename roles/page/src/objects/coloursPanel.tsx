/** Colours by an attribute, and the legend of all colours. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { legendOf, NO_COLOURS, REST } from "../draw/colours.ts";
import { cssOf } from "../draw/palettes.ts";
import { messageOf } from "../service/errors.ts";
import type { AttributeName } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { colouringBy } from "./colouring.ts";
import type { Selection } from "./selection.ts";

export function ColoursPanel({
  viewer,
  selection,
}: {
  readonly viewer: Viewer;
  readonly selection: Selection;
}) {
  const { view, service, said } = viewer;
  const { colouring } = view.current.value;
  const attributes = useSignal<readonly AttributeName[] | undefined>(undefined);
  const isAsking = useSignal(false);
  useEffect(() => {
    service.attributes().then(
      (all) => {
        attributes.value = all;
      },
      (error) => {
        said.value = messageOf(error);
      },
    );
  }, [viewer]);
  const colour = async (by: string) => {
    isAsking.value = true;
    try {
      view.change({ colouring: by === "" ? NO_COLOURS : colouringBy(by, await service.classes(by)) });
    } catch (error) {
      said.value = messageOf(error);
    }
    isAsking.value = false;
  };
  const known = attributes.value ?? [];
  // A view of a link may be coloured by any attribute.
  const others = known.some(({ name }) => name === colouring.by) ? [] : [{ name: colouring.by, parts: 0 }];
  const options = [{ name: "", parts: 0 }, ...known, ...(colouring.by === "" ? [] : others)];
  return (
    <section class="colours" aria-label="Colours">
      {attributes.value?.length === 0 ? (
        <p>The model has no attributes to colour by.</p>
      ) : (
        <Choice
          label="Colour by"
          options={options.map(({ name, parts }) => ({
            value: name,
            text:
              name === "" ? "no attribute" : parts === 0 ? name : `${name} (${parts.toLocaleString("en")})`,
          }))}
          value={colouring.by}
          onChoose={(by) => void colour(by)}
        />
      )}
      {isAsking.value && <p role="status">…</p>}
      <ul aria-label="Legend">
        {legendOf(colouring).map(({ label, colours, objects }, place) => (
          <li key={`${place} ${label}`}>
            <button
              type="button"
              class="link"
              title="Pick all of these"
              onClick={() => selection.pickAll(objects)}
            >
              <span class="swatch" aria-hidden="true">
                {colours.map((colour) => (
                  <i key={colour} style={{ background: cssOf(colour) }} />
                ))}
              </span>
              {label || "empty"} <span class="count">{objects.size.toLocaleString("en")}</span>
            </button>
          </li>
        ))}
        {colouring.by !== "" && (
          <li>
            <span class="swatch" aria-hidden="true">
              <i style={{ background: cssOf(REST) }} />
            </span>
            all others
          </li>
        )}
      </ul>
      {colouring.paints.length > 0 && (
        <Button text="Remove colours" onClick={() => view.change({ colouring: NO_COLOURS })} />
      )}
    </section>
  );
}
