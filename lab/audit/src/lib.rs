//! Checks of culling and images, independent of the culling code.
//!
//! A rasterizer in f64 follows Vulkan's rules: slow, simple, and independent of any GPU. On it stand a
//! walkthrough that compares every frame with the truth, and the search for the cause of a false cull.
//! Nothing of it runs while a user walks.
//!
//! ```
//! use trimaran_audit::{Fault, ReferenceWalkthrough};
//! use trimaran_audit::cases::{plant, plant_views};
//! use trimaran_cull::{LodRule, Viewport};
//! # use glam::DVec3;
//!
//! let scene = plant(21, 300, DVec3::ZERO)?;
//! let views = plant_views(21, 300, DVec3::ZERO, Viewport::new(96, 80)?, 5)?;
//! let rule = LodRule::new(4.0)?;
//! let mut sound = ReferenceWalkthrough::new(scene.clone(), rule);
//! let mut faulty = ReferenceWalkthrough::new(scene, rule).with_fault(Fault::DroppedIds(9));
//! let mut lost = 0;
//! for view in &views {
//!     assert_eq!(sound.frame(view)?.differing_pixels, 0); // culling changes no pixel
//!     for cull in faulty.frame(view)?.false_culled {
//!         println!("{} is missing at {} pixels: {}", cull.id, cull.pixels, cull.cause.words());
//!         lost += cull.pixels;
//!     }
//! }
//! assert!(lost > 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `raster`, `id_buffer` | [`rasterize`]: drawables to an [`IdBuffer`], the triangle at each pixel |
//! | `occlusion_test` | [`ReferenceTest`]: boxes rasterized against an [`IdBuffer`]'s depth |
//! | `walkthrough`, `fault` | [`ReferenceWalkthrough`]: all roles beside the truth; a [`Fault`] breaks one |
//! | `attribution` | [`causes`]: why something visible was not drawn |
//! | `nearest`, `grid` | [`distances_to_surfaces`]: how far pixels are from where surfaces lie |
//! | [`metrics`] | how wrong an image is: false culls, mismatching pixels, PSNR, FLIP, deviation |
//! | [`cases`] | scenes and camera paths for tests: the hard cases of culling, a random plant |
//! | [`search`] | scenes and walks at random, and the smallest that fails |

mod attribution;
pub mod cases;
mod fault;
mod grid;
mod id_buffer;
pub mod metrics;
mod nearest;
mod occlusion_test;
mod raster;
pub mod search;
mod walkthrough;

pub use attribution::{CulledFrame, Missing, causes};
pub use fault::Fault;
pub use id_buffer::{IdBuffer, Placement, TriangleId, rasterize};
pub use nearest::distances_to_surfaces;
pub use occlusion_test::ReferenceTest;
pub use raster::{Coverage, rasterize_triangle};
pub use walkthrough::{FalseCull, FrameReport, ReferenceWalkthrough, Testing, WalkthroughError};
