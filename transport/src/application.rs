//! The application's part of a handshake, for the layers that only handle bytes.

use std::any::{Any, TypeId};
use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use serde::de::DeserializeOwned;
use trimaran_wire::{
    ChannelList, Format, Hello, IdleTimeout, Lane, MAX_HELLO, Protocol, ProtocolName, Refusal, Rejection,
    SessionId, WireVersion, WireVersions,
};

use crate::handshake::{HandshakeError, HelloTooLong};
use crate::lanes::local;
use crate::peer::{Peer, PeerName};
use crate::stats::Counters;

/// One side of a protocol.
pub(crate) trait Application: fmt::Debug + Send + Sync {
    /// The name of the protocol.
    fn protocol(&self) -> ProtocolName;

    /// The sizes of its types.
    fn format(&self) -> Format;

    /// This side's hello.
    fn hello(&self) -> &Bytes;

    /// Judges a hello, at the listener.
    fn admit(&self, theirs: &Bytes) -> Result<Peer, Refusal>;

    /// Judges an answer, at the connecting peer.
    fn recognize(&self, theirs: &Bytes) -> Result<Peer, HandshakeError>;

    /// Both ends of lanes within this process, which count their traffic there: boxed `LocalLanes` of this
    /// protocol.
    #[cfg_attr(not(feature = "inproc"), allow(dead_code, reason = "only inproc calls it"))]
    fn local_lanes(&self, counters: [&Arc<Counters>; 2]) -> [Box<dyn Any + Send>; 2];

    /// The protocol's type, to tell protocols apart.
    #[cfg_attr(not(feature = "inproc"), allow(dead_code, reason = "only inproc calls it"))]
    fn type_of(&self) -> TypeId;
}

impl dyn Application + '_ {
    /// The channels of the protocol.
    pub(crate) fn channels(&self) -> ChannelList {
        ChannelList::of(self.format().channels)
    }

    /// Whether the connecting peer has the same channels as this listener.
    pub(crate) fn compare(&self, theirs: &ChannelList) -> Result<(), Refusal> {
        match self.channels().difference(theirs) {
            None => Ok(()),
            Some((number, listener, connector)) => Err(Refusal::Channel { number, listener, connector }),
        }
    }

    /// The hello for one lane of one link.
    pub(crate) fn introduce(
        &self,
        versions: WireVersions,
        session: SessionId,
        lane: Lane,
        idle_timeout: IdleTimeout,
    ) -> Hello {
        let (protocol, channels, application) = (self.protocol(), self.channels(), self.hello().clone());
        Hello { versions, protocol, session, lane, idle_timeout, channels, application }
    }
}

/// A peer of the protocol `P`.
pub(crate) struct Side<P: Protocol> {
    ours: P::Hello,
    bytes: Bytes,
}

impl<P: Protocol> fmt::Debug for Side<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Side").field(&self.ours).finish()
    }
}

/// Decodes a value from exactly `bytes`.
pub(crate) fn whole<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, postcard::Error> {
    match postcard::take_from_bytes(bytes)? {
        (value, []) => Ok(value),
        _ => Err(postcard::Error::DeserializeBadEncoding),
    }
}

impl<P: Protocol> Side<P> {
    pub(crate) fn of(ours: P::Hello) -> Result<Arc<dyn Application>, HelloTooLong> {
        // Writing to memory fails only for types without a serde length: such a hello is empty, and refused
        // by the peer.
        let bytes = postcard::to_stdvec(&ours).unwrap_or_default();
        if bytes.len() > MAX_HELLO {
            return Err(HelloTooLong(bytes.len()));
        }
        Ok(Arc::new(Self { ours, bytes: bytes.into() }))
    }

    fn peer(&self, bytes: &Bytes, theirs: &P::Hello) -> Peer {
        Peer {
            hello: bytes.clone(),
            name: PeerName::new(&P::name(theirs)),
            // A handshake chooses one.
            version: WireVersion::CURRENT,
            role: P::role(theirs),
            place: P::place(theirs),
            batching: P::batching(&self.ours, theirs),
        }
    }
}

impl<P: Protocol> Application for Side<P> {
    fn protocol(&self) -> ProtocolName {
        P::protocol(&self.ours)
    }

    fn format(&self) -> Format {
        P::format(&self.ours)
    }

    fn hello(&self) -> &Bytes {
        &self.bytes
    }

    fn admit(&self, theirs: &Bytes) -> Result<Peer, Refusal> {
        let malformed =
            |_| Refusal::Rejected(Rejection::new(u16::MAX, "the application's hello is malformed"));
        let hello: P::Hello = whole(theirs).map_err(malformed)?;
        P::admit(&self.ours, &hello).map_err(Refusal::Rejected)?;
        Ok(self.peer(theirs, &hello))
    }

    fn recognize(&self, theirs: &Bytes) -> Result<Peer, HandshakeError> {
        let hello: P::Hello = whole(theirs).map_err(HandshakeError::Hello)?;
        Ok(self.peer(theirs, &hello))
    }

    fn local_lanes(&self, counters: [&Arc<Counters>; 2]) -> [Box<dyn Any + Send>; 2] {
        local::pair::<P>(&self.format(), counters).map(|lanes| Box::new(lanes) as _)
    }

    fn type_of(&self) -> TypeId {
        TypeId::of::<P>()
    }
}
