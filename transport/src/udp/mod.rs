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
mod messages;
mod options;
mod port;
mod socket;
mod units;

pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use messages::{MessageRx, MessageTx};
#[cfg(feature = "config")]
pub(crate) use options::MAX_DATAGRAM;
pub use options::{Trust, UdpOptions};
pub use trimaran_udp::{Closed, Congestion, LaneViolation, MIN_DATAGRAM, Repair};

use std::fmt;
use std::sync::Arc;

use trimaran_wire::{Format, SessionId};

use crate::acceptor::Acceptor;
use crate::application::Peer;
use crate::connect::{AttemptError, Introduction};
use crate::frames::{WireFrameRx, WireFrameTx};
use crate::latest::{WireLatestRx, WireLatestTx};
use crate::link::{Capabilities, Lanes, Parts, PeerAddress, Shared, Wire};
use crate::messages::{WireMessageRx, WireMessageTx};
use crate::scheme::{Listened, Scheme, first_address};
use crate::stats::Counters;
use crate::transport::ListenFault;
use crate::{Endpoint, UdpEndpoint};
use port::{Carrier, Port};
use trimaran_net::{BoxFuture, Net};

/// A socket for datagrams.
pub(crate) struct Udp(pub(crate) UdpEndpoint);

impl Scheme for Udp {
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>> {
        Box::pin(connect::attempt(net, &self.0, introduction))
    }

    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let UdpEndpoint { at, mode } = &self.0;
            let to = first_address(&acceptor.net, &at.to_string()).await?;
            let at = listen::listen(to, *mode, acceptor)?.into();
            Ok(Endpoint::Udp(UdpEndpoint { at, mode: *mode }).into())
        })
    }
}

/// What a link is made of, from a connection.
fn parts(
    port: &Arc<Port>,
    options: &UdpOptions,
    format: Format,
    peer: Peer,
    (session, reliable): (SessionId, bool),
    counters: Arc<Counters>,
    place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
) -> Parts {
    let carrier = Carrier::new(port);
    counters.watch(port.watch());
    let lanes = Lanes::Wire(Box::new(Wire {
        latest: (WireLatestTx::Udp(LatestTx::new(&carrier)), WireLatestRx::Udp(LatestRx::new(&carrier))),
        frames: (WireFrameTx::Udp(FrameTx::new(&carrier)), WireFrameRx::Udp(FrameRx::new(&carrier))),
        messages: (
            WireMessageTx::Udp(MessageTx::new(&carrier)),
            WireMessageRx::Udp(MessageRx::new(&carrier)),
        ),
    }));
    Parts {
        lanes,
        session,
        address: PeerAddress::Udp(port.remote()),
        capabilities: Capabilities {
            reliable,
            ordered: true,
            encrypted: options.is_encrypted(),
            local: false,
        },
        shared: Shared { peer: peer.name.clone(), format, counters, _place: place },
        peer,
        doubt: None,
    }
}
