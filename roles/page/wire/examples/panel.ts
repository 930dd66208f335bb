import { connect, defineProtocol, itemsOf, record, struct, tagged, text, u32 } from "trimaran-transport";

const VECTOR = struct({ x: "f32", y: "f32", z: "f32" }); // 12 bytes, as `Point` has them in Rust

/** The same as `impl Protocol for Robot` in Rust. */
const ROBOT = defineProtocol({
  name: "robot/2",
  hello: record({ name: text(), map: u32 }),
  latest: VECTOR, // where the robot shall be
  header: VECTOR, // a frame begins with where it was
  items: itemsOf(VECTOR), // the points that it sees
  message: tagged("command", { Stop: {}, Play: { sound: text() } }), // the variants of the enum, in order
});

/** Sends the robot to a place, looks at what it sees from there, and stops it. */
export async function drive(url: string): Promise<void> {
  const link = await connect(url, ROBOT, {
    hello: { name: "panel", map: 7 },
    signal: AbortSignal.timeout(10_000), // ends the attempt; the link lives on
  });
  console.log(`${link.peer.name} has map ${link.peer.map}`);

  // The latest lane: publishing never waits, and the robot reads the newest.
  link.latest.publish({ x: 0, y: 0, z: 0 });
  link.latest.publish({ x: 1, y: 0, z: 0.5 });

  // The frames lane: each frame comes whole.
  for await (const { number, header, items } of link.frames) {
    console.log(`frame ${number} from ${header.x}: ${items.map(({ x, y, z }) => `${x} ${y} ${z}`)}`);
    if (header.x === 1) {
      break; // the link goes on, and so would another loop
    }
  }

  // The messages lane: every message arrives, in order. Awaiting it keeps to the pace of the link.
  await link.messages.send({ command: "Play", sound: "bell" });
  await link.messages.send({ command: "Stop" });
  // Any wait may have a deadline. The link is as good as before.
  const answer = await link.messages.receive({ signal: AbortSignal.timeout(5_000) });
  console.log(`the robot answers: ${answer.command}`);

  // Close a link with a reason: one that just ends looks like a crash to the other side.
  link.close(0, "the shift is over");
  const end = await link.closed;
  console.log(`the end: ${end.why}, ${end.text}`);
}
