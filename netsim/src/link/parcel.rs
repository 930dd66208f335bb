//! What goes into a link, and what a link asks for.

use trimaran_net::Instant;

use crate::topology::HostId;

/// A packet as a link sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parcel<P> {
    /// The machine that sends it.
    pub from: HostId,
    /// The machine that is to get it.
    pub to: HostId,
    /// The size of the IP packet, its header included.
    pub ip_bytes: u32,
    /// Its ECN field.
    pub ecn: Ecn,
    /// Whoever wants to know when the packet has left ([`Action::Left`]).
    pub token: Option<u32>,
    /// What is in it.
    pub packet: P,
}

/// What an IP packet says of congestion (RFC 3168, section 5).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Ecn {
    /// Its transport does not listen to marks.
    #[default]
    NotCapable,
    /// ECT(0).
    Capable0,
    /// ECT(1).
    Capable1,
    /// It was marked.
    Experienced,
}

impl Ecn {
    pub(super) const fn is_markable(self) -> bool {
        matches!(self, Self::Capable0 | Self::Capable1)
    }
}

/// What is to be done for a link.
#[derive(Debug, PartialEq, Eq)]
pub enum Action<P> {
    /// At this time call [`Pipe::free`](super::Pipe::free).
    Wake(Instant),
    /// At this time the packet comes out: call [`Pipe::arrived`](super::Pipe::arrived).
    Arrive(Instant, Parcel<P>),
    /// At this time the sender is rid of the packet: it is on its way, or was dropped before.
    Left {
        /// When.
        at: Instant,
        /// The packet's token.
        token: u32,
        /// The size of the packet as in [`Parcel::ip_bytes`].
        ip_bytes: u32,
    },
}
