//! What an application says over its links.

use std::fmt;

use bytes::Bytes;
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::{Batch, BatchSize, Fixed, FrameEnd, FrameNumber, Item, Rejection};

/// What an application says over its links, in which types.
///
/// A link has a lane of each kind, each in both directions: the *latest* lane is a cell of size one, the
/// *frames* lane carries frames of items, the *messages* lane small messages in order. For what it does not
/// use an application takes `()`, and `u32` for the items.
///
/// ```
/// use std::convert::Infallible;
///
/// use trimaran_wire::{Fixed, Format, Protocol};
///
/// /// Where a robot looks, in degrees.
/// #[derive(Debug, Clone, PartialEq)]
/// struct Heading(f32);
///
/// impl Fixed for Heading {
///     const SIZE: usize = 4;
///     type Error = Infallible;
///
///     fn write(&self, out: &mut [u8]) {
///         out.copy_from_slice(&self.0.to_le_bytes());
///     }
///
///     fn read(bytes: &[u8]) -> Result<Self, Infallible> {
///         Ok(Self(bytes.first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes))))
///     }
/// }
///
/// /// A robot says where it looks, and sends frames of the map's cells that it found taken.
/// #[derive(Debug, Clone, PartialEq)]
/// struct Robot;
///
/// impl Protocol for Robot {
///     const NAME: &'static str = "robot/1";
///     type Hello = String;
///     type Latest = Heading;
///     type Header = ();
///     type Item = u32;
///     type Message = ();
///
///     fn name(hello: &String) -> String {
///         hello.clone()
///     }
/// }
///
/// assert_eq!((Format::of::<Robot>().latest, Format::of::<Robot>().begin()), (4, 4));
/// ```
pub trait Protocol: fmt::Debug + Clone + PartialEq + Send + Sync + 'static {
    /// The protocol's name with its version, as ALPN (RFC 7301) has it: `robot/1`, say. Peers of different
    /// names refuse each other. At most [`ProtocolName::MAX_BYTES`](crate::ProtocolName::MAX_BYTES).
    const NAME: &'static str;

    /// How a peer introduces itself. At most [`MAX_HELLO`](crate::MAX_HELLO) bytes as postcard writes it.
    type Hello: Serialize + DeserializeOwned + Clone + PartialEq + fmt::Debug + Send + Sync;

    /// What the latest lane holds.
    type Latest: Fixed + Clone + PartialEq + fmt::Debug;

    /// What a frame begins with, beside its number.
    type Header: Fixed + Clone + PartialEq + fmt::Debug;

    /// What a frame is made of.
    type Item: Item;

    /// What is said beside values and frames, in order and without loss. At most
    /// [`MAX_MESSAGE`](crate::MAX_MESSAGE) bytes as postcard writes it.
    type Message: Serialize + DeserializeOwned + Clone + PartialEq + fmt::Debug + Send + Sync;

    /// What the peer behind `hello` is called in messages and logs.
    fn name(hello: &Self::Hello) -> String;

    /// Whether the listener behind `ours` takes the peer behind `theirs`. It is asked of the listener.
    ///
    /// # Errors
    /// When the two do not go together, and why: the peer is told.
    fn admit(_ours: &Self::Hello, _theirs: &Self::Hello) -> Result<(), Rejection> {
        Ok(())
    }

    /// The role that a peer claims, where keys can be bound to a role.
    fn role(_hello: &Self::Hello) -> Option<String> {
        None
    }

    /// By what a listener knows a peer that comes again. It takes the place of its old link, which may not be
    /// known to be dead yet; whoever has that link lets it go. None: each link has a place of its own.
    fn place(_hello: &Self::Hello) -> Option<u64> {
        None
    }

    /// How items travel between these two, where their hellos decide it: for both directions.
    fn batching(_ours: &Self::Hello, _theirs: &Self::Hello) -> Option<Batching> {
        None
    }

    /// How batches sent may travel shorter than plain. None means always plain.
    fn encoder(_delivery: Delivery) -> Option<Box<dyn BatchEncoder<Self::Item>>> {
        None
    }

    /// The other end of [`Protocol::encoder`]. No frame may have more than `max_items`.
    fn decoder(_max_items: u32) -> Option<Box<dyn BatchDecoder<Self::Item>>> {
        None
    }

    /// How many items a coded batch stands for, as it says itself; none where it cannot be read.
    fn count_coded(_bytes: &[u8]) -> Option<usize> {
        None
    }
}

/// How items travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batching {
    /// How many items travel in a batch at most.
    pub size: BatchSize,
    /// Whether batches go through the application's [encoder](Protocol::encoder).
    pub coded: bool,
}

/// What the layers below promise of the frames that are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// They arrive in order, none before all of the one before it.
    Ordered,
    /// They may be lost or late. [`BatchEncoder::confirmed`] tells which have arrived.
    Lossy,
}

/// Writes batches shorter than plain, for instance as changes against what the receiver has already.
pub trait BatchEncoder<I: Item>: fmt::Debug + Send {
    /// A frame begins.
    fn begin(&mut self, frame: FrameNumber);

    /// The shorter form of the frame's next batch; none where it travels plain.
    fn encode(&mut self, batch: &Batch<I>) -> Option<Bytes>;

    /// The frame ends.
    fn end(&mut self, end: &FrameEnd);

    /// The receiver has all of `frame`. Told for [`Delivery::Lossy`] only.
    fn confirmed(&mut self, frame: FrameNumber);
}

/// Reads what a [`BatchEncoder`] wrote.
pub trait BatchDecoder<I: Item>: fmt::Debug + Send {
    /// A frame begins.
    fn begin(&mut self, frame: FrameNumber);

    /// A batch of the frame came plain.
    fn plain(&mut self, batch: &Batch<I>);

    /// The batch that came as `bytes`.
    ///
    /// # Errors
    /// When they are no such batch. The peer then counts as one that breaks the protocol.
    fn decode(&mut self, bytes: &[u8]) -> Result<Batch<I>, CodingError>;

    /// The frame ends.
    fn end(&mut self, end: &FrameEnd);
}

/// What is wrong with a coded batch: the application's own error.
#[derive(Debug, Error)]
#[error(transparent)]
pub struct CodingError(#[from] pub Box<dyn std::error::Error + Send + Sync>);
