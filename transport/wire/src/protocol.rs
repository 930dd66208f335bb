//! An application's protocol over its links.

use std::fmt;

use bytes::Bytes;
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::channel::are_sound;
use crate::{
    Batch, BatchSize, Channel, Fixed, Format, FrameEnd, FrameNumber, Item, MAX_FIXED, ProtocolName, Rejection,
};

/// An application's protocol over its links, with its types.
///
/// A link has a lane of each kind, each in both directions: the *latest* lane is a cell of size one, the
/// *frames* lane carries frames of items, the *messages* lane small messages in order. For unused lanes an
/// application takes `()`, and `u32` for the items.
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
/// }
///
/// assert_eq!(Robot::name(&"the crawler".to_owned()), "the crawler");
/// assert_eq!((Format::of::<Robot>().latest, Format::of::<Robot>().begin()), (4, 4));
/// ```
pub trait Protocol: fmt::Debug + Clone + PartialEq + Send + Sync + 'static {
    /// The protocol's name with its version, as in ALPN (RFC 7301), such as `robot/1`. Peers of different
    /// names refuse each other. At most [`ProtocolName::MAX_BYTES`](crate::ProtocolName::MAX_BYTES).
    const NAME: &'static str;

    /// Further latest lanes and frames lanes, each with a name and types of its own: at most
    /// [`MAX_CHANNELS`](crate::MAX_CHANNELS). Peers with different ones refuse each other.
    const CHANNELS: &'static [Channel] = &[];

    /// A peer's introduction. At most [`MAX_HELLO`](crate::MAX_HELLO) bytes, encoded by postcard.
    type Hello: Serialize + DeserializeOwned + Clone + PartialEq + fmt::Debug + Send + Sync;

    /// The value of the latest lane.
    type Latest: Fixed + Clone + PartialEq + fmt::Debug;

    /// The header of a frame, beside its number.
    type Header: Fixed + Clone + PartialEq + fmt::Debug;

    /// The item of a frame.
    type Item: Item;

    /// Messages beside values and frames, in order and without loss. At most
    /// [`MAX_MESSAGE`](crate::MAX_MESSAGE) bytes, encoded by postcard.
    type Message: Serialize + DeserializeOwned + Clone + PartialEq + fmt::Debug + Send + Sync;

    /// The name of the peer with `hello` in messages and logs: by default the hello as `Debug` writes it, a
    /// plain text without its quotes. Say another one where a hello holds a secret.
    fn name(hello: &Self::Hello) -> String {
        format!("{hello:?}").trim_matches('"').to_owned()
    }

    /// The name of the protocol that the side with `ours` speaks: [`Protocol::NAME`], unless it is known only
    /// at run time, as in a gateway or another language.
    fn protocol(_ours: &Self::Hello) -> ProtocolName {
        ProtocolName::new(Self::NAME)
    }

    /// The sizes of its values: those of its types, unless they are known only at run time. Then one item on
    /// the wire is as many [`Protocol::Item`]s as its size takes.
    fn format(_ours: &Self::Hello) -> Format {
        Format::of::<Self>()
    }

    /// Whether the listener with `ours` admits the peer with `theirs`. It is called at the listener.
    ///
    /// # Errors
    /// If the two do not fit, with the reason that the peer is told.
    fn admit(_ours: &Self::Hello, _theirs: &Self::Hello) -> Result<(), Rejection> {
        Ok(())
    }

    /// The role that a peer claims, where keys can be bound to a role.
    fn role(_hello: &Self::Hello) -> Option<String> {
        None
    }

    /// The identity by which a listener recognizes a peer that connects again. The new link takes the place
    /// of the old one, which may not be known to be dead yet. `None`: each link has a place of its own.
    fn place(_hello: &Self::Hello) -> Option<u64> {
        None
    }

    /// How items travel between these two in both directions, if their hellos decide it.
    fn batching(_ours: &Self::Hello, _theirs: &Self::Hello) -> Option<Batching> {
        None
    }

    /// A shorter encoding for sent batches. `None` means always plain.
    fn encoder(_delivery: Delivery) -> Option<Box<dyn BatchEncoder<Self::Item>>> {
        None
    }

    /// The other end of [`Protocol::encoder`]. No frame may have more than `max_items`.
    fn decoder(_max_items: u32) -> Option<Box<dyn BatchDecoder<Self::Item>>> {
        None
    }

    /// The number of items that a coded batch claims; `None` if it is invalid.
    fn count_coded(_bytes: &[u8]) -> Option<usize> {
        None
    }
}

impl Format {
    /// The sizes of `P`'s types. Sizes that their traits do not allow fail to compile.
    #[must_use]
    pub const fn of<P: Protocol>() -> Self {
        const {
            assert!(P::NAME.len() <= ProtocolName::MAX_BYTES, "the name of a protocol has at most 32 bytes");
            assert!(P::Latest::SIZE <= MAX_FIXED, "a value of the latest lane has at most 1024 bytes");
            assert!(P::Header::SIZE <= MAX_FIXED, "the header of a frame has at most 1024 bytes");
            assert!(are_sound(P::CHANNELS), "there are at most 16 channels, each with a name of its own");
            assert!(P::Item::SIZE > 0 && P::Item::SIZE <= 256, "an item has 1 to 256 bytes");
        }
        Self {
            latest: P::Latest::SIZE,
            header: P::Header::SIZE,
            item: P::Item::SIZE,
            count_coded: P::count_coded,
            channels: P::CHANNELS,
        }
    }
}

/// How items travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batching {
    /// The largest number of items in a batch.
    pub size: BatchSize,
    /// Whether batches go through the application's [encoder](Protocol::encoder).
    pub coded: bool,
}

/// The delivery guarantee for sent frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Frames arrive in order, each complete before the next one.
    Ordered,
    /// Frames may be lost or late. [`BatchEncoder::confirmed`] tells which have arrived.
    Lossy,
}

/// Writes batches shorter than plain, for instance as changes against earlier frames of the receiver. It names
/// these by how many numbers back they are: frames for many links have another number on each of them.
pub trait BatchEncoder<I: Item>: fmt::Debug + Send {
    /// A frame begins.
    fn begin(&mut self, frame: FrameNumber);

    /// The shorter form of the frame's next batch; `None` if it travels plain.
    fn encode(&mut self, batch: &Batch<I>) -> Option<Bytes>;

    /// The frame ends.
    fn end(&mut self, end: &FrameEnd);

    /// The receiver has all of `frame`. Called for [`Delivery::Lossy`] only.
    fn confirmed(&mut self, frame: FrameNumber);
}

/// Reads what a [`BatchEncoder`] wrote.
pub trait BatchDecoder<I: Item>: fmt::Debug + Send {
    /// A frame begins.
    fn begin(&mut self, frame: FrameNumber);

    /// A batch of the frame came plain.
    fn plain(&mut self, batch: &Batch<I>);

    /// Decodes the batch in `bytes`.
    ///
    /// # Errors
    /// If they are invalid. The peer then has broken the protocol.
    fn decode(&mut self, bytes: &[u8]) -> Result<Batch<I>, CodingError>;

    /// The frame ends.
    fn end(&mut self, end: &FrameEnd);
}

/// The application's own error about a coded batch.
#[derive(Debug, Error)]
#[error(transparent)]
pub struct CodingError(#[from] pub Box<dyn std::error::Error + Send + Sync>);
