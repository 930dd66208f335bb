/** Gives tests the `crypto` that browsers have: Node 18, which Debian 12 has, keeps it in a module alone. */

import { webcrypto } from "node:crypto";

globalThis.crypto ??= webcrypto as Crypto;
