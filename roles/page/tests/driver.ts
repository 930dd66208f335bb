/**
 * Drives the page in Chromium for a test program: a command a line on standard input, as JSON, and an answer
 * a line on standard output.
 */

import { createInterface } from "node:readline";
import { chromium, type Page } from "playwright-core";
import type { Point } from "../src/proto/viewState.ts";
import type { Viewer } from "../src/viewer/viewer.ts";

declare global {
  interface Window {
    trimaran?: Viewer;
  }
}

type Command =
  | { readonly do: "open"; readonly url: string }
  | { readonly do: "settle" }
  | { readonly do: "hold"; readonly key: string; readonly milliseconds: number }
  | { readonly do: "down" | "up" | "press"; readonly key: string }
  | { readonly do: "wait"; readonly milliseconds: number }
  /** The eye goes there, and walks from there on. */
  | { readonly do: "stand"; readonly eye: Point; readonly forward: Point }
  | { readonly do: "type"; readonly text: string }
  | { readonly do: "click"; readonly x: number; readonly y: number }
  /** The first button whose text begins so. */
  | { readonly do: "button"; readonly name: string }
  | { readonly do: "choose"; readonly label: string; readonly value: string }
  /** The eye goes to where it began, nothing is cut, and the bound on the error is as it was. */
  | { readonly do: "home" }
  | { readonly do: "drag"; readonly right: number; readonly down: number }
  /** The first handle in the picture. */
  | { readonly do: "handle"; readonly right: number; readonly down: number }
  | { readonly do: "resize"; readonly width: number; readonly height: number }
  /** The graphics device loses everything, and comes back. */
  | { readonly do: "lose" }
  | { readonly do: "look" }
  | { readonly do: "status" }
  | { readonly do: "figures" }
  | { readonly do: "memory" }
  | { readonly do: "screenshot"; readonly file: string };

/** How long a picture may take to be exact, milliseconds. */
const PATIENCE = 60_000;

const [width = 512, height = 512] = process.argv.slice(2).map(Number);
const browser = await chromium.launch({
  executablePath: process.env.TRIMARAN_CHROMIUM ?? "/usr/bin/chromium",
  args: [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--enable-precise-memory-info",
  ],
});
const page = await browser.newPage({ viewport: { width, height } });
const faults: string[] = [];
page.on("pageerror", (error) => faults.push(String(error.stack ?? error)));
page.on("console", (message) => {
  if (message.type() === "error") {
    faults.push(message.text());
  }
});

async function run(command: Command, page: Page): Promise<unknown> {
  switch (command.do) {
    case "open":
      return (await page.goto(command.url))?.status();
    case "settle":
      return until(() => page.evaluate(() => window.trimaran?.isSettled === true));
    case "hold":
      await page.keyboard.down(command.key);
      await page.waitForTimeout(command.milliseconds);
      await page.keyboard.up(command.key);
      return true;
    case "down":
      await page.keyboard.down(command.key);
      return true;
    case "up":
      await page.keyboard.up(command.key);
      return true;
    case "wait":
      await page.waitForTimeout(command.milliseconds);
      return true;
    case "stand":
      await page.evaluate(({ eye, forward }) => window.trimaran?.navigator.goTo(eye, forward), command);
      return true;
    case "press":
      await page.keyboard.press(command.key);
      return true;
    case "type":
      await page.keyboard.type(command.text);
      return true;
    case "click":
      await page.mouse.click(command.x, command.y);
      return true;
    case "button":
      await page
        .locator("button", { hasText: new RegExp(`^${command.name}`) })
        .first()
        .click();
      return true;
    case "choose":
      await page.getByLabel(command.label).selectOption(command.value);
      return true;
    case "home":
      await page.evaluate(() => {
        const viewer = window.trimaran;
        const { eye, forward } = viewer?.scene.start ?? { eye: [0, 0, 0], forward: [0, 0, -1] };
        viewer?.navigator.goTo([...eye], [...forward]);
        if (viewer !== undefined) {
          // A click may have added a section, or chosen another bound on the error.
          viewer.view.change({ sections: [] });
          viewer.epsilon.value = 2;
        }
      });
      return true;
    case "drag": {
      const [x, y] = [width / 2, height / 2];
      await page.mouse.move(x, y);
      await page.mouse.down();
      await page.mouse.move(x + command.right, y + command.down, { steps: 5 });
      await page.mouse.up();
      return true;
    }
    case "handle": {
      const handle = page.locator(".handle").first();
      const { x = 0, y = 0, width = 0, height = 0 } = (await handle.boundingBox()) ?? {};
      const [right, down] = [x + width / 2, y + height / 2];
      await page.mouse.move(right, down);
      await page.mouse.down();
      await page.mouse.move(right + command.right, down + command.down, { steps: 5 });
      await page.mouse.up();
      return true;
    }
    case "resize":
      await page.setViewportSize(command);
      return until(() =>
        page.evaluate(({ width, height }) => {
          const canvas = document.querySelector("canvas");
          return canvas?.width === width && canvas.height === height;
        }, command),
      );
    case "lose":
      await page.evaluate(lose);
      return true;
    case "look":
      return page.evaluate(look);
    case "status":
      return (await page.$("#status"))?.textContent() ?? "";
    case "figures":
      return page.evaluate(figures);
    case "memory":
      await page.requestGC();
      return page.evaluate(memory);
    case "screenshot":
      await page.screenshot({ path: command.file });
      return true;
  }
}

