//! Links over datagrams with an attacker on the path, or a dead peer: garbage, replays, half-open handshakes,
//! silence.

use std::time::Duration;

use bytes::{BufMut, BytesMut};
use tokio::net::UdpSocket;
use trimaran_transport::conformance::{PANEL, greeting, pose};
use trimaran_transport::udp::Trust;
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, HandshakeError, Lane, Limits, LinkConfig, Options, RecvError,
    Refusal, SessionId, WireVersion, WireVersions, until,
};
use trimaran_udp::{Config, Connecting, ConnectionId, Progress, Security, VERSION};
use trimaran_wire::{Message, to_bytes};

use crate::common::udp::{a_panel_gets_in, address, listener, shared, with};
use crate::common::{Link, Listener, connect, format, introduce, last_failure, net, soon};

/// The header of a packet: its form (1 is a first packet, 2 a retry), a version and a connection id.
fn header(form: u64, version: u64, id: [u8; 4]) -> Vec<u8> {
    [&(version << 2 | form).to_le_bytes()[..], &id].concat()
}

#[tokio::test]
async fn another_version_is_answered_with_ours_and_lets_nobody_in() {
    let options = shared(1);
    let (mut listener, endpoint) = listener(&options).await;
    let stranger = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let mut first = header(1, 0x107, *b"them");
    first.resize(1200, 0xff);
    stranger.send_to(&first, address(&endpoint)).await.unwrap();
    let mut answer = vec![0; 2000];
    let length = stranger.recv(&mut answer).await.unwrap();
    assert_eq!(answer[..12], header(2, VERSION, *b"them"));
    assert!(3 * length < 1200, "{length} bytes");
    a_panel_gets_in(&mut listener, &endpoint, &options).await;
}

/// A retry of another version is not authenticated, so it is only named as the cause if nobody else answers
/// in time.
#[tokio::test]
async fn a_claim_of_another_version_is_named_once_nobody_else_has_answered() {
    let net = net();
    let other = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let there = Endpoint::Udp(other.local_addr().unwrap().into());
    let answers = async {
        let mut first = vec![0; 2000];
        loop {
            let (_, from) = other.recv_from(&mut first).await.unwrap();
            let retry = [header(2, 7, first[8..12].try_into().unwrap()), vec![0; 64]].concat();
            other.send_to(&retry, from).await.unwrap();
        }
    };
    let link = LinkConfig::default().with_handshake_timeout(Duration::from_millis(300));
    let options = shared(1).with_link(link);
    let begun = net.now();
    let by = begun.after(Duration::from_secs(2));
    let error = tokio::select! {
        error = connect(&net, &there, greeting(PANEL), &options, by) => error.unwrap_err(),
        () = answers => panic!("it never ends"),
    };
    assert!(net.now().since(begun) >= Duration::from_secs(1), "it was given up early");
    let ConnectError::Deadline { attempts, last: AttemptError::Handshake { cause, .. }, .. } = &error else {
        panic!("{error:?}")
    };
    assert!(matches!(cause, HandshakeError::Datagram { theirs: 7, ours: VERSION }), "{cause:?}");
    assert!(*attempts > 1 && error.may_pass(), "{error:?}");
}

/// An attacker on the path answers each first packet before the listener can: with another version, and with
/// invalid cookies.
#[tokio::test]
async fn forged_answers_to_a_first_packet_end_nothing() {
    let options = shared(1);
    let (mut listener, at) = listener(&options).await;
    let (mut relay, through) = Relay::before(&at).await;
    let forge = async {
        let (mut a, mut b) = (vec![0; 2000], vec![0; 2000]);
        loop {
            tokio::select! {
                got = relay.outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    relay.peer = Some(from);
                    if a[0] & 3 == 1 {
                        let id = a[8..12].try_into().unwrap();
                        for (form, version, rest) in [(2, 7, 24), (2, VERSION, 24), (3, VERSION, 80), (3, 7, 80), (2, VERSION, 3)] {
                            let forged = [header(form, version, id), vec![rest; rest.into()]].concat();
                            relay.outside.send_to(&forged, from).await.unwrap();
                        }
                    }
                    relay.inside.send(&a[..length]).await.unwrap();
                }
                got = relay.inside.recv(&mut b) => {
                    relay.outside.send_to(&b[..got.unwrap()], relay.peer.unwrap()).await.unwrap();
                }
            }
        }
    };
    tokio::select! {
        _links = a_pose_goes_over(&mut listener, &through, &options) => {}
        () = forge => panic!("it never ends"),
    }
}

