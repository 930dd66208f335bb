/** Messages between roles on the messages lane. */

import { type Of, option, tagged, text, u32, u64 } from "trimaran-transport";
import { STATS } from "./stats.ts";
import { VIEW_PART, type ViewState, viewParts } from "./viewState.ts";

const KEY = { key: u64 };
const LEADER = { leader: u64 };

/** The kinds of messages, in the order of their numbers. */
export const ROLE_MESSAGE = tagged("what", {
  stats: { stats: STATS },
  meet: { ...KEY, endpoint: option(text()) },
  met: KEY,
  unmet: KEY,
  switch: { ...KEY, firstFrame: u32 },
  switched: KEY,
  part: {},
  view: VIEW_PART,
  waits: KEY,
  lead: LEADER,
  follow: LEADER,
  unfollow: LEADER,
  followed: { ...LEADER, firstFrame: u32 },
  unfollowed: { ...LEADER, firstFrame: u32 },
});

export type RoleMessage = Of<typeof ROLE_MESSAGE>;

/** The messages that tell a culler of a view state, in order. */
export function viewMessages(version: number, state: ViewState): RoleMessage[] {
  return viewParts(version, state).map((part) => ({ what: "view", ...part }));
}
