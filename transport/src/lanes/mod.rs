//! The lanes of a link: their halves, which each transport brings, and these as the application uses them.

pub(crate) mod blobs;
pub(crate) mod bulk;
pub(crate) mod ends;
pub(crate) mod frames;
pub(crate) mod half;
pub(crate) mod latest;
pub(crate) mod local;
pub(crate) mod messages;
pub(crate) mod queue;
pub(crate) mod records;
pub(crate) mod shared;
mod trace;

use trimaran_wire::{Channel, ChannelSizes, FixedBytes, FrameMessage};

use half::Duplex;

/// All lanes of a link: values `V`, messages of frames `F`, messages `M`, and blocks `B`.
#[derive(Debug)]
pub struct Lanes<V, F, M, B> {
    /// Values that replace each other.
    pub latest: Duplex<V>,
    /// Frames.
    pub frames: Duplex<F>,
    /// Messages, in order and without loss.
    pub messages: Duplex<M>,
    /// Blocks, in order and without loss, behind all other lanes.
    pub bulk: Duplex<B>,
}

/// Both halves of a channel of bytes.
#[derive(Debug)]
pub enum ByteChannel {
    /// Values that replace each other.
    Latest(Duplex<FixedBytes>),
    /// Frames.
    Frames(Duplex<FrameMessage>),
}

impl ByteChannel {
    /// Whether it is of the declared kind.
    pub(crate) const fn fits(&self, channel: &Channel) -> bool {
        matches!(
            (self, channel.sizes()),
            (Self::Latest(_), ChannelSizes::Latest { .. }) | (Self::Frames(_), ChannelSizes::Frames { .. })
        )
    }
}
