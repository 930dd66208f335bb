//! Strangers at an acceptor.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::time::Duration;

use proptest::prelude::*;
use trimaran_net::Instant;
use trimaran_udp::{
    Acceptor, Config, Connecting, Connection, ConnectionId, Handled, Initial, MAX_HELLO, Progress, Security,
    VERSION,
};
use trimaran_wire::{FixedBytes, Format};

const HERE: ConnectionId = ConnectionId(10);
const THERE: ConnectionId = ConnectionId(20);
/// A value of the latest lane.
const VALUE: &[u8] = b"something to be hidden";

fn config() -> Config {
    Config::new(Format { latest: VALUE.len(), header: 0, item: 4, ..Format::default() })
}

fn now() -> Instant {
    Instant::from_nanos(1_000_000_000)
}

fn address() -> SocketAddr {
    SocketAddr::from(([192, 0, 2, 1], 4000))
}

fn bytes(key: &[u8]) -> [u8; 32] {
    key.try_into().unwrap()
}

fn pinned(own: &snow::Keypair, peer: &snow::Keypair) -> Security {
    Security::Pinned { own: bytes(&own.private).into(), peers: vec![bytes(&peer.public)] }
}

fn keypair() -> snow::Keypair {
    snow::Builder::new("Noise_IK_25519_ChaChaPoly_BLAKE2s".parse().unwrap()).generate_keypair().unwrap()
}

/// Fetches a cookie and sends a first packet with it.
fn initial(acceptor: &Acceptor, connecting: Connecting) -> (Connecting, Option<Initial>, Vec<u8>) {
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    connecting.initial(&mut first);
    let reception = acceptor.handle(now(), address(), &first, &mut reply);
    assert!(matches!(reception, Handled::Reply), "{reception:?}");
    assert!(reply.len() <= first.len() / 3, "{} bytes for {}", reply.len(), first.len());
    let Progress::Retry(connecting) = connecting.handle(now(), &reply, config()) else { panic!("no retry") };
    connecting.initial(&mut first);
    match acceptor.handle(now(), address(), &first, &mut reply) {
        Handled::Initial(initial) => (connecting, Some(*initial), first),
        _ => (connecting, None, first),
    }
}

fn join(ours: &Security, theirs: Security) -> Option<(Connection, Connection)> {
    let acceptor = Acceptor::new(theirs, [3; 32], 7400).unwrap();
    let (connecting, initial, _) = initial(&acceptor, Connecting::new(ours, HERE, b"hello").unwrap());
    let initial = initial?;
    assert_eq!((initial.from, &initial.hello[..]), (HERE, &b"hello"[..]));
    let mut answer = Vec::new();
    let there = initial.take(now(), THERE, b"welcome", config(), &mut answer).unwrap();
    let mut connecting = connecting;
    if !matches!(ours, Security::Plaintext) {
        for at in [0, 9, 12, 44, answer.len() - 1] {
            let mut forged = answer.clone();
            forged[at] ^= 4;
            let Progress::None(same) = connecting.handle(now(), &forged, config()) else {
                panic!("byte {at} of the answer was changed")
            };
            connecting = same;
        }
    }
    match connecting.handle(now(), &answer, config()) {
        Progress::Taken(here, said) => {
            assert_eq!(said, b"welcome");
            Some((*here, there))
        }
        other => panic!("{other:?}"),
    }
}

