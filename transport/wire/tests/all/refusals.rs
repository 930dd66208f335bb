//! Each refusal, in the order of its number on the wire.

use trimaran_wire::{
    ChannelFormat, ChannelName, ChannelNumber, ChannelSizes, Explanation, Lane, ProtocolName, Refusal,
    Rejection, SessionId, WireVersions,
};

/// Refusals that are as long as they can be with these texts.
pub(crate) fn refusals(text: &str) -> [Refusal; 8] {
    let versions = WireVersions::SUPPORTED;
    let (session, lane) = (SessionId(u64::MAX), Lane::Frames);
    let (name, role) = (ProtocolName::new(text), Explanation::new(text));
    [
        Refusal::Version { listener: versions, connector: versions },
        Refusal::Protocol { listener: name.clone(), connector: name },
        Refusal::Rejected(Rejection::new(u16::MAX, text)),
        Refusal::Session { session, lane },
        Refusal::Unpaired { session },
        Refusal::Busy,
        Refusal::Key { claimed: role.clone(), known: role },
        Refusal::Channel {
            number: ChannelNumber(u8::MAX),
            listener: Some(longest_channel()),
            connector: Some(longest_channel()),
        },
    ]
}

/// A channel that takes as many bytes as one can.
pub(crate) fn longest_channel() -> ChannelFormat {
    let name = ChannelName::new(&"x".repeat(ChannelName::MAX_BYTES));
    ChannelFormat { name, sizes: ChannelSizes::Frames { header: u16::MAX, item: u16::MAX } }
}
