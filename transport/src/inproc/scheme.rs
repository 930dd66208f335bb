//! Names within this process, and the links to them.

use std::any::Any;
use std::collections::HashMap;
use std::io;
use std::sync::{Arc, LazyLock, Weak};

use parking_lot::Mutex;
use trimaran_net::{BoxFuture, Net};
use trimaran_wire::{Lane, MAX_CHANNELS, Protocol, Refusal, SessionId};

use crate::acceptor::Acceptor;
use crate::application::{Application, Side};
use crate::handshake::HandshakeError;
use crate::lane_transport::{Introduction, LaneTransport, Listened};
use crate::lanes::{ByteChannel, local};
use crate::link::Link;
use crate::parts::{Lanes, LinkParts};
use crate::peer::{Peer, PeerAddress};
use crate::stats::Counters;
use crate::transport::{AttemptError, Capabilities, ListenFault};
use crate::{LinkConfig, Name};

const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: false, local: true };

/// The listeners in this process, by name.
static LISTENERS: LazyLock<Mutex<HashMap<Name, Weak<Acceptor>>>> = LazyLock::new(Mutex::default);

/// A listener's name; free again when this is dropped.
#[derive(Debug)]
struct Registered(Name);

impl Drop for Registered {
    fn drop(&mut self) {
        LISTENERS.lock().remove(&self.0);
    }
}

/// A name within this process.
#[derive(Debug)]
pub(crate) struct Inproc(pub(crate) Name);

impl LaneTransport for Inproc {
    fn scheme(&self) -> &'static str {
        "inproc"
    }

    fn channels(&self) -> usize {
        MAX_CHANNELS
    }

    fn connect<'a>(
        &'a self,
        _net: &'a Arc<dyn Net>,
        _address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>> {
        Box::pin(attempt(&self.0, introduction))
    }

    fn listen<'a>(
        &'a self,
        address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let registered = listen(&self.0, acceptor)?;
            Ok(Listened { address: address.to_owned(), guard: Some(Box::new(registered)) })
        })
    }
}

/// Takes `name` for the listener at `acceptor`.
fn listen(name: &Name, acceptor: &Arc<Acceptor>) -> io::Result<Registered> {
    let mut listeners = LISTENERS.lock();
    if listeners.contains_key(name) {
        return Err(io::ErrorKind::AddrInUse.into());
    }
    listeners.insert(name.clone(), Arc::downgrade(acceptor));
    Ok(Registered(name.clone()))
}

/// Makes a link with the listener `name`.
async fn attempt(name: &Name, introduction: &Introduction<'_>) -> Result<LinkParts, AttemptError> {
    let found = LISTENERS.lock().get(name).and_then(Weak::upgrade);
    let acceptor = found.ok_or_else(|| AttemptError::Nobody { name: name.clone() })?;
    let Introduction { application, session, .. } = *introduction;
    let failed = |cause| AttemptError::Handshake { address: name.to_string(), cause };
    let refused = |refusal| failed(HandshakeError::Refused(refusal));
    let (listener, connector) = (acceptor.application.protocol(), application.protocol());
    if acceptor.application.type_of() != application.type_of() || listener != connector {
        if listener == connector {
            acceptor.application.compare(&application.channels()).map_err(refused)?;
        }
        return Err(refused(Refusal::Protocol { listener, connector }));
    }
    let (ours, place) = acceptor.enter(&introduction.hello(Lane::Frames)).map_err(refused)?;
    let theirs = introduction.recognize(&acceptor.answer(&ours)).map_err(failed)?;
    let [here, there] = ends(application);
    acceptor.hand_out(assemble(ours, session, there).holding(place)).await;
    Ok(assemble(theirs, session, here))
}

/// Two links, each the other's peer: the first is `ours`, and has `theirs` at its other end.
///
/// # Errors
/// As a handshake: if the two do not fit.
pub fn pair<P: Protocol>(
    net: &Arc<dyn Net>,
    ours: P::Hello,
    theirs: P::Hello,
    config: &LinkConfig,
) -> Result<(Link<P>, Link<P>), HandshakeError> {
    let (here, there) = (Side::<P>::of(ours)?, Side::<P>::of(theirs)?);
    let guest = here.admit(there.hello()).map_err(HandshakeError::Refused)?;
    let host = there.recognize(here.hello())?;
    let ([near, far], format) = (ends(&*here), here.format());
    let near = assemble(guest, SessionId(0), near).into_link(net, config, &format);
    let far = assemble(host, SessionId(0), far).into_link(net, config, &format);
    near.zip(far).ok_or(HandshakeError::Closed)
}

/// One end of lanes within this process, and its counters.
type End = (Box<dyn Any + Send>, Vec<ByteChannel>, Arc<Counters>);

/// Both ends of new lanes.
fn ends(application: &dyn Application) -> [End; 2] {
    let [here, there] = [Counters::unframed(), Counters::unframed()];
    let [near, far] = application.local_lanes([&here, &there]);
    let channels = application.format().channels;
    let (mut near_channels, mut far_channels) = (Vec::new(), Vec::new());
    for channel in channels {
        let [near, far] = local::channel(channel, [&here, &there]);
        near_channels.push(near);
        far_channels.push(far);
    }
    [(near, near_channels, here), (far, far_channels, there)]
}

fn assemble(peer: Peer, session: SessionId, (lanes, channels, counters): End) -> LinkParts {
    let lanes = Lanes::Local(lanes);
    let parts = LinkParts::over(lanes, peer, session, PeerAddress::InProcess, CAPABILITIES, counters);
    parts.with_channels(channels)
}
