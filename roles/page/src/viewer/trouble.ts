/** Messages for a person when there is no link to the service. */

import { type LinkEnd, LinkError } from "trimaran-transport";

/** Why no link could be made. */
export function troubleJoining(error: unknown): string {
  if (error instanceof LinkError && error.refusal?.reason === "busy") {
    return "The service is full: there are as many people as it takes. This page goes on trying. The service \
can be told to let in more (--people).";
  }
  if (error instanceof LinkError && error.refusal !== undefined) {
    return `The service refuses this page: ${error.message}`;
  }
  return `The service does not answer: ${error instanceof Error ? error.message : error}`;
}

/** Why a link has ended other than by this page. */
export function troubleOfEnd(end: LinkEnd): string {
  switch (end.why) {
    case "left":
      return "";
    case "closed":
      return `The service has ended the link: ${end.text}`;
    default:
      return `The link to the service is lost: ${end.text}`;
  }
}
