//! Links over TCP: per pair of peers a connection for each lane, as in the paper (section 5).

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use crate::HostPort;
use crate::connect::{AttemptError, Introduction, each_address};
use crate::desk::Desk;
use crate::link::{Capabilities, Parts};
use crate::stream::{introduce, serve};
use trimaran_net::Net;

pub(crate) const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: false, local: false };

/// Tries once.
pub(crate) async fn attempt(
    net: &Arc<dyn Net>,
    at: &HostPort,
    introduction: &Introduction<'_>,
) -> Result<Parts, AttemptError> {
    each_address(net, at, |to| async move {
        let open = || net.connect_tcp(to, introduction.options.tcp);
        introduce(net, &to, open, introduction, CAPABILITIES).await
    })
    .await
}

/// Listens, and receives peers until nobody accepts them any more. Says where.
pub(crate) fn listen(at: SocketAddr, desk: &Arc<Desk>) -> io::Result<SocketAddr> {
    let (socket, address) = desk.net.listen_tcp(at, desk.options.tcp)?;
    desk.net.spawn(Box::pin(serve(Arc::clone(desk), socket, CAPABILITIES)));
    Ok(address)
}
