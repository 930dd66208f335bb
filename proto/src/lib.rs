//! The wire of Trimaran: what the three roles say to each other, byte for byte.
//!
//! Sans-IO: nothing here touches a socket, a clock or a GPU. `WIRE.md` beside this crate specifies every
//! byte.
//!
//! Sending: a [`FrameWriter`] turns pushed ids into [`FrameMessage`]s, [`Message::encode`] into bytes.
//! Receiving: a [`Decoder`] turns bytes into messages, a [`FrameAssembler`] checks them and judges each
//! frame.

mod batch;
mod camera;
mod coding;
mod control;
mod decode;
mod frame;
mod header;
mod id;
mod message;
mod numbered;
mod settings;
mod stats;

pub use batch::{BatchSize, BatchSizeError, ID_BYTES, IdBatch, IdBatchError};
pub use camera::{Camera, CameraError};
pub use coding::{CodedIds, CodedViolation, CodingFault, Delivery, IdCoding, IdDecoder, IdEncoder};
pub use control::{
    Accept, Explanation, ExplanationError, Goodbye, Hello, Identity, Lane, ProtocolVersion, Refusal, Role,
    SessionId,
};
pub use decode::{DecodeError, DecodeFault, Decoder};
pub use frame::{
    FrameAssembler, FrameEnd, FrameEvent, FrameMessage, FrameOrderError, FrameOutcome, FrameStart,
    FrameViolation, FrameWriter,
};
pub use header::{HEADER_BYTES, Kind};
pub use id::{DrawableId, FrameNumber, SceneHash};
pub use message::Message;
pub use numbered::{CameraNumber, NumberedCamera};
pub use settings::{EpsilonPx, PictureSize, Settings, SettingsError, TesterKind};
pub use stats::{CullCounts, FrameStats, SentBytes};