/** Bytes of scripts and of geometry, and elements of the document. */
function memory(): Record<string, number> {
  const { usedJSHeapSize } = (performance as unknown as { memory: { usedJSHeapSize: number } }).memory;
  const geometry = window.trimaran?.renderer.bytes ?? 0;
  return { scripts: usedJSHeapSize, geometry, elements: document.querySelectorAll("*").length };
}

/** What the panel "Status" says, by name. */
function figures(): Record<string, string> {
  const rows = [...document.querySelectorAll<HTMLTableRowElement>(".status tr")];
  return Object.fromEntries(
    rows.map((row) => [row.cells[0]?.textContent ?? "", row.cells[1]?.textContent ?? ""]),
  );
}

/** Waits until `holds`. The page's policy forbids what playwright waits by. */
async function until(holds: () => Promise<boolean>): Promise<true> {
  for (const began = performance.now(); performance.now() - began < PATIENCE; ) {
    if (await holds()) {
      return true;
    }
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
  throw new Error(`it does not come about within ${PATIENCE} ms`);
}

/** Runs in the page. */
async function lose(): Promise<void> {
  const canvas = document.querySelector("canvas");
  const losing = canvas?.getContext("webgl2")?.getExtension("WEBGL_lose_context");
  const heard = (name: string) => new Promise((resolve) => canvas?.addEventListener(name, resolve));
  const [lost, restored] = [heard("webglcontextlost"), heard("webglcontextrestored")];
  losing?.loseContext();
  await lost;
  // The browser gives it back once whoever hears of the loss is done.
  setTimeout(() => losing?.restoreContext());
  await restored;
}

/** Where the eye is, and which drawable each pixel shows. Runs in the page. */
function look(): unknown {
  const seen = window.trimaran;
  if (seen === undefined) {
    return undefined;
  }
  const canvas = document.querySelector("canvas");
  const { camera, navigator, renderer, display, selected, view } = seen;
  const { hidden, isolated, seeThrough, sections } = view.current.value;
  return {
    ...camera,
    forward: navigator.forward,
    mode: navigator.mode.value,
    selected: [...selected.value],
    hidden: [...hidden],
    isolated: isolated && [...isolated],
    seeThrough: [...seeThrough],
    sections,
    objects: display?.shown?.drawables.map(({ object }) => object),
    width: canvas?.width,
    height: canvas?.height,
    items: Array.from(seen.items()),
    pictures: seen.pictures,
    drawn: renderer.drawn,
    depth: renderer.depth,
    frame: display?.shown?.camera.frame,
    latency: display?.latency,
    cullers: display?.cullers,
    bytes: display?.bytes,
  };
}

for await (const line of createInterface({ input: process.stdin })) {
  let answer: unknown;
  try {
    answer = { answer: await run(JSON.parse(line) as Command, page), faults };
  } catch (error) {
    answer = { error: String(error), faults };
  }
  process.stdout.write(`${JSON.stringify(answer)}\n`);
}
await browser.close();
