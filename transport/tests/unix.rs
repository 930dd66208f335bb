//! Links over Unix sockets: the conformance suite, and what becomes of the socket's file.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;

use common::conformance::Pairs;
use common::{identity, joined, net};
use tempfile::TempDir;
use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Link, LinkConfig, ListenError, Listener, Options, PeerAddress, SocketPath, UnixOptions,
};

struct Unix;

impl Pairs for Unix {
    const HEADER: u64 = 4;
    const HANDSHAKE: u64 = 2;

    async fn pair(&self, link: LinkConfig) -> (Link, Link) {
        let (_folder, endpoint) = socket();
        joined(&endpoint.to_string(), &Options { link, ..Options::default() }).await
    }
}

conformance!(Unix);

fn socket() -> (TempDir, Endpoint) {
    let folder = tempfile::tempdir().unwrap();
    let path = SocketPath::new(folder.path().join("display.sock")).unwrap();
    (folder, Endpoint::Unix(path))
}

fn file_of(endpoint: &Endpoint) -> &std::path::Path {
    let Endpoint::Unix(path) = endpoint else { panic!("{endpoint}") };
    path.as_path()
}

async fn bind(endpoint: &Endpoint, options: &Options) -> Result<Listener, ListenError> {
    Listener::bind(&net(), endpoint, identity(Role::SwitchA), options).await
}

#[tokio::test]
async fn each_end_knows_whose_process_the_other_is() {
    let (_folder, endpoint) = socket();
    let (a, display) = joined(&endpoint.to_string(), &Options::default()).await;
    for link in [&a, &display] {
        let PeerAddress::Unix(peer) = link.peer.address else { panic!("{:?}", link.peer) };
        assert_eq!(peer.pid, Some(std::process::id().cast_signed()));
        assert!(link.capabilities().local && !link.capabilities().encrypted);
    }
}

#[tokio::test]
async fn the_socket_is_for_its_user_alone_and_goes_with_its_listener() {
    let (folder, endpoint) = socket();
    for (mode, options) in [
        (0o600, Options::default()),
        (
            0o660,
            Options { unix: UnixOptions { mode: 0o660, ..UnixOptions::default() }, ..Options::default() },
        ),
    ] {
        let listener = bind(&endpoint, &options).await.unwrap();
        assert_eq!(fs::metadata(file_of(&endpoint)).unwrap().permissions().mode() & 0o777, mode);
        drop(listener);
        // The listening task ends by itself a moment after its listener.
        while fs::read_dir(folder.path()).unwrap().count() > 0 {
            tokio::task::yield_now().await;
        }
    }
}

#[tokio::test]
async fn the_file_of_a_dead_listener_is_replaced() {
    let (_folder, endpoint) = socket();
    drop(UnixListener::bind(file_of(&endpoint)).unwrap());
    assert!(fs::metadata(file_of(&endpoint)).unwrap().file_type().is_socket(), "std leaves the file");
    joined(&endpoint.to_string(), &Options::default()).await;
}

#[tokio::test]
async fn a_live_listener_and_a_file_that_is_none_are_left_alone() {
    let (_folder, endpoint) = socket();
    let alive = UnixListener::bind(file_of(&endpoint)).unwrap();
    let error = bind(&endpoint, &Options::default()).await.unwrap_err();
    assert!(matches!(error, ListenError::InUse { .. }), "{error:?}");
    drop(alive);
    fs::remove_file(file_of(&endpoint)).unwrap();
    fs::write(file_of(&endpoint), "precious").unwrap();
    let error = bind(&endpoint, &Options::default()).await.unwrap_err();
    assert!(matches!(error, ListenError::Io { .. }), "{error:?}");
    assert_eq!(fs::read_to_string(file_of(&endpoint)).unwrap(), "precious");
}
