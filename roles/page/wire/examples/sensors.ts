import { array, connect, defineProtocol, itemsOf, nothing, text } from "trimaran-transport";

const POINT = array("u16", 2); // distance and intensity
const LIDAR = { header: nothing, items: itemsOf(POINT) };

/** The same as `impl Protocol for Sensors` in Rust: the channels in the same order. */
const SENSORS = defineProtocol({
  name: "sensors/1",
  hello: text(),
  channels: { odometry: { latest: array("f32", 3) }, "front lidar": LIDAR, "back lidar": LIDAR },
});

/** Looks at what the robot senses until it leaves, and says where it shall be. */
export async function watch(url: string): Promise<void> {
  const link = await connect(url, SENSORS, { hello: "panel", keepFrames: 1 });
  const { odometry, "front lidar": front, "back lidar": back } = link.channels;
  odometry.publish([1, 0, 0.5]);
  console.log(`it is at ${await odometry.receive()}`);
  for (const lidar of [front, back]) {
    const { number, items } = await lidar.receive();
    console.log(`scan ${number}: ${items.join(" ")}`);
  }
  await back.send({ header: undefined, items: [[3, 4]] });
  const end = await link.closed;
  console.log(`the end: ${end.text}`);
}
