import assert from "node:assert/strict";
import test from "node:test";
import { troubleJoining, troubleOfEnd } from "../src/viewer/trouble.ts";
import { LinkError } from "../wire/src/errors.ts";
import { describeRefusal, type Refusal } from "../wire/src/handshake.ts";

test("a person is told why there is no link, and what to do", () => {
  const refused = (refusal: Refusal) =>
    troubleJoining(new LinkError("refused", describeRefusal(refusal), { refusal }));
  assert.match(refused({ reason: "busy" }), /is full: .* goes on trying\. .*--people/);
  assert.equal(
    refused({ reason: "not taken", code: 1, text: "another scene" }),
    "The service refuses this page: another scene",
  );
  assert.equal(
    troubleJoining(new LinkError("timeout", "the listener did not answer in time")),
    "The service does not answer: the listener did not answer in time",
  );
  assert.equal(
    troubleOfEnd({ why: "closed", code: 2, text: "it failed: a picture of 9x9 pixels" }),
    "The service has ended the link: it failed: a picture of 9x9 pixels",
  );
  assert.equal(troubleOfEnd({ why: "lost", text: "closed" }), "The link to the service is lost: closed");
  assert.equal(troubleOfEnd({ why: "left", code: 0, text: "" }), "");
});
