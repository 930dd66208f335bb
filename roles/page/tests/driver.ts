/**
 * Drives the page in Chromium for a test program: one JSON command per line on standard input, one answer per
 * line on standard output.
 */

import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { chromium, type Download } from "playwright-core";
import type { Point } from "../src/space/point.ts";
import type { Viewer } from "../src/viewer/viewer.ts";
import { contrasts } from "./contrast.ts";

declare global {
  interface Window {
    trimaran?: Viewer;
    eyes?: Point[];
    /** How often the page was to be printed. */
    prints?: number;
    /** Lets the time pass for which messages and marks are shown. */
    pass?: () => Promise<void>;
  }
}

/** The timeout of a command, milliseconds: a CPU may take long for an exact picture. */
const LONGEST = 90_000;

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
page.setDefaultTimeout(LONGEST);
if (hasMotion) {
  await page.addInitScript(recordEyes);
}
// The system's dialog would wait for a person.
await page.addInitScript(() => {
  window.prints = 0;
  window.print = () => {
    window.prints = (window.prints ?? 0) + 1;
  };
});
await page.addInitScript(holdTimers);
await page.addInitScript(holdRefinement);
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

interface Pinch {
  readonly from: number;
  readonly to: number;
  readonly right: number;
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
  /** Waits for the fine picture of an eye at rest. */
  async refine() {
    await page.evaluate(releaseRefinement);
    await until(() => {
      return page.evaluate(() => {
        const { isSettled, renderer } = window.trimaran ?? {};
        return isSettled === true && renderer?.isFine === true;
      });
    });
  },
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
  /** Ends the time for which messages and marks are shown: it does not pass by itself. */
  pass: () => page.evaluate(() => window.pass?.()),
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
  /** Gives a file on the disk to the input of this selector. */
  upload: ({ selector, path }: Chosen & { path: string }) => page.locator(selector).setInputFiles(path),
  /** Types a text into the field with this label, in place of what it has. */
  fill: ({ label, text }: { label: string; text: string }) =>
    page.getByLabel(label, { exact: true }).fill(text),
  /** The colours that the system prefers. */
  prefer: ({ scheme }: { scheme: "light" | "dark" }) => page.emulateMedia({ colorScheme: scheme }),
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
  /** Two fingers at both sides of a place move from one distance to another, and across. */
  pinch: (fingers: Spot & Pinch) => pinch(fingers),
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
  /** Clicks the download button of this name; returns the file's text. */
  async downloaded({ name }: Name) {
    return readFileSync(await (await downloaded(name)).path(), "utf8");
  },
  /** Scrolls the element to its end; returns how many pixels that is. */
  end: ({ selector }: Chosen) =>
    page.evaluate((selector) => {
      const element = document.querySelector(selector);
      element?.scrollTo({ top: element.scrollHeight });
      return element?.scrollTop;
    }, selector),
  /** The colour of the picture at a place in CSS pixels, from 0 to 255. */
  colour: (at: Spot) => page.evaluate(colour, at),
  /** The same; returns the file's name. It is saved at `path`, if given. */
  async download({ name, path }: Name & { path?: string }) {
    const download = await downloaded(name);
    if (path !== undefined) {
      await download.saveAs(path);
    }
    return download.suggestedFilename();
  },
  /** The sizes of the document's pages on paper in points, once it was to be printed so often. */
  async paper({ times }: { times: number }) {
    await until(async () => (await page.evaluate(() => window.prints)) === times, "printing");
    const pdf = (await page.pdf({ preferCSSPageSize: true })).toString("latin1");
    const boxes = [...pdf.matchAll(/\/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)\s*\]/g)];
    return boxes.map((box) => [Number(box[1]), Number(box[2])]);
  },
  /** All texts with their contrast to what is behind them: see `contrast.ts`. */
  contrasts: () => page.evaluate(contrasts),
  /** The width and height in the file of the first image that is there, once it is loaded. */
  async image({ selector }: Chosen) {
    let size: unknown;
    await until(async () => {
      size = await page.evaluate((selector) => {
        const image = document.querySelector<HTMLImageElement>(selector);
        return image?.complete === true ? [image.naturalWidth, image.naturalHeight] : undefined;
      }, selector);
      return size !== undefined;
    });
    return size;
  },
  /**
   * Opens the model in a window of its own from this page, and has this page send requests to it. Returns
   * what this page hears, and what they have done.
   */
  async popup({ url }: { url: string }) {
    const opened = page.context().waitForEvent("page");
    await page.evaluate((url) => {
      const heard: unknown[] = [];
      Object.assign(window, { heard, opened: window.open(url) });
      addEventListener("message", ({ data }) => heard.push(data));
    }, url);
    const model = await opened;
    await until(() => model.evaluate(() => window.trimaran?.isSettled === true));
    const heard = await page.evaluate(async () => {
      const { opened, heard } = window as unknown as { opened: Window; heard: unknown[] };
      for (const what of [{ do: "hello" }, { do: "select", parts: [{ object: 1 }] }, { do: "x" }]) {
        opened.postMessage({ trimaran: 1, id: 1, ...what }, "*");
      }
      await new Promise((resolve) => setTimeout(resolve, 1000));
      return heard;
    });
    const { selected } = (await model.evaluate(state)) as { selected: unknown };
    const drawn = await model.evaluate(() => (window.trimaran?.pictures ?? 0) > 0);
    await model.close();
    return { heard, selected, drawn };
  },
  /** Whether panels are light or dark. */
  theme: () => page.evaluate(() => document.documentElement.dataset.theme),
  /** A number that changes with the pixels of the fine picture. */
  async pixels() {
    await page.evaluate(releaseRefinement);
    return page.evaluate(pixels);
  },
  /** The result of `state` in the first frame of the document; nothing while it shows no model. */
  framed: () => page.frames()[1]?.evaluate(state),
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

