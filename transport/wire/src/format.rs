//! The sizes of an application's values.

use crate::channel::are_sound;
use crate::{BatchSize, Channel, ChannelSizes, Fixed, Item, MAX_FIXED, Protocol, ProtocolName};

/// The sizes of an application's values, for the layers that only handle bytes.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Bytes of a value of the latest lane.
    pub latest: usize,
    /// Bytes of a frame's header, beside its number.
    pub header: usize,
    /// Bytes of one item of a frame.
    pub item: usize,
    /// Reads the number of items that a coded batch claims.
    pub count_coded: fn(&[u8]) -> Option<usize>,
    /// The channels beside the lanes.
    pub channels: &'static [Channel],
}

impl Default for Format {
    /// The sizes of a protocol with empty values.
    fn default() -> Self {
        Self { latest: 0, header: 0, item: 1, count_coded: |_| None, channels: &[] }
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

    /// The sizes of a channel, as for a link whose lanes have its types.
    #[must_use]
    pub fn of_channel(channel: &Channel) -> Self {
        match channel.sizes() {
            ChannelSizes::Latest { value } => Self { latest: value.into(), ..Self::default() },
            ChannelSizes::Frames { header, item } => {
                Self { header: header.into(), item: item.into(), ..Self::default() }
            }
        }
    }

    /// Bytes of a full batch of `size` items.
    #[must_use]
    pub const fn batch(&self, size: BatchSize) -> usize {
        size.items() * self.item
    }

    /// Bytes of the message that begins a frame, without the message header.
    #[must_use]
    pub const fn begin(&self) -> usize {
        4 + self.header
    }
}
