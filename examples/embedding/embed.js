// @ts-check
// Shows a model of `trimaran serve --frame-ancestors ORIGIN` in a frame, and drives it. `trimaran.d.ts` has
// all messages. Serve this folder at ORIGIN, and open it as `index.html?service=ADDRESS`: the address that
// `serve` has printed, encoded. Everybody who gets this page's address can see the model: it has the token.

/** @typedef {import("./trimaran.d.ts").Message} Message */
/** @typedef {import("./trimaran.d.ts").Pose} Pose */

/** @param {string} id */
const element = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
const frame = /** @type {HTMLIFrameElement} */ (element("model"));
const part = /** @type {HTMLInputElement} */ (element("part"));

const service = new URL(new URLSearchParams(location.search).get("service") ?? "http://127.0.0.1:7480/");
frame.src = service.href;

/** @type {Pose | undefined} */
let first;
let last = 0;

/**
 * Sends a request. It reaches the frame only if that still shows the service.
 * @param {object} request
 */
function ask(request) {
  last += 1;
  frame.contentWindow?.postMessage({ trimaran: 1, id: last, ...request }, service.origin);
}

/** @param {string} text */
function log(text) {
  const row = document.createElement("li");
  row.textContent = text;
  element("log").append(row);
  return row;
}

addEventListener("message", ({ source, origin, data }) => {
  // Any window can send messages: only those of the frame count.
  if (source !== frame.contentWindow || origin !== service.origin || data?.trimaran !== 1) {
    return;
  }
  const message = /** @type {Message} */ (data);
  switch (message.event) {
    case "ready":
      log(`ready: ${message.scene.name}, ${message.scene.objects} objects`);
      break;
    case "selected":
      log(`selected: ${message.parts.map(({ kind, id, name }) => name || `${kind} ${id}`).join(", ")}`);
      break;
    case "viewChanged":
      first ??= message.pose;
      log(`view: ${message.pose.eye.map((metres) => metres.toFixed(2)).join(" ")}`);
      break;
    case "error":
      log(`error ${message.id ?? ""}: ${message.message}`);
      break;
    case "done": {
      const row = log(`done ${message.id}`);
      if (message.picture !== undefined) {
        const image = document.createElement("img");
        image.src = URL.createObjectURL(message.picture);
        image.width = 160;
        row.append(image);
      }
      break;
    }
  }
});

/** The request of each button. */
const REQUESTS = {
  goTo: () => ({ part: { name: part.value } }),
  select: () => ({ parts: [{ name: part.value }] }),
  isolate: () => ({ parts: [{ name: part.value }] }),
  hide: () => ({ parts: [{ name: part.value }] }),
  showAll: () => ({}),
  setView: () => ({ pose: first }),
  takePicture: () => ({ size: { width: 1280, height: 720 }, isCaptioned: true }),
};

element("controls").addEventListener("click", ({ target }) => {
  if (target instanceof HTMLButtonElement) {
    const wanted = /** @type {keyof typeof REQUESTS} */ (target.value);
    ask({ do: wanted, ...REQUESTS[wanted]() });
  }
});