/// The datagrams may be of one version and their messages of another.
#[tokio::test]
async fn a_hello_of_another_version_is_refused_in_words_that_it_can_read() {
    let options = with(Trust::Plaintext);
    let (mut listener, endpoint) = listener(&options).await;
    let mut hello = BytesMut::new();
    introduce(&greeting(PANEL), SessionId(7), Lane::Frames).encode(&mut hello);
    // Behind the header and the four letters of every hello; the rest may have any meaning there.
    hello[8..12].copy_from_slice(&[9, 0, 9, 0]);
    hello[12..].fill(0xff);
    // All frames will be complete.
    hello.put_u8(0);
    let mut connecting = Connecting::new(&Security::Plaintext, ConnectionId(5), &hello).unwrap();
    let stranger = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let (mut first, mut answer) = (Vec::new(), vec![0; 2000]);
    let refusal = loop {
        connecting.initial(&mut first);
        stranger.send_to(&first, address(&endpoint)).await.unwrap();
        let length = stranger.recv(&mut answer).await.unwrap();
        connecting = match connecting.handle(net().now(), &answer[..length], Config::new(format())) {
            Progress::Retry(connecting) => connecting,
            Progress::Refused(refusal) => break refusal,
            other => panic!("{other:?}"),
        };
    };
    let connector = WireVersions::only(WireVersion(9));
    let expected = Refusal::Version { listener: WireVersions::SUPPORTED, connector };
    let mut said = BytesMut::new();
    Message::Refuse(expected.clone()).encode(&mut said);
    assert_eq!(refusal[..said.len()], said);
    let known = last_failure(&mut listener).await;
    assert!(matches!(&known, HandshakeError::Refused(known) if *known == expected), "{known:?}");
    a_panel_gets_in(&mut listener, &endpoint, &options).await;
}

/// A socket between a peer and a listener, which sees everything and may change it.
struct Relay {
    outside: UdpSocket,
    inside: UdpSocket,
    peer: Option<std::net::SocketAddr>,
}

impl Relay {
    async fn before(listener: &Endpoint) -> (Self, Endpoint) {
        let outside = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let inside = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        inside.connect(address(listener)).await.unwrap();
        let endpoint = Endpoint::Udp(outside.local_addr().unwrap().into());
        (Self { outside, inside, peer: None }, endpoint)
    }

    /// Passes on packets until `done`; returns those that came in.
    async fn pass(&mut self, mut done: impl FnMut(&[u8], bool) -> bool) -> Vec<Vec<u8>> {
        let (mut inwards, mut a, mut b) = (Vec::new(), vec![0; 2000], vec![0; 2000]);
        loop {
            let (bytes, into) = tokio::select! {
                got = self.outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    self.peer = Some(from);
                    self.inside.send(&a[..length]).await.unwrap();
                    inwards.push(a[..length].to_vec());
                    (&a[..length], true)
                }
                got = self.inside.recv(&mut b) => {
                    let length = got.unwrap();
                    self.outside.send_to(&b[..length], self.peer.unwrap()).await.unwrap();
                    (&b[..length], false)
                }
            };
            if done(bytes, into) {
                return inwards;
            }
        }
    }
}

/// A panel connects through `through`, and its first pose arrives.
async fn a_pose_goes_over(listener: &mut Listener, through: &Endpoint, options: &Options) -> (Link, Link) {
    let net = net();
    let (there, here) = tokio::join!(
        connect(&net, through, greeting(PANEL), options, soon(&net)),
        listener.accept(soon(&net)),
    );
    let (mut there, mut here) = (there.unwrap(), here.unwrap());
    there.latest_tx.publish(pose(1)).unwrap();
    assert_eq!(here.latest_rx.latest().await.unwrap(), pose(1));
    (there, here)
}

/// Every packet of a peer is repeated ten times, from its address.
#[tokio::test]
async fn replays_make_no_second_link_and_no_second_pose() {
    let (net, options) = (net(), shared(1));
    let (mut listener, at) = listener(&options).await;
    let (mut relay, through) = Relay::before(&at).await;
    let talk = a_pose_goes_over(&mut listener, &through, &options);
    let mut inwards = Vec::new();
    let (there, mut here) = tokio::select! {
        links = talk => links,
        _ = relay.pass(|bytes, into| { if into { inwards.push(bytes.to_vec()); } false }) => panic!("it never ends"),
    };
    assert!(inwards.len() >= 4, "two first packets, a keep-alive and a pose");
    for packet in inwards.iter().cycle().take(10 * inwards.len()) {
        relay.inside.send(packet).await.unwrap();
    }
    let again = here.latest_rx.latest_by(net.now().after(Duration::from_millis(100))).await;
    assert!(matches!(again, Err(RecvError::Deadline { .. })), "{again:?}");
    assert!(listener.accept(net.now().after(Duration::from_millis(100))).await.is_err());
    drop(there);
}

/// Packets have the same length, whether or not an observer on the path can read a pose in them.
#[tokio::test]
async fn what_travels_can_be_read_on_the_way_only_in_the_clear() {
    for (options, readable) in [(shared(1), false), (with(Trust::Plaintext), true)] {
        let (mut listener, at) = listener(&options).await;
        let (mut relay, through) = Relay::before(&at).await;
        let needle = to_bytes(&pose(1)).to_vec();
        let mut read = false;
        tokio::select! {
            _links = a_pose_goes_over(&mut listener, &through, &options) => {}
            _ = relay.pass(|bytes, _| { read |= bytes.windows(needle.len()).any(|it| it == needle); false }) => {}
        }
        assert_eq!(read, readable, "{:?}", options.udp.trust);
    }
}

