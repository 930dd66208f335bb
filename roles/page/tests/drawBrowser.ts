/** A page in headless Chromium with the renderer in it, on a software renderer. */

import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import { after, before, test } from "node:test";

import { build } from "esbuild";
import { type Browser, chromium, type Page } from "playwright-core";

export class DrawBrowser {
  readonly page: Page;
  /** Errors in the page. */
  readonly faults: string[];
  readonly #browser: Browser;
  readonly #server: Server;

  private constructor(page: Page, faults: string[], browser: Browser, server: Server) {
    [this.page, this.faults, this.#browser, this.#server] = [page, faults, browser, server];
  }

  /** Undefined, with a message, without Chromium; throws if it is required. */
  static async open(): Promise<DrawBrowser | undefined> {
    const executablePath = process.env.TRIMARAN_CHROMIUM ?? "/usr/bin/chromium";
    if (!existsSync(executablePath)) {
      const why = `it takes Chromium, and ${executablePath} is not there`;
      if (process.env.TRIMARAN_REQUIRE_BROWSER === "1") {
        throw new Error(why);
      }
      console.log(`skipped: ${why}`);
      return undefined;
    }
    const script = await bundled("tests/drawHarness.ts");
    const server = createServer(({ url }, response) => {
      const isScript = url === "/harness.js";
      response.setHeader("content-type", isScript ? "text/javascript" : "text/html");
      response.end(isScript ? script : '<!doctype html><script src="harness.js"></script><body></body>');
    });
    await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
    const software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
    const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", ...software] });
    const page = await browser.newPage({ viewport: { width: 1024, height: 1024 } });
    const faults: string[] = [];
    page.on("pageerror", (error) => faults.push(String(error.stack ?? error)));
    page.on("console", (message) => {
      // Drivers warn of blocking reads: tests do nothing else.
      if (["error", "warning"].includes(message.type()) && !/GPU stall/.test(message.text())) {
        faults.push(message.text());
      }
    });
    await page.goto(`http://127.0.0.1:${(server.address() as AddressInfo).port}/`);
    return new DrawBrowser(page, faults, browser, server);
  }

  async close(): Promise<void> {
    await this.#browser.close();
    this.#server.close();
  }
}

async function bundled(entry: string): Promise<string> {
  const { outputFiles } = await build({
    entryPoints: [entry],
    bundle: true,
    format: "iife",
    target: "es2022",
    write: false,
    logLevel: "error",
  });
  return outputFiles[0]?.text ?? "";
}

/** Opens a browser for the tests of a file, each of which runs a function in the page. */
export function drawing() {
  let browser: DrawBrowser | undefined;
  before(async () => {
    browser = await DrawBrowser.open();
  });
  after(() => browser?.close());
  /** A test that runs `look` in the page, and `check` on its result. Fails on any error in the page. */
  return <A, T>(name: string, argument: A, look: (argument: A) => T, check: (found: Awaited<T>) => void) => {
    test(name, async (context) => {
      if (browser === undefined) {
        context.skip("there is no Chromium");
        return;
      }
      const { page, faults } = browser;
      faults.length = 0;
      // Values to and from the page must be JSON.
      check((await page.evaluate(look as never, argument as never)) as Awaited<T>);
      assert.deepEqual(faults, []);
    });
  };
}
