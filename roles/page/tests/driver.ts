/**
 * Drives the page in Chromium for a test program: one JSON command per line on standard input, one answer per
 * line on standard output.
 */

import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import type { Point } from "../src/space/point.ts";
import type { Viewer } from "../src/viewer/viewer.ts";

declare global {
  interface Window {
    trimaran?: Viewer;
    eyes?: Point[];
  }
}

/** The timeout for an exact picture, milliseconds. */
const PATIENCE = 60_000;

const [width = 512, height = 512] = process.argv.slice(2, 4).map(Number);
const isTouch = process.argv.includes("touch");
/** Without it the page begins where a walk begins, and not with a flight. */
const hasMotion = process.argv.includes("motion");
const flags = process.argv.slice(4).filter((argument) => argument.startsWith("--"));
const browser = await chromium.launch({
  executablePath: process.env.TRIMARAN_CHROMIUM ?? "/usr/bin/chromium",
  args: [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--enable-precise-memory-info",
    ...flags,
  ],
});
const page = await browser.newPage({
  viewport: { width, height },
  hasTouch: isTouch,
  isMobile: isTouch,
  reducedMotion: hasMotion ? "no-preference" : "reduce",
});
if (hasMotion) {
  await page.addInitScript(recordEyes);
}
await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
const faults: string[] = [];
page.on("pageerror", (error) => faults.push(String(error.stack ?? error)));
page.on("console", (message) => {
  if (message.type() === "error") {
    faults.push(message.text());
  }
});

interface Spot {
  readonly x: number;
  readonly y: number;
}

interface Way {
  readonly right: number;
  readonly down: number;
}

interface Key {
  readonly key: string;
}

interface Name {
  readonly name: string;
}

interface Time {
  readonly milliseconds: number;
}

interface Chosen {
  readonly selector: string;
}

/** Commands that act, by name. Their answer is true. */
const ACTIONS = {
  settle: () => until(() => page.evaluate(() => window.trimaran?.isSettled === true)),
  async hold({ key, milliseconds }: Key & Time) {
    await page.keyboard.down(key);
    await page.waitForTimeout(milliseconds);
    await page.keyboard.up(key);
  },
  down: ({ key }: Key) => page.keyboard.down(key),
  up: ({ key }: Key) => page.keyboard.up(key),
  press: ({ key }: Key) => page.keyboard.press(key),
  type: ({ text }: { text: string }) => page.keyboard.type(text),
  wait: ({ milliseconds }: Time) => page.waitForTimeout(milliseconds),
  /** Moves the eye there, in walk mode. */
  stand: (pose: { eye: Point; forward: Point }) =>
    page.evaluate(({ eye, forward }) => window.trimaran?.navigator.goTo(eye, forward), pose),
  async click({ x, y, keys = [] }: Spot & { keys?: readonly string[] }) {
    for (const key of keys) {
      await page.keyboard.down(key);
    }
    await page.mouse.click(x, y);
    for (const key of keys) {
      await page.keyboard.up(key);
    }
  },
  /** Clicks the button with this label. */
  label: ({ name }: Name) => page.getByLabel(name, { exact: true }).first().click(),
  /** Clicks the first button whose text begins with this. */
  button: ({ name }: Name) =>
    page
      .locator("button", { hasText: new RegExp(`^${name}`) })
      .first()
      .click(),
  picture: ({ path }: { path: string }) => page.screenshot({ path }),
  file: ({ selector, name, text }: Chosen & Name & { text: string }) =>
    page.locator(selector).setInputFiles({ name, mimeType: "application/json", buffer: Buffer.from(text) }),
  choose: ({ label, value }: { label: string; value: string }) => page.getByLabel(label).selectOption(value),
  /** Clicks the face of this name on the cube that shows the orientation. */
  async face({ name }: Name) {
    const [place] = await page.evaluate(rects, `.cube [data-name=${name}]`);
    await (place && page.mouse.click(place.x, place.y));
  },
  /** Resets the eye, the sections and the error bound. */
  home: () =>
    page.evaluate(() => {
      const viewer = window.trimaran;
      const { eye, forward } = viewer?.scene.start ?? { eye: [0, 0, 0], forward: [0, 0, -1] };
      viewer?.navigator.goTo(eye, forward);
      if (viewer !== undefined) {
        // A click may have added a section, or chosen another error bound.
        viewer.view.change({ sections: [] });
        viewer.epsilon.value = 2;
      }
    }),
  drag: (way: Way) => pull({ x: width / 2, y: height / 2, ...way }, 5),
  /** Drags the first handle in the picture. */
  async handle(way: Way) {
    const box = await page.locator(".handle").first().boundingBox();
    const { x = 0, y = 0, width = 0, height = 0 } = box ?? {};
    await pull({ x: x + width / 2, y: y + height / 2, ...way }, 5);
  },
  /** Drags from one place of the canvas, with the left button. */
  pull: (from: Spot & Way) => pull(from, 8),
  async resize(size: { width: number; height: number }) {
    await page.setViewportSize(size);
    await until(() =>
      page.evaluate(({ width, height }) => {
        const canvas = document.querySelector("canvas");
        return canvas?.width === width && canvas.height === height;
      }, size),
    );
  },
  /** The graphics device loses its context, and gets it back. */
  lose: () => page.evaluate(lose),
  async wheel({ x, y, down }: Spot & { down: number }) {
    await page.mouse.move(x, y);
    await page.mouse.wheel(0, down);
  },
  /** Touches a place for this long. */
  touch: (at: Spot & Time) => touch(at),
  /** Touches the control of that name for this long. */
  async tap({ name, milliseconds }: Name & Time) {
    // Rows of a list come from the service.
    let place: Spot | undefined;
    await until(async () => {
      [place] = (await page.evaluate(targets, name)) as Spot[];
      return place !== undefined;
    }, `that something is called ${name}`);
    await (place && touch({ ...place, milliseconds }));
  },
  /** Shows the person a message. */
  say: ({ text }: { text: string }) =>
    page.evaluate((text) => {
      if (window.trimaran !== undefined) {
        window.trimaran.said.value = text;
      }
    }, text),
};

