/** The state of the page in the words of a person who reviews a plant. */

import { counted } from "../controls/counted.ts";
import type { Row } from "../controls/rows.tsx";

/** While one moves, longer answers can be noticed. Milliseconds. */
const SLOW = 200;
/** Fewer frames than this come from a picture that rests. */
const FEW = 0.5;

export interface PageState {
  /** Whether there is a link to the service now. */
  readonly isLinked: boolean;
  /** How often the link was lost since the page was opened. */
  readonly losses: number;
  /** Milliseconds from a camera to its set. */
  readonly latency: number;
  /** Whether the picture is complete and exact, from the present eye. */
  readonly isExact: boolean;
  readonly framesPerSecond: number;
  /** Bytes of geometry here, and their limit. */
  readonly memory: number;
  readonly mostMemory: number;
  /** The host and port of the service. */
  readonly service: string;
  /** The scene's name, and the number of its objects. */
  readonly scene: string;
  readonly objects: number;
}

export function plainRows(state: PageState): readonly Row[] {
  const { isExact, framesPerSecond, memory, mostMemory, service, scene, objects } = state;
  const mebibytes = (bytes: number) => (bytes / 2 ** 20).toFixed(0);
  const isAtRest = isExact && framesPerSecond < FEW;
  return [
    ["Link", linkText(state)],
    ["Picture", pictureText(state)],
    ["Frames per second", isAtRest ? "none needed: nothing moves" : framesPerSecond.toFixed(0)],
    ["Memory", `${mebibytes(memory)} of ${mebibytes(mostMemory)} MiB`],
    ["Service", service],
    ["Scene", `${scene}, ${objects.toLocaleString("en")} parts`],
  ];
}

function linkText({ isLinked, latency, losses }: PageState): string {
  const speed = `${latency > SLOW ? "slow" : "good"}, an answer takes ${latency.toFixed(0)} ms`;
  const now = isLinked ? speed : "none now, the page tries again by itself";
  return losses === 0 ? now : `${now}; lost ${counted(losses, "time")} so far`;
}

function pictureText({ isExact, isLinked }: PageState): string {
  if (isExact) {
    return "complete and exact";
  }
  return isLinked ? "complete and exact once you rest" : "may lack parts until the link is back";
}