fn talk((mut here, mut there): (Connection, Connection)) -> Vec<u8> {
    let value = FixedBytes::from_slice(VALUE);
    let mut packet = Vec::new();
    for (from, to) in [(&mut here, &mut there)] {
        from.publish(None, value.clone());
        assert!(from.poll_transmit(now(), &mut packet));
        for at in 0..packet.len() {
            let mut forged = packet.clone();
            forged[at] ^= 4;
            to.handle(now(), &forged);
            assert_eq!((to.latest(None), to.closed()), (None, None), "byte {at}");
        }
        to.handle(now(), &packet);
        assert_eq!(to.latest(None), Some(value.clone()));
        let (later, mut ack) = (now().after(Duration::from_millis(1)), Vec::new());
        assert!(to.poll_transmit(later, &mut ack), "an acknowledgement is owed");
        to.handle(later, &packet);
        assert_eq!(to.latest(None), None, "a replay");
        assert!(
            !to.poll_transmit(later.after(Duration::from_millis(1)), &mut ack),
            "a replay is not acknowledged"
        );
    }
    there.publish(None, value.clone());
    let mut back = Vec::new();
    assert!(there.poll_transmit(now(), &mut back));
    here.handle(now(), &back);
    assert_eq!(here.latest(None), Some(value));
    packet
}

#[test]
fn peers_with_the_same_key_talk_and_forgeries_and_replays_do_nothing() {
    let key = Security::PreShared([9; 32].into());
    let packet = talk(join(&key, key.clone()).unwrap());
    assert!(!packet.windows(VALUE.len()).any(|bytes| bytes == VALUE), "the value is hidden");
    let packet = talk(join(&Security::Plaintext, Security::Plaintext).unwrap());
    assert!(packet.windows(VALUE.len()).any(|bytes| bytes == VALUE), "the value is in the clear");
}

#[test]
fn pinned_peers_talk_and_others_do_not() {
    let (a, b, stranger) = (keypair(), keypair(), keypair());
    talk(join(&pinned(&a, &b), pinned(&b, &a)).unwrap());
    assert!(join(&pinned(&stranger, &b), pinned(&b, &a)).is_none(), "not on the list");
    assert!(join(&pinned(&a, &stranger), pinned(&b, &a)).is_none(), "another listener was expected");
}

#[test]
fn who_is_pinned_later_is_let_in_and_who_is_no_longer_is_not() {
    let (old, new, listener) = (keypair(), keypair(), keypair());
    let mut acceptor = Acceptor::new(pinned(&listener, &old), [3; 32], 7400).unwrap();
    let came = |acceptor: &Acceptor| {
        [&old, &new].map(|own| {
            let connecting = Connecting::new(&pinned(own, &listener), HERE, b"hello").unwrap();
            initial(acceptor, connecting).1.and_then(|initial| initial.key)
        })
    };
    assert_eq!(came(&acceptor), [Some(bytes(&old.public)), None]);
    acceptor.pin(vec![bytes(&new.public)]);
    assert_eq!(came(&acceptor), [None, Some(bytes(&new.public))]);
}

#[test]
fn another_key_or_none_is_not_let_in() {
    let key = |byte| Security::PreShared([byte; 32].into());
    assert!(join(&key(1), key(2)).is_none());
    assert!(join(&Security::Plaintext, key(2)).is_none());
    let (a, b) = (keypair(), keypair());
    assert!(join(&key(1), pinned(&a, &b)).is_none());
}

#[test]
fn a_refusal_is_read() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let (connecting, initial, _) = initial(&acceptor, Connecting::new(&key, HERE, b"hello").unwrap());
    let mut answer = Vec::new();
    initial.unwrap().refuse(b"no", &mut answer);
    let progress = connecting.handle(now(), &answer, config());
    assert!(matches!(&progress, Progress::Refused(said) if said == b"no"), "{progress:?}");
}

#[test]
fn an_answer_is_cut_where_it_is_longer_than_a_hello() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let (connecting, initial, _) = initial(&acceptor, Connecting::new(&key, HERE, b"hello").unwrap());
    let mut answer = Vec::new();
    let _there = initial.unwrap().take(now(), THERE, &[7; MAX_HELLO + 1], config(), &mut answer).unwrap();
    let progress = connecting.handle(now(), &answer, config());
    assert!(matches!(&progress, Progress::Taken(_, said) if *said == [7; MAX_HELLO]), "{progress:?}");
}

