/** Where the other people are in the picture and where they look, and the part that somebody points at. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { isParallel } from "../navigate/parallel.ts";
import { called, type Person } from "../service/service.ts";
import { beyond, distance } from "../space/point.ts";
import type { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { useProjection } from "./useProjection.ts";

/** Milliseconds between two looks for markers that the model hides. */
const PERIOD = 500;
/** The length of a marker's line, and the distance of an eye that is not marked, in heights of an eye. */
const LINE = 0.6;
const NEAREST = 0.3;
/** A surface hides a marker if it is nearer by this share of the picture's height there. */
const BEFORE = 0.02;

interface Properties {
  readonly viewer: Viewer;
  readonly people: People;
}

export function PeopleOverlay({ viewer, people }: Properties) {
  const projection = useProjection(viewer);
  const hidden = useSignal<ReadonlySet<number>>(new Set());
  useEffect(() => {
    const timer = setInterval(() => {
      hidden.value = hiddenPeople(viewer, people.company.peek().others);
    }, PERIOD);
    return () => clearInterval(timer);
  }, [viewer]);
  const { eyeHeight } = viewer.scene;
  const marked = people.company.value.others.filter(
    ({ number, pose }) =>
      !hidden.value.has(number) &&
      number !== people.followed.value &&
      // The eye of a parallel view is nowhere near the model.
      !isParallel(pose.vfovDeg) &&
      distance(pose.eye, projection.eye) > NEAREST * eyeHeight,
  );
  const pointed = people.pointedOut.value;
  const target = pointed && projection.place(pointed.at);
  return (
    <svg class="overlay people" aria-hidden="true">
      {marked.map((person) => {
        const { eye, forward } = person.pose;
        const [place, line] = [
          projection.place(eye),
          projection.line(eye, beyond(eye, forward, LINE * eyeHeight)),
        ];
        return (
          place && (
            <g key={person.number} data-person={person.number}>
              {line && <line x1={line[0].x} y1={line[0].y} x2={line[1].x} y2={line[1].y} />}
              <circle cx={place.x} cy={place.y} r={5} />
              <text x={place.x} y={place.y - 10}>
                {called(person)}
              </text>
            </g>
          )
        );
      })}
      {pointed && target && (
        <g class="pointed">
          <circle class="ring pulse" cx={target.x} cy={target.y} r={14} />
          <circle class="ring" cx={target.x} cy={target.y} r={14} />
          <text x={target.x} y={target.y - 24}>
            {pointed.name}
          </text>
        </g>
      )}
    </svg>
  );
}

/** Tells who is followed, and ends it. */
export function Following({ people }: { readonly people: People }) {
  const number = people.followed.value;
  const person = people.company.value.others.find((other) => other.number === number);
  return (
    person && (
      <div class="panel bar following">
        <span>Following {called(person)}</span>
        <Button text="Stop" title="Stop following" onClick={() => people.follow(undefined)} />
      </div>
    )
  );
}

/** The numbers of the people whose eyes are behind what the picture shows. */
function hiddenPeople(viewer: Viewer, others: readonly Person[]): ReadonlySet<number> {
  const { pictured } = viewer;
  const hides = (depth: number, there: number) => there - depth > BEFORE * pictured.heightAt(there);
  const behind = others.filter(({ pose: { eye } }) => {
    const place = pictured.shows(eye) ? pictured.place(eye) : undefined;
    const surface = place && viewer.pick(place.x, place.y);
    return surface !== undefined && place !== undefined && hides(surface.depth, place.depth);
  });
  return new Set(behind.map(({ number }) => number));
}
