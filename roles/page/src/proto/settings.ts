/** The display's settings of a session. */

import { bool, checked, f64, MOST_ITEMS, type Of, record, u32, variant } from "trimaran-transport";

/** The most pixels of a side of a picture. */
const MOST_PIXELS = 65_536;

/** A picture's size in pixels, each side 1 to 65,536. */
export const VIEWPORT = checked(record({ width: u32, height: u32 }), ({ width, height }) =>
  Math.min(width, height) < 1 || Math.max(width, height) > MOST_PIXELS
    ? `a picture of ${width}x${height} pixels has a side outside 1 to ${MOST_PIXELS}`
    : undefined,
);

/** The rule for levels of detail. */
export const LEVEL_RULE = record({
  /** Error bound in pixels: finite, above 0. */
  epsilon: checked(f64, (epsilon) =>
    Number.isFinite(epsilon) && epsilon > 0
      ? undefined
      : `an error bound of ${epsilon} pixels: it must be a finite number above 0`,
  ),
  /** Culling stops at nodes visible at fewer pixels than that. */
  fewPixels: bool,
});

/** How a culler tests whether a node's box is visible. */
export const OCCLUSION_TEST = variant(["query", "raster", "hzb"]);

export type OcclusionTest = Of<typeof OCCLUSION_TEST>;

export const SETTINGS = record({
  viewport: VIEWPORT,
  levelRule: LEVEL_RULE,
  /** Ids in a batch at most, 1 to 16,384. */
  batch: checked(u32, (batch) =>
    batch < 1 || batch > MOST_ITEMS ? `a batch of ${batch} is outside 1 to ${MOST_ITEMS}` : undefined,
  ),
  /** How ids may be coded. */
  coding: variant(["plain", "changes"]),
  occlusionTest: OCCLUSION_TEST,
});

export type Settings = Of<typeof SETTINGS>;
