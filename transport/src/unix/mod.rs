//! Links over Unix stream sockets, for peers on one machine: a connection for each lane, as over TCP.
//!
//! Each side asks the kernel for the owner of the other process, and admits its own user and those of
//! [`UnixOptions::allow_uids`].

mod options;

use std::io;
use std::path::Path;
use std::sync::Arc;

use thiserror::Error;

pub use options::UnixOptions;

use crate::transport::AttemptError;
use crate::transport::{ListenFault, Listening, Transport};
use trimaran_net::{BoxFuture, Net, Stream, StreamPeer};

/// Unix stream sockets.
#[derive(Debug, Clone)]
pub(crate) struct Unix(pub(crate) UnixOptions);

/// The process at the other end of a Unix socket belongs to a user who is not admitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "the other end is a process of user {theirs}, this one of user {ours}: run both as one user, or allow user {theirs} here"
)]
pub struct ForeignUser {
    /// This process's user id.
    pub ours: u32,
    /// The peer's user id.
    pub theirs: u32,
}

impl Transport for Unix {
    fn scheme(&self) -> &'static str {
        "unix"
    }

    fn is_local(&self) -> bool {
        true
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        _beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        Box::pin(async move {
            let failed = |cause| AttemptError::Connect { address: address.to_owned(), cause };
            net.connect_unix(Path::new(address)).await.map_err(failed)
        })
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            let socket = net.listen_unix(Path::new(address), &self.0.socket()).await?;
            Ok(Listening { socket, address: address.to_owned() })
        })
    }

    fn admit(&self, peer: StreamPeer) -> io::Result<()> {
        check(peer, &self.0).map_err(|e| io::Error::new(io::ErrorKind::PermissionDenied, e))
    }
}

/// Checks the owner of the process at the other end.
fn check(peer: StreamPeer, options: &UnixOptions) -> Result<(), ForeignUser> {
    match peer {
        StreamPeer::Unix(peer) => {
            let ours = own_user();
            let welcome = peer.uid == ours || options.allow_uids.contains(&peer.uid);
            if welcome { Ok(()) } else { Err(ForeignUser { ours, theirs: peer.uid }) }
        }
        StreamPeer::Tcp(_) => Ok(()),
    }
}

#[cfg(unix)]
fn own_user() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// No user: without Unix sockets nobody comes by one.
#[cfg(not(unix))]
const fn own_user() -> u32 {
    u32::MAX
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::Credentials;

    #[test]
    fn only_the_own_user_and_named_ones_are_let_in() {
        let ours = own_user();
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
