/** The README's panel as a program: `node panel.mjs ws://HOST:PORT/PATH`. */

import WebSocket from "ws";

import { drive } from "../examples/panel.ts";

// Node has one since version 22.
globalThis.WebSocket ??= WebSocket as unknown as typeof globalThis.WebSocket;

await drive(process.argv[2] ?? "ws://127.0.0.1:7400/");