/** Commands that answer something, by name. */
const QUESTIONS = {
  open: async ({ url }: { url: string }) => (await page.goto(url))?.status(),
  reload: async () => (await page.reload())?.status(),
  title: () => page.title(),
  /** The projection of a world point, in CSS pixels. */
  point: ({ point }: { point: Point }) =>
    page.evaluate((point) => {
      const place = window.trimaran?.projection.place(point);
      return place && [place.x, place.y];
    }, point),
  /** Clicks the download button of this name; returns the file's name. */
  async download({ name }: Name) {
    const button = page.getByRole("button", { name, exact: true });
    const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
    return download.suggestedFilename();
  },
  /** The text of each of these elements. */
  text: ({ selector }: Chosen) =>
    page.evaluate(
      (selector) => [...document.querySelectorAll(selector)].map((one) => one.textContent ?? ""),
      selector,
    ),
  /** Whether each of these elements is visible: it lies within the scrolling element around it. */
  visible: (chosen: Chosen & { within: string }) =>
    page.evaluate(({ selector, within }) => {
      const around = document.querySelector(within)?.getBoundingClientRect();
      const boxes = [...document.querySelectorAll(selector)].map((one) => one.getBoundingClientRect());
      return boxes.map(({ top, bottom }) => {
        return around !== undefined && top >= around.top - 1 && bottom <= around.bottom + 1;
      });
    }, chosen),
  /** The middles and the sizes of these elements, CSS pixels. */
  rects: ({ selector }: Chosen) => page.evaluate(rects, selector),
  /** The eye in each picture since the page began. Only with `motion`. */
  eyes: () => page.evaluate(() => window.eyes),
  clipboard: () => page.evaluate(() => navigator.clipboard.readText()),
  look: () => page.evaluate(look),
  status: () => page.evaluate(() => document.querySelector("#status")?.textContent ?? ""),
  figures: () => page.evaluate(figures),
  /** The focused element: its name and kind. */
  focused: () => page.evaluate(focused),
  /** Presses Tab until an element of that name has the focus. */
  async tab({ name: wanted }: Name) {
    for (let press = 0; press < 100; press += 1) {
      const { name } = await page.evaluate(focused);
      if (name === wanted) {
        return press;
      }
      await page.keyboard.press("Tab");
    }
    throw new Error(`no Tab leads to ${wanted}`);
  },
  /** A place where a finger meets an object, CSS pixels. */
  place: ({ object }: { object: number }) => page.evaluate(place, object),
  /** The eye, and the picked and hidden objects: the result of `look` without pixels. */
  state: () => page.evaluate(state),
  /** All usable controls, with their places. */
  targets: () => page.evaluate(targets, ""),
  /** The extent of the picked objects in the picture; without any, of all but the background. */
  extent: () => page.evaluate(extent),
  /** The transfer times of the page's files. */
  files: () => page.evaluate(files),
  async memory() {
    await page.requestGC();
    return page.evaluate(memory);
  },
};

