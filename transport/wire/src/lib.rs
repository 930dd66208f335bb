//! The wire format that links of all applications share, byte for byte.
//!
//! Sans-IO: nothing here touches a socket or a clock. An application describes itself by [`Protocol`]: the
//! types of its lanes, and its hello. `WIRE.md` beside this crate specifies every byte.
//!
//! Sending: a [`FrameWriter`] turns pushed items into [`FrameMessage`]s, [`Message::encode`] turns these into
//! bytes. Receiving: a [`Decoder`] turns bytes into messages, a [`FrameAssembler`] checks each frame.
//!
//! ```
//! use bytes::BytesMut;
//! use trimaran_wire::{BatchSize, FrameMessage, FrameNumber, FrameWriter, Message};
//!
//! let mut writer = FrameWriter::<u32>::new(BatchSize::new(2)?);
//! let mut out = BytesMut::new();
//! writer.begin(FrameNumber(0)).unwrap();
//! writer.push(&[7, 8, 9], |batch| Message::Frame(batch).encode(&mut out)).unwrap();
//! writer.finish(|message| Message::Frame(message).encode(&mut out)).unwrap();
//! // Two batches with a header each, of two items and of one, and the end.
//! assert_eq!(out.len(), (4 + 8) + (4 + 4) + (4 + 16));
//! # Ok::<(), trimaran_wire::BatchSizeError>(())
//! ```
//!
//! | module | contents |
//! |---|---|
//! | `protocol`, `format` | an application's protocol: the one trait it implements |
//! | `channel`, `channel_types` | further lanes, by name |
//! | `fixed`, `batch`, `plain` | values and items as bytes |
//! | `frame`, `event` | frames: written and checked, and as their receiver is told of them |
//! | `control`, `text` | hello, accept, refusal, close, and the texts in them |
//! | `kind`, `message`, `decode`, `fault` | messages with their headers, and decoding them from a stream |
//! | `serial` | numbers for lanes without an order of their own |

#![cfg_attr(docsrs, feature(doc_cfg))] // the documentation says which feature has an item

mod batch;
mod channel;
mod channel_types;
mod control;
mod decode;
mod event;
mod fault;
mod fixed;
mod format;
mod frame;
mod kind;
mod message;
mod numbers;
#[cfg(feature = "zerocopy")]
mod plain;
mod protocol;
mod serial;
mod text;
mod version;

pub use batch::{Batch, BatchError, BatchSize, BatchSizeError, Item};
pub use channel::{
    Channel, ChannelFormat, ChannelList, ChannelName, ChannelNumber, ChannelSizes, CountCoded, MAX_CHANNELS,
};
pub use channel_types::{FramesOf, LatestOf};
pub use control::{Accept, CloseReason, Hello, IdleTimeout, Lane, MAX_HELLO, Refusal, Rejection, SessionId};
pub use decode::{DecodeError, Decoder};
pub use event::{FrameEvent, FrameStart};
pub use fault::DecodeFault;
pub use fixed::{Fixed, FixedBytes, MAX_FIXED, to_bytes};
pub use format::Format;
pub use frame::{
    FrameAssembler, FrameEnd, FrameMessage, FrameNumber, FrameOrderError, FrameOutcome, FrameStep,
    FrameViolation, FrameWriter,
};
pub use kind::{HEADER_BYTES, Kind, MAX_BLOCK, MAX_MESSAGE};
pub use message::Message;
#[cfg(feature = "zerocopy")]
pub use plain::{Plain, PlainError};
pub use protocol::{BatchDecoder, BatchEncoder, Batching, CodingError, Delivery, Protocol};
pub use serial::{Numbered, Serial};
pub use text::{Explanation, ProtocolName, Text, TextError};
pub use version::{WireVersion, WireVersions};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
