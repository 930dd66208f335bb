/** What a person does to objects, as changes of a view. */

import type { ObjectSet } from "../proto/objectSet.ts";
import { ObjectSet as Objects } from "../proto/objectSet.ts";
import type { UserView } from "../viewer/viewHistory.ts";

/** A change of what is shown. */
export type Change = Partial<UserView>;

/** These are not drawn any more. */
export function hide(view: UserView, objects: ObjectSet): Change {
  const { isolated } = view;
  return { hidden: view.hidden.union(objects), isolated: isolated?.minus(objects) };
}

/** These are drawn, whatever was hidden or isolated before. */
export function show(view: UserView, objects: ObjectSet): Change {
  return { hidden: view.hidden.minus(objects), isolated: view.isolated?.union(objects) };
}

/** Only these are drawn. */
export function isolate(view: UserView, objects: ObjectSet): Change {
  return { isolated: objects, hidden: view.hidden.minus(objects) };
}

/** The rest shines through these, or no longer if it does through all of them. */
export function toggleSeeThrough(view: UserView, objects: ObjectSet): Change {
  const { seeThrough } = view;
  return { seeThrough: seeThrough.covers(objects) ? seeThrough.minus(objects) : seeThrough.union(objects) };
}

/** All objects are drawn as the model has them, and nothing is cut away. */
export function showAll(modelSeeThrough = Objects.EMPTY): Change {
  return { hidden: Objects.EMPTY, isolated: undefined, seeThrough: modelSeeThrough, sections: [] };
}

/** How much of these is drawn. */
export function visibility(view: UserView, objects: ObjectSet): "all" | "some" | "none" {
  const { isolated, hidden } = view;
  const drawn = (isolated === undefined ? objects : objects.minus(objects.minus(isolated))).minus(hidden);
  return drawn.isEmpty ? "none" : drawn.size === objects.size ? "all" : "some";
}

/** What of the model is not drawn as it is, in a few words; empty where all is. */
export function told({ sections, hidden, isolated, seeThrough }: UserView): string {
  const parts = [
    sections.length > 0 && `cut by ${sections.length} ${sections.length === 1 ? "section" : "sections"}`,
    isolated && `only ${isolated.size} shown`,
    !hidden.isEmpty && `${hidden.size} hidden`,
    !seeThrough.isEmpty && `${seeThrough.size} see-through`,
  ];
  return parts.filter(Boolean).join(", ");
}
