/**
 * Drives the page in Chromium for a test program: one JSON command per line on standard input, one answer per
 * line on standard output.
 */

import { createInterface } from "node:readline";
import { chromium, type Page } from "playwright-core";
import type { Point } from "../src/space/point.ts";
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
  /** Moves the eye there, in walk mode. */
  | { readonly do: "stand"; readonly eye: Point; readonly forward: Point }
  | { readonly do: "type"; readonly text: string }
  | { readonly do: "click"; readonly x: number; readonly y: number; readonly keys?: readonly string[] }
  | { readonly do: "move"; readonly x: number; readonly y: number }
  /** The projection of a world point, in CSS pixels. */
  | { readonly do: "point"; readonly point: Point }
  /** The button with this label. */
  | { readonly do: "label"; readonly name: string }
  /** Clicks the download button of this name; returns the file's name. */
  | { readonly do: "download"; readonly name: string }
  | { readonly do: "file"; readonly selector: string; readonly name: string; readonly text: string }
  /** The text of each of these elements. */
  | { readonly do: "text"; readonly selector: string }
  /** Whether each of these elements is visible: it lies within the scrolling element around it. */
  | { readonly do: "visible"; readonly selector: string; readonly within: string }
  | { readonly do: "clipboard" }
  /** Clicks the first button whose text begins with this. */
  | { readonly do: "button"; readonly name: string }
  | { readonly do: "choose"; readonly label: string; readonly value: string }
  /** Resets the eye, the sections and the error bound. */
  | { readonly do: "home" }
  | { readonly do: "drag"; readonly right: number; readonly down: number }
  /** Drags the first handle in the picture. */
  | { readonly do: "handle"; readonly right: number; readonly down: number }
  | { readonly do: "resize"; readonly width: number; readonly height: number }
  /** The graphics device loses its context, and gets it back. */
  | { readonly do: "lose" }
  | { readonly do: "look" }
  | { readonly do: "status" }
  | { readonly do: "figures" }
  /** The focused element: its name and kind. */
  | { readonly do: "focused" }
  /** Presses Tab until an element of that name has the focus. */
  | { readonly do: "tab"; readonly name: string }
  | { readonly do: "wheel"; readonly x: number; readonly y: number; readonly down: number }
  /** Drags from one place of the canvas, with the left button. */
  | {
      readonly do: "pull";
      readonly x: number;
      readonly y: number;
      readonly right: number;
      readonly down: number;
    }
  /** Touches a place for this long. */
  | { readonly do: "touch"; readonly x: number; readonly y: number; readonly milliseconds: number }
  /** Shows the person a message. */
  | { readonly do: "say"; readonly text: string }
  | { readonly do: "title" }
  | { readonly do: "reload" }
  /** A place where a finger meets an object, CSS pixels. */
  | { readonly do: "place"; readonly object: number }
  /** The eye, and the picked and hidden objects: the result of `look` without pixels. */
  | { readonly do: "state" }
  /** All usable controls, with their places. */
  | { readonly do: "targets" }
  /** Touches the control of that name for this long. */
  | { readonly do: "tap"; readonly name: string; readonly milliseconds: number }
  /** The extent of the picked objects in the picture; without any, of all but the background. */
  | { readonly do: "extent" }
  /** The transfer times of the page's files. */
  | { readonly do: "files" }
  | { readonly do: "memory" }
  | { readonly do: "screenshot"; readonly file: string };

/** The timeout for an exact picture, milliseconds. */
const PATIENCE = 60_000;

