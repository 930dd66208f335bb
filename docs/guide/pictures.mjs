// Takes the pictures of the guide again, and the README's, by real clicks and keys in a real browser.
//
//   trimaran import huldra/HA-[!S]*.RVM huldra/WD1-PSUP.RVM -o huldra.scene
//   trimaran serve huldra.scene --listen 127.0.0.1:7480 --token guidepictures0001
//   node docs/guide/pictures.mjs "http://127.0.0.1:7480/?token=guidepictures0001" docs/images [NAME..]
//
// HA-SAFE.RVM is left out: its escape routes, strips in the air, would cover much.
// It writes guide/NAME.webp for each page of the guide, and page.png for the README; names choose some of
// them (`readme` is page.png). It takes `npm ci` in roles/page, and Chromium, which TRIMARAN_CHROMIUM may
// name. If pngquant is there, page.png is reduced to 256 colours. `notes` writes a note, and deletes it.
import { spawnSync } from "node:child_process";
import { mkdirSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const { chromium } = createRequire(new URL("../../roles/page/package.json", import.meta.url))(
  "playwright-core",
);

/** The size of the page in a picture of the guide, and in the README's. */
const SIZE = { width: 1080, height: 672 };
const README_SIZE = { width: 1280, height: 800 };
/** Device pixels of a CSS pixel on the way to a picture: few are drawn sooner. */
const COARSE = 0.25;
/** The most bytes of a picture of the guide. */
const MOST_BYTES = 80_000;
/** The timeout for an exact picture, and the time for which it must rest, milliseconds. */
const LONGEST = 600_000;
const REST = 1000;

/** Objects of the model, by their names. */
const VESSEL = "/42-VL56";
const LYING_VESSEL = "/43-VD50";
const TANKS = ["/20-TA50A", "/20-TA50B"];
const VALVE = "/20-XV2015";
const PIPE = "/PL-202001_HA";
const SUPPORT = "/PS/WD1/0004/F3";
/** Sections of one profile, by an attribute. */
const PROFILE = "spref:RHS80x80";

/** One function for each picture: it brings the page to what is to be seen. */
const PICTURES = {
  async open(page) {
    await press(page, "Home");
  },
  async move() {
    // As a walk begins.
  },
  async overview(page) {
    await press(page, "8");
    await button(page, "Standard views");
  },
  async parallel(page) {
    await goTo(page, VESSEL);
    await press(page, "r");
    await press(page, "4");
    await stepBack(page, 3);
    // Nothing is picked, so that no panel covers the drawing.
    await press(page, "Escape");
    await button(page, "Standard views");
  },
  async keys(page) {
    await press(page, "Home");
    await button(page, "Keys");
    await page.mouse.move(SIZE.width / 2, SIZE.height / 2);
    await page.mouse.wheel(0, -SIZE.height);
  },
  async find(page) {
    await goTo(page, LYING_VESSEL);
    await search(page, "vd50");
  },
  async pick(page) {
    await goTo(page, SUPPORT);
    await stepBack(page, 2);
  },
  async hide(page) {
    await goTo(page, VESSEL);
    await press(page, "g");
    await stepBack(page, 1);
  },
  async kinds(page) {
    await search(page, PROFILE);
    await button(page, "Select");
    await until(() => page.evaluate(() => !window.trimaran.selected.value.isEmpty), "a selection");
    await press(page, "f");
    await press(page, "g");
    // The list of the last search.
    await page.keyboard.press("/");
    await page.locator(".found-actions").waitFor();
  },
  async cut(page) {
    await goTo(page, VESSEL);
    await press(page, "0");
    await press(page, "b");
    await button(page, "Box around");
    await page.locator(".handle").nth(5).waitFor();
    await settle(page);
    // The side towards the eye, to the middle of the box.
    const [from, to] = await page.evaluate(() => {
      const { view, projection } = window.trimaran;
      const [{ lower, upper }] = view.current.value.sections;
      const middle = lower.map((low, axis) => (low + upper[axis]) / 2);
      return [[middle[0], middle[1], upper[2]], middle].map((point) => projection.place(point));
    });
    await drag(page, from, to);
  },
  async measure(page) {
    await press(page, "m");
    await choose(page, "What is measured", "Two parts");
    for (const tank of TANKS) {
      await goTo(page, tank);
    }
    await page.locator(".sections ol strong").first().waitFor();
    await press(page, "7");
    await stepBack(page, 4);
  },
  async clashes(page) {
    await goTo(page, PIPE);
    await press(page, "o");
    await button(page, "Between: take what is picked");
    await press(page, "Escape");
    await page.getByLabel("Tolerance, mm").fill("20");
    await choose(page, "Ignore", "in the same equipment");
    await button(page, "Run");
    await page.locator(".clashes ol button").first().click();
    await settle(page);
    await stepBack(page, 6);
  },
  async where(page) {
    await press(page, "j");
    const field = page.getByLabel("Go to coordinates", { exact: true });
    await field.fill("E 110.94 N 302.69 U 27.5");
    await field.press("Enter");
    await settle(page);
    const { x, y } = middle(page);
    await page.mouse.move(x + 5, y + 20);
    await page.locator("[data-name=pointer] button").waitFor();
  },
  async views(page) {
    await press(page, "v");
    for (const vessel of [VESSEL, LYING_VESSEL]) {
      await goTo(page, vessel);
      await press(page, "g");
      await button(page, "Keep this view");
    }
  },
  async share(page) {
    await goTo(page, VESSEL);
    await stepBack(page, 4);
    await press(page, "v");
    await button(page, "Copy link");
    await page.locator("#status p").first().waitFor();
  },
  async pictures(page) {
    await goTo(page, VALVE);
    await press(page, "v");
    // The dialog says the picture's size.
    await sharpen(page);
    await button(page, "Picture");
    await page.locator("dialog.picture").waitFor();
  },
  async notes(page) {
    await goTo(page, VALVE);
    await press(page, "n");
    await button(page, "New note");
    const name = page.getByLabel("Your name", { exact: true });
    if ((await name.count()) > 0) {
      await name.fill("Ada");
    }
    await page.getByLabel("Note", { exact: true }).fill("No room for the handle\nTurn it by 90 degrees.");
    await button(page, "Keep note");
    await page.locator(".overlay .marker").first().waitFor();
    return () => button(page, "Delete note");
  },
  async meet(page, another) {
    const other = await another();
    await goTo(other, VESSEL);
    await goTo(page, VESSEL);
    await stepBack(page, 4);
    // Round the vessel: the other person stands beside the line of sight then.
    await turn(page, -90);
    await press(page, "v");
    await page.locator(".people [data-person]").first().waitFor();
  },
  async status(page) {
    await press(page, "p");
    await page.locator(".status tr").first().waitFor();
    await page.locator(".status summary").click();
    // Its chart is of the last second.
    await turn(page, 40);
  },
  async readme(page) {
    await goTo(page, LYING_VESSEL);
    await stepBack(page, 2);
  },
};

/** Waits until `holds`, which is asked again and again. The page's policy forbids playwright's own way. */
async function until(holds, what) {
  for (const begun = performance.now(); performance.now() - begun < LONGEST; ) {
    if (await holds()) {
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  throw new Error(`${what} does not come about within ${LONGEST} ms`);
}

/** Waits until the picture is exact, and has not changed for a while; and until it is smooth, if asked. */
async function settle(page, isFine = false) {
  let [pictures, since] = [-1, performance.now()];
  await until(async () => {
    const now = await page.evaluate((isFine) => {
      const viewer = window.trimaran;
      return viewer?.isSettled && (viewer.renderer.isFine || !isFine) ? viewer.pictures : -1;
    }, isFine);
    if (now === -1 || now !== pictures) {
      [pictures, since] = [now, performance.now()];
    }
    return now !== -1 && performance.now() - since > REST;
  }, "an exact picture");
}

/** Presses a key in the picture. */
async function press(page, key) {
  await page.locator("#picture").focus();
  await page.keyboard.press(key);
  await settle(page);
}

/** Clicks the first button with this name, once it is there. */
async function button(page, name) {
  await page.getByRole("button", { name, exact: true }).first().click();
}

async function choose(page, label, option) {
  await page.getByLabel(label).selectOption({ label: option });
}

/** Types a query, and waits for its list: one of another query may be open before. */
async function search(page, query) {
  const summary = () => page.evaluate(() => document.querySelector("#found-summary")?.textContent);
  await page.locator("#picture").focus();
  await page.keyboard.press("/");
  const before = await summary();
  await page.keyboard.type(query);
  await until(async () => ![undefined, before].includes(await summary()), `a list of ${query}`);
  await page.locator(".found-actions").waitFor();
}

/** Goes to the part of this name by the search, and picks it. */
async function goTo(page, name) {
  await page.locator("#picture").focus();
  await page.keyboard.press("/");
  await page.keyboard.type(`name="${name}"`);
  await page.keyboard.press("Enter");
  await until(
    () => page.evaluate((name) => document.querySelector(".details h2")?.textContent === name, name),
    `that ${name} is picked`,
  );
  await settle(page);
}

/** Goes back from what is in the middle by so many steps of the wheel, in orbit. */
async function stepBack(page, steps) {
  await press(page, "3");
  const { x, y } = middle(page);
  await page.mouse.move(x, y);
  for (let step = 0; step < steps; step += 1) {
    await page.mouse.wheel(0, 120);
  }
  await settle(page);
}

/** Drags from the middle to the right, by so many pixels. */
function turn(page, right) {
  const { x, y } = middle(page);
  return drag(page, { x, y }, { x: x + right, y });
}

function middle(page) {
  const { width, height } = page.viewportSize();
  return { x: width / 2, y: height / 2 };
}

/** Drags with the left button. */
async function drag(page, from, to) {
  await page.mouse.move(from.x, from.y);
  await page.mouse.down();
  await page.mouse.move(to.x, to.y, { steps: 8 });
  await page.mouse.up();
  await settle(page);
}

/** Gives the page one device pixel for each CSS pixel, and waits for the smooth picture. */
async function sharpen(page) {
  const devtools = await page.context().newCDPSession(page);
  const { width, height } = page.viewportSize();
  // The page looks at its pixels when its size changes.
  for (const more of [1, 0]) {
    const size = { width, height: height + more, deviceScaleFactor: 1, mobile: false };
    await devtools.send("Emulation.setDeviceMetricsOverride", size);
    await until(
      () => page.evaluate((height) => document.querySelector("#picture").height === height, size.height),
      "the size",
    );
  }
  await settle(page, true);
  return devtools;
}

/** The page's pixels as a WebP file of at most the permitted size. */
async function webpOf(devtools) {
  for (let quality = 90; quality > 0; quality -= 10) {
    const { data } = await devtools.send("Page.captureScreenshot", { format: "webp", quality });
    const bytes = Buffer.from(data, "base64");
    if (bytes.length <= MOST_BYTES) {
      return bytes;
    }
  }
  throw new Error(`no quality makes it smaller than ${MOST_BYTES} bytes`);
}

/** A new browser's page of the model, at rest. */
async function opened(browser, url, viewport) {
  const context = await browser.newContext({
    viewport,
    deviceScaleFactor: COARSE,
    colorScheme: "light",
    reducedMotion: "reduce",
    locale: "en-GB",
    permissions: ["clipboard-read", "clipboard-write"],
  });
  // The hint on keys would go at some time.
  await context.addInitScript(() => localStorage.setItem("trimaran-hint", "shown"));
  context.setDefaultTimeout(LONGEST);
  const page = await context.newPage();
  await page.goto(url);
  await settle(page);
  return page;
}

async function take(browser, name, url, folder) {
  const isReadme = name === "readme";
  const contexts = [];
  const open = async () => {
    const page = await opened(browser, url, isReadme ? README_SIZE : SIZE);
    contexts.push(page.context());
    return page;
  };
  try {
    const page = await open();
    const undo = await PICTURES[name](page, open);
    // Its outline says that it has the focus.
    await page.locator("#picture").blur();
    const devtools = await sharpen(page);
    if (isReadme) {
      const file = join(folder, "page.png");
      const { data } = await devtools.send("Page.captureScreenshot", { format: "png" });
      writeFileSync(file, Buffer.from(data, "base64"));
      const { error } = spawnSync("pngquant", ["--force", "--output", file, "256", file]);
      console.log(error === undefined ? file : `${file} has all its colours: there is no pngquant`);
    } else {
      const file = join(folder, "guide", `${name}.webp`);
      const bytes = await webpOf(devtools);
      writeFileSync(file, bytes);
      console.log(`${file}: ${bytes.length} bytes`);
    }
    await undo?.();
  } finally {
    for (const context of contexts) {
      await context.close();
    }
  }
}

const [url, folder, ...chosen] = process.argv.slice(2);
const names = chosen.length > 0 ? chosen : Object.keys(PICTURES);
const unknown = names.filter((name) => !(name in PICTURES));
if (folder === undefined || unknown.length > 0) {
  const fault = unknown.length > 0 ? `There is no picture ${unknown.join(", ")}. ` : "";
  console.error(`${fault}usage: node pictures.mjs ADDRESS FOLDER [${Object.keys(PICTURES).join(" | ")}]..`);
  process.exit(2);
}
mkdirSync(join(folder, "guide"), { recursive: true });
const browser = await chromium.launch({
  executablePath: process.env.TRIMARAN_CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
try {
  for (const name of names) {
    await take(browser, name, url, folder).catch((error) => {
      console.error(`${name}: ${error.message}`);
      process.exitCode = 1;
    });
  }
} finally {
  await browser.close();
}
