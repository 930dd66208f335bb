//! A router between a peer and a listener.

use std::cell::Cell;
use std::net::SocketAddr;

use tokio::net::UdpSocket;
use tokio::sync::Notify;
use trimaran_transport::Endpoint;

/// Forwards datagrams between a peer and a listener, like a router with address translation.
pub(crate) struct Router {
    /// Its endpoint for the peer.
    pub(crate) at: Endpoint,
    outside: UdpSocket,
    listener: SocketAddr,
    /// Tells the router to take another address towards the listener, as after a restart.
    pub(crate) restart: Notify,
    /// Tells it to take another one towards the peer.
    pub(crate) turn: Notify,
}

impl Router {
    pub(crate) async fn before(listener: &Endpoint) -> Self {
        let outside = free().await;
        let port = outside.local_addr().unwrap();
        let (listener, at) = match listener {
            Endpoint::Quic(at) => (at.to_string(), Endpoint::Quic(port.into())),
            Endpoint::Udp(there) => (there.at.to_string(), Endpoint::Udp(port.into())),
            other => panic!("{other}"),
        };
        let listener = listener.parse().unwrap();
        Self { at, outside, listener, restart: Notify::new(), turn: Notify::new() }
    }

    /// Forwards datagrams for which `keep` returns true, given each one's direction, and counts the others.
    /// Never ends.
    pub(crate) async fn pass(&self, lost: &Cell<u32>, mut keep: impl FnMut(&[u8], bool) -> bool) {
        let (mut inside, mut turned, mut peer) = (self.inside().await, None, None);
        let (mut a, mut b) = (vec![0; 2000], vec![0; 2000]);
        loop {
            let outside = turned.as_ref().unwrap_or(&self.outside);
            let kept = tokio::select! {
                () = self.restart.notified() => {
                    inside = self.inside().await;
                    true
                }
                () = self.turn.notified() => {
                    turned = Some(free().await);
                    true
                }
                got = outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    peer = Some(from);
                    keep(&a[..length], true) && inside.send(&a[..length]).await.is_ok()
                }
                got = inside.recv(&mut b) => {
                    let length = got.unwrap();
                    keep(&b[..length], false) && outside.send_to(&b[..length], peer.unwrap()).await.is_ok()
                }
            };
            lost.set(lost.get() + u32::from(!kept));
        }
    }

    /// Forwards datagrams for which `forge` has no answer. The others are answered with it in the listener's
    /// name, not forwarded, and counted. Never ends.
    pub(crate) async fn pass_and_forge(
        &self,
        forged: &Cell<u32>,
        mut forge: impl FnMut(&[u8]) -> Option<Vec<u8>>,
    ) {
        let (inside, mut peer) = (self.inside().await, None);
        let (mut a, mut b) = (vec![0; 2000], vec![0; 2000]);
        loop {
            tokio::select! {
                got = self.outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    peer = Some(from);
                    match forge(&a[..length]) {
                        Some(answer) => {
                            self.outside.send_to(&answer, from).await.unwrap();
                            forged.set(forged.get() + 1);
                        }
                        None => drop(inside.send(&a[..length]).await.unwrap()),
                    }
                }
                got = inside.recv(&mut b) => {
                    self.outside.send_to(&b[..got.unwrap()], peer.unwrap()).await.unwrap();
                }
            }
        }
    }

    async fn inside(&self) -> UdpSocket {
        let inside = free().await;
        inside.connect(self.listener).await.unwrap();
        inside
    }
}

async fn free() -> UdpSocket {
    UdpSocket::bind("127.0.0.1:0").await.unwrap()
}