const [width = 512, height = 512] = process.argv.slice(2, 4).map(Number);
const isTouch = process.argv[4] === "touch";
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
const page = await browser.newPage({ viewport: { width, height }, hasTouch: isTouch, isMobile: isTouch });
await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
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
      for (const key of command.keys ?? []) {
        await page.keyboard.down(key);
      }
      await page.mouse.click(command.x, command.y);
      for (const key of command.keys ?? []) {
        await page.keyboard.up(key);
      }
      return true;
    case "move":
      await page.mouse.move(command.x, command.y);
      return true;
    case "point":
      return page.evaluate(({ point }) => {
        const place = window.trimaran?.projection.place(point);
        return place && [place.x, place.y];
      }, command);
    case "label":
      await page.getByLabel(command.name, { exact: true }).first().click();
      return true;
    case "download": {
      const button = page.getByRole("button", { name: command.name, exact: true });
      const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
      return download.suggestedFilename();
    }
    case "file": {
      const { selector, name, text } = command;
      const file = { name, mimeType: "application/json", buffer: Buffer.from(text) };
      await page.locator(selector).setInputFiles(file);
      return true;
    }
    case "text":
      return page.evaluate(
        ({ selector }) =>
          [...document.querySelectorAll<HTMLElement>(selector)].map((one) => one.textContent ?? ""),
        command,
      );
    case "visible":
      return page.evaluate(({ selector, within }) => {
        const around = document.querySelector(within)?.getBoundingClientRect();
        const boxes = [...document.querySelectorAll(selector)].map((one) => one.getBoundingClientRect());
        return boxes.map(({ top, bottom }) => {
          return around !== undefined && top >= around.top - 1 && bottom <= around.bottom + 1;
        });
      }, command);
    case "clipboard":
      return page.evaluate(() => navigator.clipboard.readText());
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
        viewer?.navigator.goTo(eye, forward);
        if (viewer !== undefined) {
          // A click may have added a section, or chosen another error bound.
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
      return page.evaluate(() => document.querySelector("#status")?.textContent ?? "");
    case "figures":
      return page.evaluate(figures);
    case "focused":
      return page.evaluate(focused);
    case "tab":
      for (let press = 0; press < 100; press += 1) {
        const { name } = await page.evaluate(focused);
        if (name === command.name) {
          return press;
        }
        await page.keyboard.press("Tab");
      }
      throw new Error(`no Tab leads to ${command.name}`);
    case "wheel":
      await page.mouse.move(command.x, command.y);
      await page.mouse.wheel(0, command.down);
      return true;
    case "pull":
      await page.mouse.move(command.x, command.y);
      await page.mouse.down();
      await page.mouse.move(command.x + command.right, command.y + command.down, { steps: 8 });
      await page.mouse.up();
      return true;
    case "touch":
      return touch(page, command.x, command.y, command.milliseconds);
    case "tap": {
      // Rows of a list come from the service.
      let place: { x: number; y: number } | undefined;
      await until(async () => {
        [place] = (await page.evaluate(targets, command.name)) as { x: number; y: number }[];
        return place !== undefined;
      }, `that something is called ${command.name}`);
      return place && touch(page, place.x, place.y, command.milliseconds);
    }
    case "state":
      return page.evaluate(state);
    case "say":
      await page.evaluate((text) => {
        if (window.trimaran !== undefined) {
          window.trimaran.said.value = text;
        }
      }, command.text);
      return true;
    case "title":
      return page.title();
    case "reload":
      return (await page.reload())?.status();
    case "place":
      return page.evaluate(place, command.object);
    case "targets":
      return page.evaluate(targets, "");
    case "extent":
      return page.evaluate(extent);
    case "files":
      return page.evaluate(files);
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

/** Runs in the page. */
function state(): unknown {
  const seen = window.trimaran;
  const { hidden, seeThrough } = seen?.view.current.value ?? {};
  return {
    ...seen?.camera,
    forward: seen?.navigator.forward,
    mode: seen?.navigator.mode.value,
    selected: [...(seen?.selected.value ?? [])],
    hidden: [...(hidden ?? [])],
    seeThrough: [...(seeThrough ?? [])],
    drawn: seen?.renderer.drawn,
  };
}

/** A touch of about this duration, however busy the page is. */
async function touch(page: Page, x: number, y: number, milliseconds: number): Promise<true> {
  const devtools = await page.context().newCDPSession(page);
  const touchPoints = [{ x, y }];
  const down = devtools.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints });
  await page.waitForTimeout(milliseconds);
  await Promise.all([down, devtools.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] })]);
  await devtools.detach();
  return true;
}

/** The focused element: its name, its kind, and whether it shows the focus. Runs in the page. */
function focused(): { name: string; tag: string; shows: boolean } {
  const element = document.activeElement;
  const name = element?.getAttribute("aria-label") ?? element?.textContent ?? "";
  const row = element?.querySelector(":scope > .row") ?? element;
  const shows = row !== null && getComputedStyle(row).outlineStyle !== "none";
  return { name: name.trim(), tag: element?.tagName.toLowerCase() ?? "", shows };
}

/** Usable controls: name, place, size of letters, and whether a finger there meets it. Runs in the page. */
function targets(wanted: string): unknown {
  const controls = document.querySelectorAll<HTMLElement>(
    "button, input, select, label.file, [role=treeitem] > .link",
  );
  return [...controls].flatMap((control) => {
    const name = (control.getAttribute("aria-label") ?? control.textContent ?? "").trim();
    if (wanted !== "" && wanted !== name) {
      return [];
    }
    // Controls scrolled out of lists and bars can be scrolled into view.
    control.scrollIntoView({ block: "nearest", inline: "nearest" });
    const { left, top, width, height } = control.getBoundingClientRect();
    const isSeen = control.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true });
    if (!isSeen || width === 0) {
      return [];
    }
    const [x, y] = [left + width / 2, top + height / 2];
    const met = document.elementFromPoint(x, y);
    const letters = Number.parseFloat(getComputedStyle(control).fontSize);
    const isMet = met !== null && (control.contains(met) || met.contains(control));
    return [{ name, tag: control.tagName.toLowerCase(), x, y, width, height, letters, isMet }];
  });
}

