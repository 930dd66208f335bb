//! Custom transports with lanes of their own, and how links are made over any transport.

use std::fmt;
use std::sync::Arc;

use trimaran_net::{BoxFuture, Instant, Net};
use trimaran_wire::{Accept, DecodeError, DecodeFault, Format, Hello, Lane, SessionId, WireVersions};

use crate::acceptor::Acceptor;
use crate::application::Application;
use crate::config::link::LinkConfig;
use crate::handshake::HandshakeError;
use crate::parts::LinkParts;
use crate::peer::Peer;
use crate::transport::{AttemptError, ListenFault};

/// A transport with lanes of its own, such as datagrams or shared memory. It brings an object for each half
/// of each lane ([`Tx`](crate::Tx), [`Rx`](crate::Rx)); give it to [`Options`](crate::Options).
///
/// A transport that carries bytes in order is simpler as a [`Transport`](crate::Transport).
pub trait LaneTransport: fmt::Debug + Send + Sync {
    /// The transport's name in endpoints: letters, digits, `+`, `-`, `.`.
    fn scheme(&self) -> &'static str;

    /// The most channels of a link ([`Protocol::CHANNELS`](crate::Protocol::CHANNELS)). Default none: a
    /// protocol with channels is refused on both sides before anything is sent.
    fn channels(&self) -> usize {
        0
    }

    /// Tries once to make a link with the listener at `address`, the part of the endpoint behind its scheme.
    ///
    /// Dropping the future ends the attempt.
    ///
    /// # Errors
    /// If there is none now. The link is tried again, unless this side's own settings are at fault.
    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>>;

    /// Listens at `address`, and receives peers until [`Acceptor::closed`] ends.
    ///
    /// # Errors
    /// If that is not possible.
    fn listen<'a>(
        &'a self,
        address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>>;
}

impl dyn LaneTransport + '_ {
    /// Whether it can have the channels of an application.
    pub(crate) fn check_channels(&self, application: &dyn Application) -> Result<(), HandshakeError> {
        let (needed, most) = (application.format().channels.len(), self.channels());
        if needed <= most {
            Ok(())
        } else {
            Err(HandshakeError::NoChannels { scheme: self.scheme(), needed, most })
        }
    }
}

/// Transports are equal if their schemes are.
impl PartialEq for dyn LaneTransport {
    fn eq(&self, other: &Self) -> bool {
        self.scheme() == other.scheme()
    }
}

/// This side's introduction in one attempt.
#[derive(Debug, Clone, Copy)]
pub struct Introduction<'o> {
    pub(crate) application: &'o dyn Application,
    /// The versions of the wire that this attempt offers.
    pub(crate) versions: WireVersions,
    /// The new link's session id.
    pub session: SessionId,
    /// The new link's options.
    pub link: &'o LinkConfig,
    /// When the attempt is cut short.
    pub by: Instant,
}

impl Introduction<'_> {
    /// The sizes of the application's types.
    #[must_use]
    pub fn format(&self) -> Format {
        self.application.format()
    }

    /// The hello to the listener; a transport with one connection for all lanes names [`Lane::Frames`].
    #[must_use]
    pub fn hello(&self, lane: Lane) -> Hello {
        self.application.introduce(self.versions, self.session, lane, self.link.idle_timeout.into())
    }

    /// The listener, from its answer.
    ///
    /// # Errors
    /// If its hello cannot be read, or it has chosen a version that was not offered.
    pub fn recognize(&self, answer: &Accept) -> Result<Peer, HandshakeError> {
        let (ours, version) = (self.versions, answer.version);
        if !ours.contains(version) {
            let fault = DecodeFault::Version { ours, theirs: WireVersions::only(version) };
            return Err(DecodeError { offset: 0, fault }.into());
        }
        Ok(Peer { version, ..self.application.recognize(&answer.application)? })
    }
}

/// A listener that is up.
pub struct Listened {
    /// Its address, with the chosen port.
    pub address: String,
    /// Dropped with the listener.
    pub guard: Option<Box<dyn Send + Sync>>,
}

impl fmt::Debug for Listened {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listened").field("address", &self.address).finish_non_exhaustive()
    }
}

impl From<String> for Listened {
    fn from(address: String) -> Self {
        Self { address, guard: None }
    }
}