/// An attacker that repeats an answered first packet without using its keys holds a place no longer than the
/// handshake timeout.
#[tokio::test]
async fn a_first_packet_that_somebody_repeats_is_no_link() {
    let net = net();
    // Only the handshake timeout ends it.
    let (idle_timeout, handshake_timeout) = (Duration::from_secs(3600), Duration::from_millis(300));
    let link =
        LinkConfig::default().with_idle_timeout(idle_timeout).with_handshake_timeout(handshake_timeout);
    let options = shared(1).with_link(link);
    let (mut listener, at) = listener(&options).await;
    let (mut relay, through) = Relay::before(&at).await;
    let (first, unanswered) = tokio::select! {
        _ = connect(&net, &through, greeting(PANEL), &options, soon(&net)) => panic!("through a relay that keeps the answer"),
        first = relay.keep_the_answer() => first,
    };
    for _ in 0..100 {
        relay.inside.send(&first).await.unwrap();
    }
    let (mut answers, mut closes, mut buffer) = (0, 0, vec![0; 2000]);
    while until(&*net, net.now().after(Duration::from_millis(50)), relay.inside.recv(&mut buffer))
        .await
        .is_some()
    {
        match buffer[0] & 3 {
            3 => answers += 1,
            0 => closes += 1,
            form => panic!("a packet of form {form} is neither an answer nor a close"),
        }
    }
    // On a busy machine the peer itself repeats its first packet, and the handshake ends before the copies do.
    assert!(answers <= 100 + unanswered, "{answers} answers to 100 copies and {unanswered} packets before");
    assert!(closes <= 1, "{closes} closes");
    let failure = last_failure(&mut listener).await;
    assert!(matches!(failure, HandshakeError::TimedOut), "{failure:?}");
    a_panel_gets_in(&mut listener, &at, &options).await;
}

/// Packets of an earlier link, repeated by an attacker, must not keep its peer out, however long a handshake
/// may take.
#[tokio::test]
async fn a_first_packet_that_somebody_repeats_takes_no_place() {
    let net = net();
    let link = LinkConfig::default().with_handshake_timeout(Duration::from_secs(3600));
    let options = shared(1).with_link(link);
    let (mut listener, at) = listener(&options).await;
    let (mut relay, through) = Relay::before(&at).await;
    let (first, _) = tokio::select! {
        _ = connect(&net, &through, greeting(PANEL), &options, soon(&net)) => panic!("through a relay that keeps the answer"),
        first = relay.keep_the_answer() => first,
    };
    relay.inside.send(&first).await.unwrap();
    a_panel_gets_in(&mut listener, &at, &options).await;
}

impl Relay {
    /// Passes on a handshake except for the listener's last packet; returns the packet that it answered, and
    /// how many of those passed on may still be answered.
    async fn keep_the_answer(&mut self) -> (Vec<u8>, usize) {
        let (mut a, mut b, mut last) = (vec![0; 2000], vec![0; 2000], Vec::new());
        let mut unanswered = 0;
        loop {
            tokio::select! {
                got = self.outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    self.peer = Some(from);
                    last = a[..length].to_vec();
                    self.inside.send(&last).await.unwrap();
                    unanswered += 1;
                }
                got = self.inside.recv(&mut b) => {
                    let length = got.unwrap();
                    unanswered -= 1;
                    if b[0] & 3 == 3 {
                        return (last, unanswered);
                    }
                    self.outside.send_to(&b[..length], self.peer.unwrap()).await.unwrap();
                }
            }
        }
    }
}

#[tokio::test]
async fn ten_thousand_half_open_handshakes_shut_nobody_out() {
    let net = net();
    let limits = Limits::default().with_handshakes(4);
    let options = shared(1).with_limits(limits);
    let (mut listener, at) = listener(&options).await;
    // The most genuine first packet that a stranger can see: without a cookie of its own.
    let lure = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let there = Endpoint::Udp(lure.local_addr().unwrap().into());
    let mut first = vec![0; 2000];
    let length = tokio::select! {
        _ = connect(&net, &there, greeting(PANEL), &options, soon(&net)) => panic!("a link to a lure"),
        got = lure.recv(&mut first) => got.unwrap(),
    };
    let (mut sent, mut received) = (0, 0);
    let mut reply = vec![0; 2000];
    for number in 0_u32..10_000 {
        first[8..12].copy_from_slice(&number.to_le_bytes());
        sent += lure.send_to(&first[..length], address(&at)).await.unwrap();
        while let Ok(length) = lure.try_recv(&mut reply) {
            received += length;
        }
    }
    assert!(received * 3 <= sent, "{received} bytes for {sent}");
    assert!(received > 0, "cookies were given");
    a_panel_gets_in(&mut listener, &at, &options).await;
}
