/** A page in headless Chromium with the renderer in it, on a software renderer. */

import { existsSync } from "node:fs";
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";

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
