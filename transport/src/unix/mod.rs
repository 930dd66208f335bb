//! Links over Unix stream sockets, for peers on one machine: two connections a link, as over TCP.
//!
//! Each side asks the kernel whose process the other end is, and takes its own user's and those that
//! [`UnixOptions::allow_uids`] names.

mod options;

use std::io;
use std::path::Path;
use std::sync::Arc;

use thiserror::Error;

pub use options::UnixOptions;

use crate::SocketPath;
use crate::connect::{AttemptError, Introduction};
use crate::desk::Desk;
use crate::link::{Capabilities, Parts};
use crate::stream::{introduce, serve};
use trimaran_net::{Net, StreamPeer};

const CAPABILITIES: Capabilities = Capabilities { local: true, ..crate::tcp::CAPABILITIES };

/// The process at the other end of a Unix socket belongs to a user who is not let in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "the other end is a process of user {theirs}, this one of user {ours}: run both as one user, or allow user {theirs} here"
)]
pub struct ForeignUser {
    /// This process's user id.
    pub ours: u32,
    /// The peer's.
    pub theirs: u32,
}

/// Tries once.
pub(crate) async fn attempt(
    net: &Arc<dyn Net>,
    path: &SocketPath,
    introduction: &Introduction<'_>,
) -> Result<Parts, AttemptError> {
    let open = || net.connect_unix(path.as_path());
    introduce(net, path, open, introduction, CAPABILITIES).await
}

/// Listens, and receives peers until nobody accepts them any more.
pub(crate) async fn listen(path: &Path, desk: &Arc<Desk>) -> io::Result<()> {
    let socket = desk.net.listen_unix(path, &desk.options.unix.socket()).await?;
    desk.net.spawn(Box::pin(serve(Arc::clone(desk), socket, CAPABILITIES)));
    Ok(())
}

/// Checks whose process the other end is.
pub(crate) fn check(peer: StreamPeer, options: &UnixOptions) -> Result<(), ForeignUser> {
    match peer {
        #[cfg(unix)]
        StreamPeer::Unix(peer) => {
            let ours = rustix::process::geteuid().as_raw();
            let welcome = peer.uid == ours || options.allow_uids.contains(&peer.uid);
            if welcome { Ok(()) } else { Err(ForeignUser { ours, theirs: peer.uid }) }
        }
        #[cfg(not(unix))]
        StreamPeer::Unix(_) => Ok(()),
        StreamPeer::Tcp(_) => Ok(()),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::Credentials;

    #[test]
    fn only_the_own_user_and_named_ones_are_let_in() {
        let ours = rustix::process::geteuid().as_raw();
        let peer = |uid| StreamPeer::Unix(Credentials { uid, gid: 0, pid: None });
        let strict = UnixOptions::default();
        let theirs = ours + 1;
        assert_eq!(check(peer(ours), &strict), Ok(()));
        assert_eq!(check(peer(theirs), &strict), Err(ForeignUser { ours, theirs }));
        let open = UnixOptions { allow_uids: vec![theirs], ..strict };
        assert_eq!(check(peer(theirs), &open), Ok(()));
        let message = ForeignUser { ours: 7, theirs: 9 }.to_string();
        assert!(message.contains("user 9") && message.contains("user 7"), "{message}");
    }
}