/** A command, with its name in `do`. */
type Command = { readonly do: keyof typeof ACTIONS | keyof typeof QUESTIONS };

async function run({ do: name, ...argument }: Command): Promise<unknown> {
  if (name in ACTIONS) {
    await ACTIONS[name as keyof typeof ACTIONS](argument as never);
    return true;
  }
  return QUESTIONS[name as keyof typeof QUESTIONS](argument as never);
}

async function pull({ x, y, right, down }: Spot & Way, steps: number): Promise<void> {
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + right, y + down, { steps });
  await page.mouse.up();
}

/** Bytes of scripts and of geometry, and elements of the document. */
function memory(): Record<string, number> {
  const { usedJSHeapSize } = (performance as unknown as { memory: { usedJSHeapSize: number } }).memory;
  const geometry = window.trimaran?.renderer.bytes ?? 0;
  return { scripts: usedJSHeapSize, geometry, elements: document.querySelectorAll("*").length };
}

/** Runs in the page, before its own scripts. */
function recordEyes(): void {
  const eyes: Point[] = [];
  window.eyes = eyes;
  const note = () => {
    if (window.trimaran !== undefined) {
      eyes.push(window.trimaran.navigator.eye);
    }
    requestAnimationFrame(note);
  };
  note();
}

/** Runs in the page. */
function rects(selector: string): { x: number; y: number; width: number; height: number }[] {
  return [...document.querySelectorAll(selector)].map((one) => {
    const { left, top, width, height } = one.getBoundingClientRect();
    return { x: left + width / 2, y: top + height / 2, width, height };
  });
}

/** Runs in the page. */
function state(): unknown {
  const seen = window.trimaran;
  const { hidden, seeThrough, sections } = seen?.view.current.value ?? {};
  return {
    ...seen?.camera,
    start: seen?.scene.start,
    forward: seen?.navigator.forward,
    mode: seen?.navigator.mode.value,
    selected: [...(seen?.selected.value ?? [])],
    hidden: [...(hidden ?? [])],
    seeThrough: [...(seeThrough ?? [])],
    sections,
    drawn: seen?.renderer.drawn,
  };
}

/** A touch of at least this duration, and by its events' times of just this, however busy the machine is. */
async function touch({ x, y, milliseconds }: Spot & Time): Promise<void> {
  const devtools = await page.context().newCDPSession(page);
  const timestamp = Date.now() / 1000;
  const end = { timestamp: timestamp + milliseconds / 1000, touchPoints: [] };
  const begin = { timestamp, touchPoints: [{ x, y }] };
  const down = devtools.send("Input.dispatchTouchEvent", { type: "touchStart", ...begin });
  await page.waitForTimeout(milliseconds);
  await Promise.all([down, devtools.send("Input.dispatchTouchEvent", { type: "touchEnd", ...end })]);
  await devtools.detach();
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
async function until(holds: () => Promise<boolean>, what = "it"): Promise<void> {
  for (const began = performance.now(); performance.now() - began < PATIENCE; ) {
    if (await holds()) {
      return;
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

/**
 * The eye, and the drawable at each pixel: its number and a count of pixels, in turn, rows from below. Runs in
 * the page.
 */
function look(): unknown {
  const seen = window.trimaran;
  if (seen === undefined) {
    return undefined;
  }
  const canvas = document.querySelector("canvas");
  const { camera, navigator, renderer, display, selected, view } = seen;
  const items = seen.items();
  const runs: number[] = [];
  for (let start = 0, at = 1; at <= items.length; at += 1) {
    if (items[at] !== items[start]) {
      runs.push(items[start] ?? 0, at - start);
      start = at;
    }
  }
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
    runs,
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
      return { answer: await run(command), faults };
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
