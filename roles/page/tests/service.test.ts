import assert from "node:assert/strict";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { test } from "node:test";
import { called, Service } from "../src/service/service.ts";

/** Answers of a service, in order: a status, and after how many seconds to ask again. */
async function asked(answers: readonly (readonly [status: number, after?: string])[]) {
  let count = 0;
  const server = createServer((_, response) => {
    const [status, after] = answers[count++] ?? [500];
    response.writeHead(status, after === undefined ? {} : { "retry-after": after });
    response.end(status === 200 ? '{"parts":[],"total":7}' : "busy\n");
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  const { port } = server.address() as AddressInfo;
  try {
    const service = new Service(`http://127.0.0.1:${port}/?token=0123456789abcdef`);
    const total = await service.search("a", 0).then(
      (parts) => parts.total,
      (error: unknown) => (error as Error).message,
    );
    return [total, count];
  } finally {
    server.close();
    server.closeAllConnections();
  }
}

test("a page asks again where the service is busy, and says so in the end", async () => {
  assert.deepEqual(await asked([[503, "0.01"], [503, "0.01"], [200]]), [7, 3]);
  assert.deepEqual(await asked(Array.from({ length: 9 }, () => [503, "0.01"] as const)), ["busy", 5]);
  assert.deepEqual(await asked([[503], [200]]), ["busy", 1]);
  assert.deepEqual(await asked([[404, "0.01"], [200]]), ["busy", 1]);
});

test("a person is called by name where there is one, and never taken for another", () => {
  assert.equal(called({ number: 3 }), "Person 3");
  assert.equal(called({ number: 3, name: "Ada" }), "Ada (3)");
});
