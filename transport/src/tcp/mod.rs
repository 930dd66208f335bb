//! Links over TCP: per pair of peers a connection for cameras and one for node ids, as in the paper (section 5).

mod options;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

pub use options::{Keepalive, TcpOptions};

use crate::connect::{AttemptError, Introduction};
use crate::desk::Desk;
use crate::link::Capabilities;
use crate::net::Net;
use crate::stream::{introduce, serve};
use crate::{HostPort, Link};

pub(crate) const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, max_frame: u32::MAX, encrypted: false, local: false };

/// Tries each address of the host once.
pub(crate) async fn attempt(
    net: &Arc<dyn Net>,
    at: &HostPort,
    introduction: &Introduction<'_>,
) -> Result<Link, AttemptError> {
    let mut last = AttemptError::NoAddress;
    for to in net.resolve(&at.to_string()).await.map_err(AttemptError::Resolve)? {
        let open = async || net.connect_tcp(to, introduction.options.tcp).await;
        match introduce(net, &to, open, introduction, CAPABILITIES).await {
            Err(e @ AttemptError::Connect { .. }) => last = e,
            done => return done,
        }
    }
    Err(last)
}

/// Listens, and receives peers until nobody accepts them any more. Says where.
pub(crate) fn listen(at: SocketAddr, desk: &Arc<Desk>) -> io::Result<SocketAddr> {
    let (socket, address) = desk.net.listen_tcp(at, desk.options.tcp)?;
    desk.net.spawn(Box::pin(serve(Arc::clone(desk), socket, CAPABILITIES)));
    Ok(address)
}