#[test]
fn nothing_secret_is_printed() {
    let (key, peer) = (Security::PreShared([9; 32].into()), keypair());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let (connecting, initial, _) = initial(&acceptor, Connecting::new(&key, HERE, b"hello").unwrap());
    let printed = format!("{:?}, {:?}, {key:?}", pinned(&peer, &peer), Security::Plaintext);
    assert_eq!(printed, "Pinned, Plaintext, PreShared");
    let printed = format!("{connecting:?}, {acceptor:?}, {:?}", initial.unwrap());
    let expected = "Connecting { here: ConnectionId(10), .. }, Acceptor { security: PreShared, .. }, \
                    Initial { from: ConnectionId(10), .. }";
    assert_eq!(printed, expected);
}

#[test]
fn a_reset_is_shorter_than_its_cause_and_of_one_key_and_one_port() {
    let reset = |security: &Security, port, length| {
        let acceptor = Acceptor::new(security.clone(), [3; 32], port).unwrap();
        let mut out = Vec::new();
        let handled = acceptor.handle(now(), address(), &vec![0; length], &mut out);
        assert_eq!(matches!(handled, Handled::Reply), !out.is_empty(), "{handled:?}");
        out
    };
    let shared = |byte| Security::PreShared([byte; 32].into());
    let own = |byte| Security::Pinned { own: [byte; 32].into(), peers: vec![[9; 32]] };
    let first = reset(&shared(1), 7400, 29);
    assert_eq!((first.len(), &first), (28, &reset(&shared(1), 7400, 1200)), "the same each time");
    assert_eq!(reset(&shared(1), 7400, 28), [0_u8; 0], "two listeners would go on for ever");
    let all = [shared(1), shared(2), own(3), own(4), Security::Plaintext];
    let different: BTreeSet<_> =
        [7400, 7401].iter().flat_map(|port| all.each_ref().map(|key| reset(key, *port, 29))).collect();
    assert_eq!(different.len(), 10);
}

#[test]
fn a_cookie_does_not_work_from_elsewhere_or_later() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let (_, _, first) = initial(&acceptor, Connecting::new(&key, HERE, b"hello").unwrap());
    let mut out = Vec::new();
    let elsewhere = SocketAddr::from(([192, 0, 2, 2], 4000));
    assert!(matches!(acceptor.handle(now(), elsewhere, &first, &mut out), Handled::Reply));
    let later = now().after(Duration::from_secs(11));
    assert!(matches!(acceptor.handle(later, address(), &first, &mut out), Handled::Reply));
    assert!(matches!(acceptor.handle(now(), address(), &first[..1199], &mut out), Handled::Ignore));
    assert!(acceptor.would_decrypt(now(), address(), &first));
    for (at, from, length) in [(now(), elsewhere, 1200), (later, address(), 1200), (now(), address(), 1199)] {
        assert!(!acceptor.would_decrypt(at, from, &first[..length]), "{at:?}, {from}, {length} bytes");
    }
}

/// A retry that anyone on the path can send to the peer with id 10: some version, some cookie.
fn retry(version: u64, cookie: u8) -> Vec<u8> {
    let word = version << 2 | 2;
    [&word.to_le_bytes()[..], &10_u32.to_le_bytes(), &[cookie; 24]].concat()
}

/// Continues to a connection, with a listener that always answers the same.
fn go_on(mut connecting: Connecting, acceptor: &Acceptor) -> Connection {
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    for _ in 0..3 {
        connecting.initial(&mut first);
        if let Handled::Initial(initial) = acceptor.handle(now(), address(), &first, &mut reply) {
            let _there = initial.take(now(), THERE, b"welcome", config(), &mut reply).unwrap();
        }
        connecting = match connecting.handle(now(), &reply, config()) {
            Progress::Retry(connecting) => connecting,
            Progress::Taken(connection, _) => return *connection,
            other => panic!("{other:?}"),
        };
    }
    panic!("no connection")
}

