//! Links over Unix sockets: the conformance suite, and the socket's file.

use std::fs;
use std::io;
use std::net::SocketAddr;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tempfile::TempDir;
use trimaran_net::{BoxFuture, Listen, Stream, StreamPeer, Timer, UdpSocket, UnixSocketOptions};
use trimaran_transport::conformance::{ARM, Overhead, PANEL, Pairs, greeting};
use trimaran_transport::{
    ConnectError, Credentials, Endpoint, ForeignUser, HandshakeError, Instant, LinkConfig, ListenError, Net,
    Options, PeerAddress, Protocol, SocketPath, TcpOptions, UdpSocketOptions, UnixOptions,
};

use crate::common::{Listener, connect, joined, last_failure, met, net, soon};

struct Unix;

impl Pairs for Unix {
    fn overhead(&self) -> Overhead {
        Overhead { header_bytes: 4, handshake: 4, coded: true }
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        let (_folder, endpoint) = socket();
        met(&endpoint.to_string(), &Options::default().with_link(link), hellos, within).await
    }
}

trimaran_transport::conformance!(Unix);

fn socket() -> (TempDir, Endpoint) {
    let folder = tempfile::tempdir().unwrap();
    let path = SocketPath::new(folder.path().join("panel.sock")).unwrap();
    (folder, Endpoint::Unix(path))
}

fn file_of(endpoint: &Endpoint) -> &Path {
    let Endpoint::Unix(path) = endpoint else { panic!("{endpoint}") };
    path.as_path()
}

async fn bind(endpoint: &Endpoint, options: &Options) -> Result<Listener, ListenError> {
    Listener::bind(&net(), endpoint, greeting(ARM), options).await
}

#[tokio::test]
async fn each_end_knows_whose_process_the_other_is() {
    let (_folder, endpoint) = socket();
    let (arm, panel) = joined(&endpoint.to_string(), &Options::default()).await;
    for link in [&arm, &panel] {
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
        (0o660, Options::default().with_unix(UnixOptions::default().with_mode(0o660))),
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
    assert!(matches!(error, ListenError::Given { .. }) && !error.may_pass(), "{error:?}");
    assert_eq!(fs::read_to_string(file_of(&endpoint)).unwrap(), "precious");
}

/// The real network on a machine where the other end of every Unix socket belongs to another user.
#[derive(Debug)]
struct Elsewhere {
    net: Arc<dyn Net>,
    user: u32,
}

struct Foreign {
    listener: Box<dyn Listen>,
    user: u32,
}

fn of_user(user: u32, stream: Stream) -> Stream {
    let StreamPeer::Unix(peer) = stream.peer else { panic!("{stream:?}") };
    Stream { peer: StreamPeer::Unix(Credentials { uid: user, ..peer }), ..stream }
}

impl Listen for Foreign {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async { Ok(of_user(self.user, self.listener.accept().await?)) })
    }
}

impl Net for Elsewhere {
    fn now(&self) -> Instant {
        self.net.now()
    }

    fn timer(&self) -> Box<dyn Timer> {
        self.net.timer()
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        self.net.spawn(task);
    }

    fn random(&self) -> io::Result<u64> {
        self.net.random()
    }

    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        self.net.resolve(address)
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        self.net.connect_tcp(to, options)
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        self.net.listen_tcp(at, options)
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        self.net.bind_udp(at, options)
    }

    fn connect_unix<'a>(&'a self, path: &'a Path) -> BoxFuture<'a, io::Result<Stream>> {
        Box::pin(async { Ok(of_user(self.user, self.net.connect_unix(path).await?)) })
    }

    fn listen_unix<'a>(
        &'a self,
        path: &'a Path,
        options: &'a UnixSocketOptions,
    ) -> BoxFuture<'a, io::Result<Box<dyn Listen>>> {
        Box::pin(async {
            let listener = self.net.listen_unix(path, options).await?;
            Ok(Box::new(Foreign { listener, user: self.user }) as Box<dyn Listen>)
        })
    }
}

#[tokio::test]
async fn another_users_process_gets_no_link_from_either_side_unless_its_user_is_named() {
    let (_folder, endpoint) = socket();
    let ours = rustix::process::geteuid().as_raw();
    let stranger = ForeignUser { ours, theirs: ours + 1 };
    let elsewhere: Arc<dyn Net> = Arc::new(Elsewhere { net: net(), user: stranger.theirs });
    let here = net();
    let options = Options::default();

    // The listener sees another user's process, and sends it nothing more.
    let mut listener = Listener::bind(&elsewhere, &endpoint, greeting(ARM), &options).await.unwrap();
    let known = tokio::select! {
        link = connect(&here, &endpoint, greeting(PANEL), &options, soon(&here)) => panic!("{link:?}"),
        known = last_failure(&mut listener) => known,
    };
    assert_eq!(foreigner(&known), Some(stranger), "{known:?}");
    drop(listener);

    // The connecting side sees another user's listener, which may be replaced.
    let (_folder, endpoint) = socket();
    let mut listener = bind(&endpoint, &options).await.unwrap();
    let cause = crate::common::obstacle(&elsewhere, &endpoint, greeting(PANEL), &options).await;
    assert_eq!(foreigner(&cause), Some(stranger), "{cause:?}");

    let unix = UnixOptions::default().with_allow_uids(vec![stranger.theirs]);
    let open = options.with_unix(unix);
    let (there, accepted) = tokio::join!(
        connect(&elsewhere, &endpoint, greeting(PANEL), &open, soon(&here)),
        listener.accept(soon(&here)),
    );
    let PeerAddress::Unix(peer) = there.unwrap().peer.address else { panic!("no Unix socket") };
    assert_eq!(peer.uid, stranger.theirs);
    assert!(accepted.is_ok());
}

/// The refused user, if that is the failure.
fn foreigner(error: &HandshakeError) -> Option<ForeignUser> {
    match error {
        HandshakeError::NotLetIn(cause) => cause.get_ref()?.downcast_ref().copied(),
        _ => None,
    }
}
