/** The README's watcher of sensors as a program: `node sensors.mjs ws://HOST:PORT/PATH`. */

import WebSocket from "ws";

import { watch } from "../examples/sensors.ts";

// Node has one since version 22.
globalThis.WebSocket ??= WebSocket as unknown as typeof globalThis.WebSocket;

await watch(process.argv[2] ?? "ws://127.0.0.1:7400/");
