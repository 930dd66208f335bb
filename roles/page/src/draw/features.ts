/** What the browser and the device can do, beyond what all can that have WebGL2. */

/** What depth is: near over distance, from 0 to 1; or the usual, 1 at infinity and coarse there. */
export type Depth = "reversed" | "standard";
/** How a shader knows which draw it works on. */
export type DrawNumber = "multi-draw" | "uniform";
/** Which corner of a triangle decides what is flat in it. */
export type Provoking = "first" | "last";

/** EXT_clip_control, which the library of types does not have. */
interface ClipControl {
  clipControlEXT(origin: number, depth: number): void;
  readonly LOWER_LEFT_EXT: number;
  readonly ZERO_TO_ONE_EXT: number;
}

/** WEBGL_provoking_vertex, which it does not have either. */
interface ProvokingVertex {
  provokingVertexWEBGL(convention: number): void;
  readonly FIRST_VERTEX_CONVENTION_WEBGL: number;
}

export interface Features {
  readonly depth: Depth;
  readonly provoking: Provoking;
  /** Draws many ranges of indices by one call. */
  readonly multiDraw: WEBGL_multi_draw | null;
  /** What draws, in the words of its driver. */
  readonly device: string;
  /** The processor draws, not a graphics card. */
  readonly isSoftware: boolean;
  /** The most samples a pixel can have. */
  readonly mostSamples: number;
  /** The most pixels that a side of a picture can have. */
  readonly longestSide: number;
}

/**
 * Finds out what there is, and switches it on. With `extensions` all there is, without them the least that
 * any browser has; where that is left open, what makes it faster.
 */
export function featuresOf(gl: WebGL2RenderingContext, extensions: boolean | undefined): Features {
  const extension = (name: string): unknown => (extensions === false ? null : gl.getExtension(name));
  const clip = extension("EXT_clip_control") as ClipControl | null;
  clip?.clipControlEXT(clip.LOWER_LEFT_EXT, clip.ZERO_TO_ONE_EXT);
  const provoking = extension("WEBGL_provoking_vertex") as ProvokingVertex | null;
  provoking?.provokingVertexWEBGL(provoking.FIRST_VERTEX_CONVENTION_WEBGL);
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const device = String(gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
  const isSoftware = /swiftshader|llvmpipe|software|basic render/i.test(device);
  // A processor has to find out for each vertex which draw it is of: that takes longer than a call.
  const isFaster = extensions ?? !isSoftware;
  return {
    depth: clip === null ? "standard" : "reversed",
    provoking: provoking === null ? "last" : "first",
    multiDraw: isFaster ? (extension("WEBGL_multi_draw") as WEBGL_multi_draw | null) : null,
    device,
    isSoftware,
    mostSamples: Number(gl.getParameter(gl.MAX_SAMPLES)),
    longestSide: Number(gl.getParameter(gl.MAX_RENDERBUFFER_SIZE)),
  };
}
