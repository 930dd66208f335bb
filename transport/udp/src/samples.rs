//! The sizes and values of tests.

use bytes::BytesMut;
use trimaran_wire::{Channel, FixedBytes, Format, Message};

/// A coded batch begins with its number of items.
pub(crate) const FORMAT: Format = Format {
    latest: 72,
    header: 72,
    item: 4,
    count_coded: |bytes| bytes.first().map(|count| usize::from(*count)),
    channels: &[],
};
/// The same with a channel of values and one of frames.
pub(crate) const FORMAT_WITH_CHANNELS: Format =
    Format { channels: &[Channel::latest::<()>("alive"), Channel::frames::<(), u32>("front")], ..FORMAT };
/// Sizes of which none divides another.
pub(crate) const FORMAT_OF_12: Format = Format { latest: 5, header: 8, item: 12, ..FORMAT };

/// A value or a header that begins with `first`.
pub(crate) fn value(first: u32) -> FixedBytes {
    first.to_le_bytes().into_iter().chain(4..72).collect()
}

/// The bytes of a message.
pub(crate) fn encoded(message: &Message) -> BytesMut {
    let mut bytes = BytesMut::new();
    message.encode(&mut bytes);
    bytes
}