/** Runs in the page. */
function place(wanted: number): { x: number; y: number } | undefined {
  const seen = window.trimaran;
  const [width = 1, height = 1] = [seen?.canvas.width, seen?.canvas.height];
  const scale = width / Math.max(1, seen?.canvas.clientWidth ?? 1);
  const objects = new Map(seen?.display?.shown?.drawables.map(({ id, object }) => [id, object]));
  const items = seen?.items() ?? [];
  const shows = (at: number) => objects.get(items[at] ?? -1) === wanted;
  for (let at = 0; at < items.length; at += 1) {
    const [x, y] = [(at % width) + 0.5, height - 0.5 - Math.floor(at / width)];
    // Not at its edge.
    const isInside = [-3 * width - 3, -3 * width + 3, 3 * width - 3, 3 * width + 3].every((by) =>
      shows(at + by),
    );
    if (isInside && document.elementFromPoint(x / scale, y / scale) === seen?.canvas) {
      return { x: x / scale, y: y / scale };
    }
  }
  return undefined;
}

/** Runs in the page. */
function extent(): Record<string, number> {
  const seen = window.trimaran;
  const [width = 1, height = 1] = [seen?.canvas.width, seen?.canvas.height];
  const picked = seen?.selected.value;
  const objects = new Map(seen?.display?.shown?.drawables.map(({ id, object }) => [id, object]));
  let [left, right, top, bottom, pixels] = [width, -1, height, -1, 0];
  for (const [at, id] of (seen?.items() ?? []).entries()) {
    const object = objects.get(id);
    if (object !== undefined && (picked?.isEmpty === true || picked?.has(object) === true)) {
      const [x, y] = [at % width, height - 1 - Math.floor(at / width)];
      [left, right] = [Math.min(left, x), Math.max(right, x)];
      [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
      pixels += 1;
    }
  }
  const [across, down] = [(right + 1 - left) / width, (bottom + 1 - top) / height];
  return { pixels, across, down, x: (left + right + 1) / 2 / width, y: (top + bottom + 1) / 2 / height };
}

/** Transferred and decoded bytes, by the name of the file. Runs in the page. */
function files(): unknown {
  const all = performance.getEntriesByType("resource") as PerformanceResourceTiming[];
  return Object.fromEntries(
    all.map(({ name, transferSize, encodedBodySize, decodedBodySize }) => {
      return [new URL(name).pathname, { transferSize, encodedBodySize, decodedBodySize }];
    }),
  );
}

/** The figures of the panel "Status", by name. */
function figures(): Record<string, string> {
  const rows = [...document.querySelectorAll<HTMLTableRowElement>(".status tr")];
  return Object.fromEntries(
    rows.map((row) => [row.cells[0]?.textContent ?? "", row.cells[1]?.textContent ?? ""]),
  );
}

/** Waits until `holds`. The page's policy forbids playwright's own way to wait. */
async function until(holds: () => Promise<boolean>, what = "it"): Promise<true> {
  for (const began = performance.now(); performance.now() - began < PATIENCE; ) {
    if (await holds()) {
      return true;
    }
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
  throw new Error(`${what} does not come about within ${PATIENCE} ms`);
}

/** Runs in the page. */
async function lose(): Promise<void> {
  const canvas = document.querySelector("canvas");
  const losing = canvas?.getContext("webgl2")?.getExtension("WEBGL_lose_context");
  const heard = (name: string) => new Promise((resolve) => canvas?.addEventListener(name, resolve));
  const [lost, restored] = [heard("webglcontextlost"), heard("webglcontextrestored")];
  losing?.loseContext();
  await lost;
  // The browser restores it once the listeners of the loss are done.
  setTimeout(() => losing?.restoreContext());
  await restored;
}

/** The eye, and the drawable at each pixel. Runs in the page. */
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

/** Chromium's error when the document has gone. */
const IS_GONE = /context was destroyed|Cannot find context|a different document|because of a navigation/;

/** The page may reload during a command, as for another scene. Then the command is repeated. */
async function answered(command: Command): Promise<unknown> {
  for (const begun = performance.now(); ; ) {
    try {
      return { answer: await run(command, page), faults };
    } catch (error) {
      if (!IS_GONE.test(String(error)) || performance.now() - begun > PATIENCE) {
        return { error: String(error), faults };
      }
    }
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(`${JSON.stringify(await answered(JSON.parse(line) as Command))}\n`);
}
await browser.close();
