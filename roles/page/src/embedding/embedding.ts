/** Lets the page around this one drive it, and tells it of picks and views: see `examples/embedding`. */

import { effect } from "@preact/signals";
import type { PartRef, Request } from "../../../../examples/embedding/trimaran.d.ts";
import { hide, isolate, showAll } from "../objects/actions.ts";
import { goTo as goToPart } from "../objects/commands.ts";
import type { Selection } from "../objects/selection.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import { withoutSecrets } from "../service/errors.ts";
import type { Part, PartDetails } from "../service/service.ts";
import { layoutOf } from "../tools/pictures/layout.ts";
import { pngOf, takePicture } from "../tools/pictures/takePicture.ts";
import { decodeViewpoint, encodeViewpoint, foreign } from "../tools/viewpoint.ts";
import { goTo, viewpointOf } from "../tools/views.ts";
import type { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { Gate, possibleOrigins } from "./gate.ts";
import { RequestError } from "./requests.ts";

/** Milliseconds between two looks whether the eye rests elsewhere. */
const PERIOD = 250;
/** The most answers of a search to look for a name in. */
const MOST_ANSWERS = 10;

interface Page {
  readonly viewer: Viewer;
  readonly selection: Selection;
  readonly people: People;
}

/** Speaks with the window around this one, from the first picture on. */
export function embed(page: Page): void {
  const { viewer } = page;
  const { name, fingerprint, objects, frameAncestors } = viewer.scene;
  // Firefox does not say who is around.
  const { ancestorOrigins } = location as { readonly ancestorOrigins?: ArrayLike<string> };
  const origins = possibleOrigins([location.origin, ...frameAncestors], ancestorOrigins);
  const tellReady = () => gate.send({ event: "ready", scene: { name, fingerprint, objects } });
  const gate = new Gate(window.parent, origins, async (request) => {
    if (request.do === "hello") {
      tellReady();
      return {};
    }
    return run(page, request);
  });
  const stop = viewer.onPicture(() => {
    stop();
    addEventListener("message", (event) => gate.hear(event));
    tellReady();
    tellSelected(gate, page.selection);
    tellViews(gate, viewer);
    effect(() => {
      const message = withoutSecrets(viewer.session.trouble.value);
      if (message !== "") {
        gate.send({ event: "error", message });
      }
    });
  });
}

async function run(
  { viewer, selection, people }: Page,
  request: Request,
): Promise<{ readonly picture?: Blob }> {
  const { view } = viewer;
  switch (request.do) {
    case "goTo": {
      const part = await partOf(viewer, request.part);
      people.follow(undefined);
      goToPart(viewer, part);
      break;
    }
    case "select": {
      const parts = await partsOf(viewer, request.parts);
      selection.clear();
      for (const part of parts) {
        if (!viewer.selected.peek().covers(objectsOf([part]))) {
          selection.toggle(part);
        }
      }
      break;
    }
    case "isolate":
      view.change(isolate(view.current.peek(), objectsOf(await partsOf(viewer, request.parts))));
      break;
    case "hide":
      view.change(hide(view.current.peek(), objectsOf(await partsOf(viewer, request.parts))));
      break;
    case "showAll":
      view.change(showAll(view.current.peek(), view.modelSeeThrough));
      break;
    case "setView":
      people.follow(undefined);
      setView(viewer, request);
      break;
    case "takePicture":
      people.follow(undefined);
      return { picture: await pictureOf(viewer, selection.details.peek(), request) };
  }
  return {};
}

function setView(viewer: Viewer, request: Extract<Request, { do: "setView" }>): void {
  if ("pose" in request) {
    viewer.navigator.jumpTo({ ...request.pose, mode: "fly" });
    return;
  }
  const viewpoint = decodeViewpoint(request.view);
  if (viewpoint === undefined) {
    throw new RequestError('"view" is damaged, or of another version of this page');
  }
  const why = foreign(viewpoint, viewer.scene);
  if (why !== undefined) {
    throw new RequestError(`"view" cannot be shown: ${why}`);
  }
  goTo(viewer, viewpoint);
}

async function pictureOf(
  viewer: Viewer,
  picked: PartDetails | undefined,
  { size, isCaptioned = false }: Extract<Request, { do: "takePicture" }>,
): Promise<Blob> {
  const { canvas, scene } = viewer;
  const screen = { width: canvas.width, height: canvas.height };
  const [width, height] = scene.maxPicture;
  const wish = { size: size ?? screen, keepsShape: size === undefined, isCaptioned };
  const taken = await takePicture(viewer, {
    layout: layoutOf(wish, screen, { width, height }),
    text: "",
    subject: picked?.name ?? "",
    picked,
    hasDimensions: false,
    signal: new AbortController().signal,
    onProgress: () => {},
  });
  return pngOf(taken);
}

function partsOf(viewer: Viewer, parts: readonly PartRef[]): Promise<readonly PartDetails[]> {
  return Promise.all(parts.map((part) => partOf(viewer, part)));
}

async function partOf({ service }: Viewer, part: PartRef): Promise<PartDetails> {
  if (!("name" in part)) {
    return service.details(
      "object" in part ? { kind: "object", id: part.object } : { kind: "group", id: part.group },
    );
  }
  let from = 0;
  for (let answer = 0; answer < MOST_ANSWERS; answer += 1) {
    const { parts } = await service.search(part.name, from);
    const found = parts.find(({ name }) => name === part.name);
    if (found !== undefined) {
      return service.details(found);
    }
    from += parts.length;
    if (parts.length === 0) {
      break;
    }
  }
  throw new RequestError(`no part is called “${part.name}”`);
}

function objectsOf(parts: readonly Pick<Part, "first" | "end">[]): ObjectSet {
  return parts.reduce((all, { first, end }) => all.union(ObjectSet.run(first, end)), ObjectSet.EMPTY);
}

function tellSelected(gate: Gate, selection: Selection): void {
  let told = "[]";
  effect(() => {
    const parts = selection.parts.value.map(({ kind, id, name }) => ({ kind, id, name }));
    // The details of a pick come from the service.
    if (parts.length === selection.count.value && JSON.stringify(parts) !== told) {
      told = JSON.stringify(parts);
      gate.send({ event: "selected", parts });
    }
  });
}

function tellViews(gate: Gate, viewer: Viewer): void {
  const { navigator, view } = viewer;
  const now = () => ({ eye: navigator.eye, forward: navigator.forward, vfovDeg: navigator.vfovDeg });
  let [last, told] = ["", JSON.stringify(now())];
  let toldView = view.current.peek();
  setInterval(() => {
    const [pose, seen] = [now(), view.current.peek()];
    const text = JSON.stringify(pose);
    const rests = text === last;
    last = text;
    if (rests && (text !== told || seen !== toldView)) {
      [told, toldView] = [text, seen];
      gate.send({ event: "viewChanged", pose, view: encodeViewpoint(viewpointOf(viewer)) });
    }
  }, PERIOD);
}
