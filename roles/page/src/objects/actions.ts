/** A person's actions on objects, as changes of a view. */

import { counted } from "../controls/counted.ts";
import { MOST_PAINTS, type Paint } from "../draw/colours.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import { drawnOf, hasGhosts, measuredOf, type UserView } from "../viewer/viewHistory.ts";

/** A change of the view. */
export type Change = Partial<UserView>;

/** Hides these. */
export function hide(view: UserView, objects: ObjectSet): Change {
  const { isolated } = view;
  return { hidden: view.hidden.union(objects), isolated: isolated?.minus(objects) };
}

/** Draws these, even if they were hidden or not isolated. */
export function show(view: UserView, objects: ObjectSet): Change {
  return { hidden: view.hidden.minus(objects), isolated: view.isolated?.union(objects) };
}

/** Only these are drawn. */
export function isolate(view: UserView, objects: ObjectSet): Change {
  return { isolated: objects, hidden: view.hidden.minus(objects) };
}

/** Makes these see-through, or opaque again if all of them are. */
export function toggleSeeThrough(view: UserView, objects: ObjectSet): Change {
  const { seeThrough } = view;
  return { seeThrough: seeThrough.covers(objects) ? seeThrough.minus(objects) : seeThrough.union(objects) };
}

/** All other objects are ghosts: see-through. Objects that the model has see-through stay so. */
export function ghostRest(
  solid: ObjectSet,
  objectCount: number,
  modelSeeThrough = ObjectSet.EMPTY,
): Pick<UserView, "seeThrough"> {
  return { seeThrough: ObjectSet.run(0, objectCount).minus(solid.minus(modelSeeThrough)) };
}

/** Colours objects, over all colours before. Of too many colours the first one is dropped. */
export function paint({ colouring }: UserView, added: Paint): Change {
  // A colour that lies wholly below another one shows nowhere.
  const left = colouring.paints.filter(({ objects }) => !added.objects.covers(objects));
  return { colouring: { ...colouring, paints: [...left, added].slice(-MOST_PAINTS) } };
}

/** Draws all objects as in the model, without sections. Colours and measures stay. */
export function showAll({ distances }: UserView, modelSeeThrough = ObjectSet.EMPTY): Change {
  return {
    hidden: ObjectSet.EMPTY,
    isolated: undefined,
    seeThrough: modelSeeThrough,
    sections: [],
    distances: measuredOf(distances),
  };
}

/** How many of these are drawn. */
export function visibility(view: UserView, objects: ObjectSet): "all" | "some" | "none" {
  const drawn = drawnOf(view, objects);
  return drawn.isEmpty ? "none" : drawn.size === objects.size ? "all" : "some";
}

/** Describes the changes of a model's view in a few words; empty without changes. */
export function told(view: UserView, objectCount: number, model = ObjectSet.EMPTY): string {
  const { sections, hidden, isolated, seeThrough, colouring } = view;
  const solid = objectCount - seeThrough.size;
  const parts = [
    sections.length > 0 && `cut by ${counted(sections.length, "section")}`,
    isolated && `only ${isolated.size} shown`,
    !hidden.isEmpty && `${hidden.size} hidden`,
    hasGhosts(view, objectCount, model)
      ? `ghosts: all but ${solid.toLocaleString("en")}`
      : !seeThrough.isEmpty && `${seeThrough.size} see-through`,
    colouring.paints.length > 0 && (colouring.by === "" ? "coloured" : `coloured by ${colouring.by}`),
  ];
  return parts.filter(Boolean).join(", ");
}
