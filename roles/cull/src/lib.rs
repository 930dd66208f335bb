//! LOD selection and occlusion culling, as pure functions. No GPU, socket or clock is needed.
//!
//! An [`OcclusionTest`] decides which boxes are in front of the occluders. It is a GPU, or [`HzbTest`] on the
//! CPU, or one of your own. Undecided boxes count as visible, so culling never makes a hole.
//!
//! ```
//! use trimaran_cull::{
//!     Culler, DepthImage, DepthPyramid, HzbTest, LodRule, View, Viewport, draw_order, lod_cut,
//! };
//! # use glam::DVec3;
//! # use trimaran_audit::cases::{plant, plant_views};
//! # use trimaran_audit::{Placement, rasterize};
//! # let size = Viewport::new(64, 48)?;
//! # let scene = plant(1, 500, DVec3::ZERO)?;
//! # let view: View = plant_views(1, 500, DVec3::ZERO, size, 1)?[0];
//! let rule = LodRule::new(2.0)?; // nothing moves by more than two pixels
//! let mut culler = Culler::new(scene.clone());
//!
//! // The first frame has no occluders: all of the cut that is in the frustum is drawn.
//! let mut drawn = lod_cut(&scene, &view, rule);
//! draw_order(&scene, &view, &mut drawn);
//!
//! // Later frames are culled against the depth of what the last one showed.
//! let depth: Vec<f32> = // read back from a device
//! #     rasterize(&scene, &view, drawn.iter().copied(), Placement::Exact).depth32();
//! let image = DepthImage::new(size, &depth)?;
//! let pyramid = DepthPyramid::over(image);
//! let mut visible = Vec::new();
//! let mut test = HzbTest::new(image, &pyramid)?;
//! let stats = culler.cull(&view, rule, &mut test, |ids| visible.extend_from_slice(ids))?;
//! assert!(visible.len() < drawn.len() && stats.counts.hidden > 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `view` | [`View`]: a camera, its image's size and sections, and every transform from world to pixel |
//! | `cut_rule` | [`CutRule`]: the level rule, and which objects are hidden or seen through |
//! | `lod_cut` | [`LodCut`]: the selected levels of nodes, within an error bound in pixels |
//! | `occluders` | [`OccluderMapper`]: the last frame's visible set as this frame's occluders |
//! | `occluder_selection` | [`select_occluders`]: which of them, within a budget of triangles |
//! | `occlusion_test` | [`OcclusionTest`], the interface to the occluders' depth |
//! | `boxes`, `frustum` | [`BoxMaker`]: the box that is tested in place of a node |
//! | `depth`, `hzb`, `screen_box` | [`HzbTest`]: boxes tested against a pyramid of farthest depths |
//! | `rectangle` | [`RectangleTest`]: the classic test against the same pyramid |
//! | `screen_record` | [`ScreenRecords`]: boxes prepared for the same test on a device |
//! | `traverse` | [`Culler`]: the traversal that keeps the visible nodes |
//! | `rounds` | [`Rounds`]: found nodes as occluders of the same frame, if many are new |
//! | `order` | [`draw_order`]: the drawing order of all roles |
//! | `facing` | [`Solids`]: which sides of its triangles a draw shows |
//! | `findings` | what a check of a frame can find: [`FalseCullCause`], [`ImageDifference`] |
//! | `image` | [`Image`]: a display's picture |
//! | `rgb_image` | [`RgbImage`]: its colours, to and from a PNG file |
//! | `device` | [`CullerDevice`], [`PictureDevice`]: the roles' interface to a GPU |
//!
//! `trimaran-audit` checks the result.

mod boxes;
mod cut_record;
mod cut_rule;
mod depth;
mod device;
mod facing;
mod findings;
mod frustum;
mod hzb;
mod image;
mod lod_cut;
mod occluder_selection;
mod occluders;
mod occlusion_test;
mod order;
mod parallel;
mod reached;
mod rectangle;
mod rgb_image;
mod rounds;
mod screen_box;
mod screen_record;
mod sub_pixel_grid;
mod traverse;
mod view;
mod whole_traversal;

pub use boxes::{BoxMaker, DEPTH_ULPS, POSITION_ULPS, Prepared, Untestable};
pub use cut_record::CutRecord;
pub use cut_rule::CutRule;
pub use depth::{DepthImage, DepthImageError, DepthPyramid};
pub use device::{Cancel, CullerDevice, DeviceClass, PictureDevice};
pub use facing::{Facing, Solids};
pub use findings::{FalseCullCause, ImageDifference, SURFACE_SLACK_PX};
pub use frustum::retain_in_sight;
pub use hzb::{HzbError, HzbTest};
pub use image::Image;
pub use lod_cut::{Choice, LodCut, lod_cut};
pub use occluder_selection::{TriangleBudget, select_occluders, triangles};
pub use occluders::{OccluderError, OccluderMapper, grid_bias_px, occluder_bias_px, occluders};
pub use occlusion_test::{Answer, NoOccluders, OcclusionTest, Outline, TestBox};
pub use order::{DrawOrder, draw_order};
pub use reached::Reached;
pub use rectangle::RectangleTest;
pub use rgb_image::RgbImage;
pub use rounds::{RoundRule, Rounds};
pub use screen_record::{OnScreen, ScreenMargins, ScreenRecord, ScreenRecords};
pub use sub_pixel_grid::SubPixelGrid;
pub use traverse::{CullError, CullStats, Culler, Traversal};
pub use trimaran_proto::{LodRule, LodRuleError, Viewport};
pub use view::View;
pub use whole_traversal::{StepCounts, WholeTraversal};
