//! Messages between Trimaran's roles: cameras, visible ids and identities.
//!
//! [`Walkthrough`] combines them into an application protocol. Links carry its bytes and know nothing of
//! their meaning. Sans-IO: nothing here touches a socket, a clock or a GPU. `WIRE.md` beside this crate
//! specifies every byte.
//!
//! ```
//! use trimaran_proto::{Camera, FrameNumber, Walkthrough};
//! use trimaran_wire::Format;
//!
//! let camera = Camera::new([4.0, 1.7, 4.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(7))?;
//! assert_eq!(Camera::from_bytes(&camera.to_bytes())?, camera);
//! // A camera is all that the latest lane holds, and what a frame of ids begins with.
//! assert_eq!(Format::of::<Walkthrough>().latest, Camera::SIZE);
//! # Ok::<(), trimaran_proto::CameraError>(())
//! ```
//!
//! | module | contents |
//! |---|---|
//! | `walkthrough`, `role_message` | [`Walkthrough`]: the protocol of the three roles, and its messages |
//! | `camera`, `id` | the values sent: a camera, a drawable's id |
//! | `coding` | ids as changes against an earlier frame |
//! | `identity`, `outline`, `settings` | a role's identity and scene, and a session's settings |
//! | `supply` | the bulk lane: geometry for a display without the scene |
//! | `view_state` | settings during a walkthrough: sections, hidden objects, picture size, error bound |
//! | `stats` | a culler's statistics for a frame |

mod camera;
mod coding;
mod id;
mod id_coding;
mod identity;
mod lod_rule;
mod named;
mod object_set;
mod occlusion_test;
mod outline;
mod role_message;
mod section;
mod settings;
mod settings_error;
mod stats;
mod supply;
mod varint;
mod view_state;
mod viewport;
mod walkthrough;

pub use camera::{Camera, CameraError};
pub use coding::{CodedViolation, CodingFault, IdDecoder, IdEncoder};
pub use id::{DrawableId, ID_BYTES, IdBatch, SceneHash, ViewVersion};
pub use id_coding::IdCoding;
pub use identity::{CloseCode, Identity, LeaderKey, RejectionCode, Role, SessionKey};
pub use lod_rule::{LodRule, LodRuleError};
pub use object_set::{ObjectSet, ObjectSetError};
pub use occlusion_test::OcclusionTestKind;
pub use outline::SceneOutline;
pub use role_message::RoleMessage;
pub use section::{Section, SectionBox, SectionError, SectionPlane, Sections};
pub use settings::Settings;
pub use settings_error::SettingsError;
pub use stats::{CullCounts, DeviceTimes, FrameStats, RoundCounts, SentBytes};
pub use supply::{BulkError, Demand, NumberList, Supply, items, put_item};
pub use trimaran_wire::{BatchSize, BatchSizeError, FrameNumber};
pub use view_state::{Appearance, ViewReader, ViewState, ViewStateError};
pub use viewport::Viewport;
pub use walkthrough::Walkthrough;
