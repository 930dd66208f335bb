//! Links over datagrams of this crate's own protocol: frames put together each by itself, so that a loss
//! holds up one frame and not the connection.
//!
//! The protocol is the state machine of `trimaran-udp`; here are its sockets, tasks and timers, all of them
//! of the [`Net`]. One task a socket takes what arrives, one task a connection keeps its timers, and whoever
//! sends does so at once.

mod connect;
mod driver;
mod frames;
mod latest;
mod listen;
mod options;
mod port;
mod socket;

pub(crate) use connect::attempt;
pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use listen::listen;
pub use options::{Trust, UdpOptions};
pub use trimaran_udp::{Closed, Congestion, LaneViolation, MIN_DATAGRAM, Repair};

use std::fmt;
use std::sync::Arc;

use trimaran_proto::{Identity, SessionId};

use crate::Link;
use crate::frames::{FrameRx as AnyFrameRx, FrameTx as AnyFrameTx};
use crate::latest::{LatestRx as AnyLatestRx, LatestTx as AnyLatestTx};
use crate::link::{Capabilities, LinkConfig, Parts, PeerAddress, PeerInfo, Shared};
use crate::stats::Counters;
use port::{Carrier, Port};
use trimaran_net::Net;

/// Makes a link of a connection.
#[expect(clippy::too_many_arguments, reason = "a link has this many parts, each of its own type")]
fn link(
    net: &Arc<dyn Net>,
    port: &Arc<Port>,
    options: &crate::Options,
    (ours, theirs): (&Identity, Identity),
    session: SessionId,
    counters: Arc<Counters>,
    reliable: bool,
    place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
) -> Link {
    let config: &LinkConfig = &options.link;
    let carrier = Carrier::new(port);
    counters.watch(port.watch());
    Parts {
        latest: (AnyLatestTx::Udp(LatestTx::new(&carrier)), AnyLatestRx::Udp(LatestRx::new(&carrier))),
        frames: (AnyFrameTx::Udp(FrameTx::new(&carrier)), AnyFrameRx::Udp(FrameRx::new(&carrier))),
        peer: PeerInfo { identity: theirs, session, address: PeerAddress::Udp(port.remote()) },
        capabilities: Capabilities {
            reliable,
            ordered: true,
            encrypted: options.udp.is_encrypted(),
            local: false,
        },
        batching: config.batching_between(ours, &theirs),
        shared: Shared { peer: theirs.role, counters, _place: place },
    }
    .into_link(net, config)
}
