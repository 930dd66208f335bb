/** Updates overlays with the picture's camera. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Camera } from "../draw/model.ts";
import { Projection } from "../draw/projection.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** The projection of the picture that is on the canvas. */
export function useProjection(viewer: Viewer): Projection {
  const camera = useSignal<Camera>(viewer.camera);
  useEffect(
    () =>
      viewer.onPicture((drawn) => {
        camera.value = drawn;
      }),
    [viewer],
  );
  const { clientWidth, clientHeight } = viewer.canvas;
  return new Projection(camera.value, clientWidth, clientHeight);
}
