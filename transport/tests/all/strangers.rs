//! Strangers over every transport between processes: they are refused, and what they cost others is limited.

use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::net::{TcpStream, UdpSocket, UnixStream};
use trimaran_transport::conformance::{Greeting, MAP, PANEL, greeting, pose};
use trimaran_transport::{ConnectError, Endpoint, HandshakeError, Instant, LinkConfig, Options};

use crate::common::meeting::Meeting;
use crate::common::{connect, last_failure, net, other_map, refusal, soon};

over_every_transport!(
    another_map_is_refused_and_both_sides_know_both_maps,
    garbage_from_a_stranger_disturbs_nobody,
);

/// A panel connects, is admitted, and both ends talk.
async fn a_panel_gets_in(meeting: &mut Meeting) {
    let net = net();
    let (there, here) = tokio::join!(
        connect(&net, &meeting.at, greeting(PANEL), &meeting.panel, soon(&net)),
        meeting.listener.accept(soon(&net)),
    );
    let (mut there, mut here) = (there.unwrap(), here.unwrap());
    there.latest_tx.publish(pose(1)).unwrap();
    assert_eq!(here.latest_rx.latest().await.unwrap(), pose(1));
    here.latest_tx.publish(pose(2)).unwrap();
    assert_eq!(there.latest_rx.latest().await.unwrap(), pose(2));
}

async fn another_map_is_refused_and_both_sides_know_both_maps(endpoint: &str) {
    let mut meeting = Meeting::at(endpoint, &Options::default()).await;
    let net = net();
    let other = Greeting { map: 0xdead, ..greeting(PANEL) };
    let expected = other_map(MAP, 0xdead);
    assert_eq!(refusal(&net, &meeting.at, other, &meeting.panel).await, expected);
    let known = last_failure(&mut meeting.listener).await;
    assert!(matches!(&known, HandshakeError::Refused(refusal) if *refusal == expected), "{known:?}");
    a_panel_gets_in(&mut meeting).await;
}

/// Deterministic garbage.
fn garbage(i: u32) -> Vec<u8> {
    let seed = i.wrapping_mul(2_654_435_761);
    (0..1 + seed % 1400).map(|j| (seed.wrapping_mul(j | 1) >> 13) as u8).collect()
}

/// Sends `bytes` to `endpoint`, and leaves.
async fn say(endpoint: &Endpoint, bytes: &[u8]) {
    // A refused stranger may be unable to send more.
    let _said = match endpoint {
        Endpoint::Tcp(at) => TcpStream::connect(at.to_string()).await.unwrap().write_all(bytes).await,
        Endpoint::Ws(at) => TcpStream::connect(at.at.to_string()).await.unwrap().write_all(bytes).await,
        Endpoint::Unix(path) => UnixStream::connect(path.as_path()).await.unwrap().write_all(bytes).await,
        Endpoint::Quic(at) => datagram(&at.to_string(), bytes).await,
        Endpoint::Udp(at) => datagram(&at.at.to_string(), bytes).await,
        other => panic!("{other}"),
    };
}

async fn datagram(to: &str, bytes: &[u8]) -> std::io::Result<()> {
    UdpSocket::bind("127.0.0.1:0").await?.send_to(bytes, to).await.map(|_| ())
}

async fn garbage_from_a_stranger_disturbs_nobody(endpoint: &str) {
    let mut meeting = Meeting::at(endpoint, &Options::default()).await;
    for i in 0..200 {
        say(&meeting.at, &garbage(i)).await;
    }
    a_panel_gets_in(&mut meeting).await;
}

/// Stands between a panel and the listener, where the handshake is made of datagrams: passes on so many, and
/// then none.
async fn cut(behind: usize, inside: &str, outside: &UdpSocket) {
    let there = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    there.connect(inside).await.unwrap();
    let (mut a, mut b, mut panel) = (vec![0; 2000], vec![0; 2000], None);
    for _ in 0..behind {
        tokio::select! {
            got = outside.recv_from(&mut a) => {
                let (length, from) = got.unwrap();
                panel = Some(from);
                there.send(&a[..length]).await.unwrap();
            }
            got = there.recv(&mut b) => {
                outside.send_to(&b[..got.unwrap()], panel.unwrap()).await.unwrap();
            }
        }
    }
    std::future::pending::<()>().await;
}

mod of_datagrams {
    use super::*;

    /// The panel sees the listener die, and the listener the panel.
    async fn either_side_may_die_behind_every_datagram_of_the_handshake(endpoint: &str) {
        // Only the handshake timeout frees the place of a peer that dies in it.
        let (idle_timeout, handshake_timeout) = (Duration::from_secs(3600), Duration::from_secs(1));
        let link =
            LinkConfig::default().with_idle_timeout(idle_timeout).with_handshake_timeout(handshake_timeout);
        let options = Options::default().with_link(link);
        let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &options).await;
        let net = net();
        let inside = match &at {
            Endpoint::Quic(at) => at.to_string(),
            Endpoint::Udp(at) => at.at.to_string(),
            other => panic!("{other}"),
        };
        // Peers are accepted and dropped at once. The listener's clock is that of its own network.
        let never = Instant::from_nanos(u64::MAX);
        net.spawn(Box::pin(async move { while listener.accept(never).await.is_ok() {} }));
        let mut cut_short = 0;
        for behind in 0..8 {
            let outside = UdpSocket::bind("127.0.0.1:0").await.unwrap();
            let through = format!("{}://{}", at.transport(), outside.local_addr().unwrap()).parse().unwrap();
            let by = net.now().after(Duration::from_millis(300));
            let link = tokio::select! {
                link = connect(&net, &through, greeting(PANEL), &panel, by) => link,
                () = cut(behind, &inside, &outside) => panic!("it never ends"),
            };
            match link {
                // Enough for the panel; the listener may or may not know.
                Ok(link) => drop(link),
                Err(ConnectError::Deadline { .. }) => cut_short += 1,
                Err(error) => panic!("{behind} datagrams: {error:?}"),
            }
            let link = connect(&net, &at, greeting(PANEL), &panel, soon(&net)).await;
            assert!(link.is_ok(), "{behind} datagrams: {link:?}");
        }
        assert!(cut_short >= 2, "{cut_short} handshakes were cut short");
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn udp() {
        either_side_may_die_behind_every_datagram_of_the_handshake("udp://127.0.0.1:0").await;
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn quic() {
        either_side_may_die_behind_every_datagram_of_the_handshake("quic://127.0.0.1:0").await;
    }
}