#[test]
fn a_forged_version_is_a_hint_and_the_handshake_goes_on() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let connecting = Connecting::new(&key, HERE, b"hello").unwrap();
    assert_eq!(connecting.claimed_version(), None);
    let Progress::None(connecting) = connecting.handle(now(), &retry(7, 0), config()) else {
        panic!("it ended the handshake")
    };
    assert_eq!(connecting.claimed_version(), Some(7));
    let Progress::Retry(connecting) = connecting.handle(now(), &retry(VERSION, 5), config()) else {
        panic!("no retry")
    };
    assert_eq!(connecting.claimed_version(), None, "somebody answers in this version");
    assert_eq!(go_on(connecting, &acceptor).closed(), None);
}

#[test]
fn a_forged_cookie_does_not_lock_the_true_one_out() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    let connecting = Connecting::new(&key, HERE, b"hello").unwrap();
    connecting.initial(&mut first);
    let Progress::Retry(connecting) = connecting.handle(now(), &retry(VERSION, 5), config()) else {
        panic!("no retry")
    };
    // The listener's own cookie comes behind it.
    assert!(matches!(acceptor.handle(now(), address(), &first, &mut reply), Handled::Reply));
    let Progress::Retry(connecting) = connecting.handle(now(), &reply, config()) else {
        panic!("the first cookie keeps it out")
    };
    connecting.initial(&mut first);
    assert!(matches!(acceptor.handle(now(), address(), &first, &mut reply), Handled::Initial(_)));
    // A cookie is answered only once, and not if it is for another peer.
    let mut for_another = retry(VERSION, 6);
    for_another[8] ^= 1;
    let mut connecting = connecting;
    for datagram in [&reply[..], &for_another, &[]] {
        let Progress::None(same) = connecting.handle(now(), datagram, config()) else {
            panic!("{datagram:?} was answered")
        };
        connecting = same;
    }
}

#[test]
fn forged_cookies_are_not_sent_back_without_end_and_who_goes_on_comes_in() {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let mut connecting = Connecting::new(&key, HERE, b"hello").unwrap();
    let (mut sent, mut at) = (0, now());
    for cookie in 0..100 {
        at = at.after(Duration::from_millis(1));
        connecting = match connecting.handle(at, &retry(VERSION, cookie), config()) {
            Progress::Retry(connecting) => {
                sent += 1;
                connecting
            }
            Progress::None(connecting) => connecting,
            other => panic!("{other:?}"),
        };
    }
    assert!((2..=12).contains(&sent), "{sent} first packets in a tenth of a second");
    // A first packet with an invalid cookie is answered with a valid one.
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    connecting.initial(&mut first);
    assert!(matches!(acceptor.handle(now(), address(), &first, &mut reply), Handled::Reply));
    let later = at.after(Duration::from_millis(60));
    assert!(matches!(connecting.handle(later, &reply, config()), Progress::Retry(_)));
}

proptest! {
    #[test]
    fn no_stranger_gets_back_more_than_a_third_or_a_shorter_reset(
        mut bytes in prop::collection::vec(any::<u8>(), 0..1500),
        form in 0u8..4,
    ) {
        if let Some(first) = bytes.first_mut() {
            *first = (VERSION << 2) as u8 | form;
        }
        let acceptor = Acceptor::new(Security::PreShared([9; 32].into()), [3; 32], 7400).unwrap();
        let mut out = Vec::new();
        match acceptor.handle(now(), address(), &bytes, &mut out) {
            // A reset.
            Handled::Reply if form == 0 => prop_assert!(out.len() < bytes.len()),
            Handled::Reply => prop_assert!(out.len() * 3 <= bytes.len()),
            Handled::Ignore => prop_assert!(out.is_empty()),
            other => prop_assert!(false, "{other:?}"),
        }
    }
}