async function downloaded(name: string): Promise<Download> {
  const button = page.getByRole("button", { name, exact: true });
  const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return download;
}

/** Runs in the page. */
function colour({ x, y }: Spot): readonly number[] | undefined {
  const seen = window.trimaran;
  seen?.drawNow();
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [1, 1];
  const context = copy.getContext("2d");
  if (seen === undefined || context === null) {
    return undefined;
  }
  context.drawImage(seen.canvas, -Math.floor(x * seen.scale), -Math.floor(y * seen.scale));
  return [...context.getImageData(0, 0, 1, 1).data.slice(0, 3)];
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
function pixels(): number {
  const seen = window.trimaran;
  seen?.drawNow();
  // FNV-1a.
  let hash = 0x811c9dc5;
  for (const letter of seen?.canvas.toDataURL() ?? "") {
    hash = Math.imul(hash ^ letter.charCodeAt(0), 0x01000193) >>> 0;
  }
  return hash;
}

/** Runs in the page. */
function state(): unknown {
  const seen = window.trimaran;
  const { hidden, isolated, seeThrough, sections, colouring } = seen?.view.current.value ?? {};
  return {
    ...seen?.camera,
    start: seen?.scene.start,
    forward: seen?.navigator.forward,
    mode: seen?.navigator.mode.value,
    selected: [...(seen?.selected.value ?? [])],
    hidden: [...(hidden ?? [])],
    isolated: isolated && [...isolated],
    seeThrough: [...(seeThrough ?? [])],
    sections,
    colouring: {
      by: colouring?.by,
      paints: colouring?.paints.map((paint) => ({ ...paint, objects: [...paint.objects] })),
    },
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

/** In ten steps. */
async function pinch({ x, y, from, to, right }: Spot & Pinch): Promise<void> {
  const devtools = await page.context().newCDPSession(page);
  const send = (type: "touchStart" | "touchMove" | "touchEnd", share: number) => {
    const [half, middle] = [(from + (to - from) * share) / 2, x + right * share];
    const fingers = [-half, half].map((off, id) => ({ x: middle + off, y, id }));
    return devtools.send("Input.dispatchTouchEvent", {
      type,
      touchPoints: type === "touchEnd" ? [] : fingers,
    });
  };
  await send("touchStart", 0);
  for (let step = 1; step <= 10; step += 1) {
    await send("touchMove", step / 10);
  }
  await send("touchEnd", 1);
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

/**
 * Usable controls: name, place, size of letters, whether a finger there meets it, and whether all of it is on
 * the screen or can be scrolled there. Runs in the page.
 */
function targets(wanted: string): unknown {
  const controls = document.querySelectorAll<HTMLElement>(
    "button, input, select, summary, label.file, [role=treeitem] > .link",
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
    const bar = control.closest(".bar");
    const isClipped = bar !== null && getComputedStyle(bar).overflowX === "hidden";
    const isWithin = left > -1 && top > -1 && left + width < innerWidth + 1 && top + height < innerHeight + 1;
    const isInReach = isWithin && !isClipped;
    return [{ name, tag: control.tagName.toLowerCase(), x, y, width, height, letters, isMet, isInReach }];
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
  for (const began = performance.now(); performance.now() - began < LONGEST; ) {
    if (await holds()) {
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
  throw new Error(`${what} does not come about within ${LONGEST} ms`);
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

/**
 * Runs in the page. Timers of 5 to 10 s, which end messages and marks, and those of 1.5 s, which confirm a
 * copy, run when time is told to pass: a machine under load may take longer than that to look.
 */
function holdTimers(): void {
  const held = new Map<number, () => void>();
  const [start, stop] = [window.setTimeout, window.clearTimeout];
  Object.assign(window, {
    setTimeout(run: () => void, milliseconds = 0, ...given: unknown[]) {
      const isHeld = milliseconds === 1500 || (milliseconds > 5000 && milliseconds < 10_000);
      const timer = start(isHeld ? () => {} : run, milliseconds, ...given);
      if (isHeld) {
        held.set(timer, run);
      }
      return timer;
    },
    clearTimeout(timer?: number) {
      held.delete(timer ?? 0);
      stop(timer);
    },
    async pass() {
      // A text may be read before the timer that ends it is set.
      while (held.size === 0) {
        await new Promise((resolve) => start(resolve, 20));
      }
      for (const run of held.values()) {
        run();
      }
      held.clear();
    },
  });
}

/** Runs in the page. A CPU takes seconds for a fine picture: it comes where a test asks for it. */
function holdRefinement(): void {
  let viewer: Viewer | undefined;
  Object.defineProperty(window, "trimaran", {
    get: () => viewer,
    set(made: Viewer) {
      made.renderer.refine = () => false;
      viewer = made;
    },
  });
}

/** Runs in the page. */
function releaseRefinement(): void {
  const renderer: { refine?: unknown } | undefined = window.trimaran?.renderer;
  delete renderer?.refine;
}

/** Chromium's error when the document has gone. */
const IS_GONE = /context was destroyed|Cannot find context|a different document|because of a navigation/;

/** The page may reload during a command, as for another scene. Then the command is repeated. */
async function answered(command: Command): Promise<unknown> {
  for (const begun = performance.now(); ; ) {
    try {
      return { answer: await run(command), faults };
    } catch (error) {
      if (!IS_GONE.test(String(error)) || performance.now() - begun > LONGEST) {
        return { error: String(error), faults };
      }
    }
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(`${JSON.stringify(await answered(JSON.parse(line) as Command))}\n`);
}
await browser.close();
