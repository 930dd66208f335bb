//! The sizes of an application's values.

use crate::{BatchSize, Channel, ChannelSizes, CountCoded};

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
    pub count_coded: CountCoded,
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
    /// The sizes of a channel, as for a link whose lanes have its types.
    #[must_use]
    pub fn of_channel(channel: &Channel) -> Self {
        match channel.sizes() {
            ChannelSizes::Latest { value } => Self { latest: value.into(), ..Self::default() },
            ChannelSizes::Frames { header, item } => {
                let default = Self::default();
                let count_coded = channel.count_coded().unwrap_or(default.count_coded);
                Self { header: header.into(), item: item.into(), count_coded, ..default }
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
