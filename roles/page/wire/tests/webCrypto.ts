/** Gives tests the browsers' global `crypto`: Node 18, the one of Debian 12, has it only in a module. */

import { webcrypto } from "node:crypto";

globalThis.crypto ??= webcrypto as Crypto;
