//! What is drawn: the level-of-detail cut and occlusion culling, as pure functions over a [`BoxTester`].

mod tester;
mod view;

pub use tester::{BoxTester, TestBox};
pub use view::{View, Viewport, ViewportError};
