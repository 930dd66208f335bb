/** Features of the browser and the device beyond the minimum of WebGL2. */

/** Depth values: near over distance, from 0 to 1; or the standard, 1 at infinity and coarse there. */
export type Depth = "reversed" | "standard";
/** How a shader gets its draw number. */
export type DrawNumber = "multi-draw" | "uniform";
/** The provoking vertex of a triangle, whose flat attributes apply. */
export type Provoking = "first" | "last";

/** EXT_clip_control, which the DOM type library lacks. */
interface ClipControl {
  clipControlEXT(origin: number, depth: number): void;
  readonly LOWER_LEFT_EXT: number;
  readonly ZERO_TO_ONE_EXT: number;
}

/** WEBGL_provoking_vertex, which it lacks as well. */
interface ProvokingVertex {
  provokingVertexWEBGL(convention: number): void;
  readonly FIRST_VERTEX_CONVENTION_WEBGL: number;
}

export interface Features {
  readonly depth: Depth;
  readonly provoking: Provoking;
  /** Draws many ranges of indices in one call. */
  readonly multiDraw: WEBGL_multi_draw | null;
  /** The device's name, by its driver. */
  readonly device: string;
  /** A software renderer, without a graphics card. */
  readonly isSoftware: boolean;
  /** The most samples a pixel can have. */
  readonly mostSamples: number;
}

/**
 * Finds the available features, and enables them. With `extensions` all of them, without them the least that
 * any browser has; by default those that make it faster.
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
  // A software renderer would look up the draw number for each vertex, which takes longer than a call.
  const isFaster = extensions ?? !isSoftware;
  return {
    depth: clip === null ? "standard" : "reversed",
    provoking: provoking === null ? "last" : "first",
    multiDraw: isFaster ? (extension("WEBGL_multi_draw") as WEBGL_multi_draw | null) : null,
    device,
    isSoftware,
    mostSamples: Number(gl.getParameter(gl.MAX_SAMPLES)),
  };
}
