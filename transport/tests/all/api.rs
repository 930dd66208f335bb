//! The types that are `Send` or `Sync`. One that ceases to be fails to compile here.

use trimaran_transport::conformance::Robot;
use trimaran_transport::keys::{KeyFiles, Keys, KeysError, PublicKeys, Security, WrongRole};
use trimaran_transport::quic::{QuicOptions, UnknownPeer};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{
    AcceptError, AttemptError, Batch, Capabilities, CloseReason, ConnectError, Endpoint, EndpointError,
    Endpoints, FrameEvent, FrameOutcome, FrameReceiver, FrameSender, FrameStart, HandshakeError,
    LatestReceiver, LatestSender, Link, LinkConfig, LinkStats, ListenError, Listener, Net, Options, PeerInfo,
    PeerName, ProtocolError, RecvError, Refusal, Rejection, SendError, StatsHandle, TokioNet,
};

const fn sent<T: Send + 'static>() {}

const fn shared<T: Send + Sync + 'static>() {}

const fn error<T: std::error::Error + Send + Sync + 'static>() {}

macro_rules! all {
    ($which:ident: $($type:ty),+ $(,)?) => { const _: () = { $($which::<$type>();)+ }; };
}

all!(sent:
    Link<Robot>, LatestSender<Robot>, LatestReceiver<Robot>, FrameSender<Robot>, FrameReceiver<Robot>,
);

all!(shared:
    Listener<Robot>, FrameEvent<Robot>, PeerInfo<Robot>,
    Batch<u32>, FrameStart<()>, FrameOutcome, StatsHandle, LinkStats, LinkConfig, Options, Capabilities,
    QuicOptions, UdpOptions, Trust, Endpoint, Endpoints, PeerName, CloseReason, Keys, KeyFiles, PublicKeys,
    Security, TokioNet, Box<dyn Net>,
);

all!(error:
    AcceptError, AttemptError, ConnectError, EndpointError, HandshakeError, KeysError, ListenError,
    ProtocolError, RecvError, Refusal, Rejection, SendError, UnknownPeer, WrongRole,
);
