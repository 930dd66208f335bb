/** The page: a canvas that shows the scene from a person's eye, and panels beside it. */

import "./page.css";
import { applyTheme } from "./controls/theme.ts";
import { showPanels } from "./panels/app.tsx";
import { showCooking } from "./panels/cooking.tsx";
import { messageOf } from "./service/errors.ts";
import { Service } from "./service/service.ts";
import { flyDown, isMotionReduced } from "./tools/overview.ts";
import { coverPrints } from "./tools/pictures/sheet.ts";
import { followLink } from "./tools/views.ts";
import { hasRestarted, Viewer } from "./viewer/viewer.ts";

declare global {
  interface Window {
    /** For a program that drives the page. */
    trimaran?: Viewer;
  }
}

async function begin(): Promise<void> {
  applyTheme();
  const canvas = document.querySelector<HTMLCanvasElement>("#picture");
  const panels = document.querySelector<HTMLElement>("#panels");
  if (canvas === null || panels === null) {
    return;
  }
  try {
    const service = new Service(location.href);
    const scene = await service.cooked((cooking) => showCooking(panels, cooking));
    document.title = `${scene.name} - Trimaran`;
    const isDriven = /^#drive(=|$)/.test(location.hash);
    const network = isDriven ? location.hash.slice("#drive=".length) : "";
    const viewer = new Viewer(canvas, scene, service, network);
    window.trimaran = viewer;
    showPanels(panels, viewer);
    coverPrints(viewer);
    if (hasRestarted()) {
      viewer.said.value = `The service shows another model now: ${scene.name}.`;
    }
    followLink(viewer, new URL(location.href));
    if (!isDriven && !location.hash.startsWith("#v=") && !isMotionReduced()) {
      flyDown(viewer);
    }
    // Entering a link with another fragment does not reload the page.
    addEventListener("hashchange", ({ newURL }) => followLink(viewer, new URL(newURL)));
    if (isDriven) {
      const { drive } = await import("./drive/drive.ts");
      await drive(viewer, service);
    }
  } catch (error) {
    const status = document.createElement("p");
    status.id = "status";
    status.role = "alert";
    status.textContent = messageOf(error);
    const notice = document.createElement("div");
    notice.className = "panel notice";
    notice.append(status);
    panels.replaceChildren(notice);
  }
}

void begin();
