//! What Trimaran's roles say to each other: cameras, ids of what is visible, and who they are.
//!
//! [`Walkthrough`] puts it together as the protocol of an application: how the bytes get from one role to the
//! other is the business of links, which know nothing of it. Sans-IO: nothing here touches a socket, a clock
//! or a GPU. `WIRE.md` beside this crate specifies every byte.

mod camera;
mod coding;
mod id;
mod identity;
mod settings;
mod stats;
mod walkthrough;

pub use camera::{Camera, CameraError};
pub use coding::{CodedViolation, CodingFault, IdCoding, IdDecoder, IdEncoder};
pub use id::{DrawableId, ID_BYTES, IdBatch, SceneHash};
pub use identity::{CloseCode, Identity, RejectionCode, Role};
pub use settings::{EpsilonPx, PictureSize, Settings, SettingsError, TesterKind};
pub use stats::{CullCounts, FrameStats, SentBytes};
pub use trimaran_wire::{BatchSize, BatchSizeError, FrameNumber};
pub use walkthrough::Walkthrough;
