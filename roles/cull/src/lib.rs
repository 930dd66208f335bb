//! What is drawn: the level-of-detail cut and occlusion culling, as pure functions over a [`BoxTester`].
//!
//! [`Culler::cull`] walks the scene and keeps what shows, [`level_cut`] is what would be drawn without it,
//! [`OccluderMapper`] turns the last frame's visible set into the next one's occluders, and [`draw_order`]
//! puts either into the one order in which everyone draws. Boxes are tested by whatever holds the occluders'
//! depth: a GPU, or [`HzbTester`] on the CPU.

mod boxes;
mod cut;
mod depth;
mod frustum;
mod hzb;
mod occluders;
mod order;
mod picture;
mod screen_box;
mod selection;
mod tester;
mod traverse;
mod view;

pub use boxes::{BoxMaker, DEPTH_ULPS, OUTLINE_PX, POSITION_ULPS, Prepared, Untestable, reaches};
pub use cut::{Choice, CutRule, CutRuleError, LevelCut, choose, level_cut};
pub use depth::{DepthImage, DepthImageError, DepthPyramid};
pub use hzb::{HzbError, HzbTester};
pub use occluders::{OccluderError, OccluderMapper, occluders};
pub use order::{DrawOrder, draw_order};
pub use picture::Picture;
pub use selection::{TriangleBudget, nearest_within, worthiest_within};
pub use tester::{Answer, BoxTester, NoOccluders, Outline, TestBox};
pub use traverse::{CullError, CullStats, Culler};
pub use trimaran_proto::PictureSize as Viewport;
pub use trimaran_proto::SettingsError as ViewportError;
pub use view::{View, aspect};
