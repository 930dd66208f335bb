//! Packets as a link sees them, and actions that a link asks for.

use trimaran_net::Instant;

use crate::host::HostId;

/// A packet as a link sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parcel<P> {
    /// The sending host.
    pub from: HostId,
    /// The receiving host.
    pub to: HostId,
    /// The size of the IP packet, its header included.
    pub ip_bytes: u32,
    /// Its ECN field.
    pub ecn: Ecn,
    /// The token that is told when the packet has left ([`Action::Left`]).
    pub token: Option<u32>,
    /// The contents.
    pub packet: P,
}

/// The congestion field of an IP packet (RFC 3168, section 5).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Ecn {
    /// The transport does not support marks.
    #[default]
    NotCapable,
    /// ECT(0).
    Capable0,
    /// ECT(1).
    Capable1,
    /// Congestion experienced: the packet was marked.
    Experienced,
}

impl Ecn {
    /// Whether a queue may mark the packet rather than drop it. One that is marked already stays so.
    pub(super) const fn is_markable(self) -> bool {
        !matches!(self, Self::NotCapable)
    }
}

/// A cause that drops packets at the end of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outage {
    /// Its hosts are partitioned.
    Partition,
    /// Its receiver is down.
    Down,
}

/// An action to carry out for a link.
#[derive(Debug, PartialEq, Eq)]
pub enum Action<P> {
    /// At this time call [`Pipe::free`](super::Pipe::free).
    Wake(Instant),
    /// At this time the packet comes out: call [`Pipe::arrived`](super::Pipe::arrived).
    Arrive(Instant, Parcel<P>),
    /// At this time the packet has left the sender: it is in flight, or was dropped before.
    Left {
        /// The time.
        at: Instant,
        /// The packet's token.
        token: u32,
        /// The size of the packet as in [`Parcel::ip_bytes`].
        ip_bytes: u32,
    },
}

#[cfg(test)]
mod tests {
    use super::Ecn::{Capable0, Capable1, Experienced, NotCapable};

    #[test]
    fn all_packets_but_those_of_transports_without_marks_can_be_marked() {
        let markable = [NotCapable, Capable0, Capable1, Experienced].map(super::Ecn::is_markable);
        assert_eq!(markable, [false, true, true, true]);
    }
}
