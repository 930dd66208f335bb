//! Properties of any datagram at all. The fuzz targets search for one that breaks it; an ordinary test
//! of `trimaran-udp` replays the corpus.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use trimaran_net::Instant;
use trimaran_udp::{
    Acceptor, Closed, Connecting, Connection, ConnectionId, Handled, MIN_DATAGRAM, Progress, Received,
    Security, UnitLane, destination,
};
use trimaran_wire::{CloseReason, FrameMessage};

use crate::wire::{config, sealed, value};

const HERE: ConnectionId = ConnectionId(10);
const THERE: ConnectionId = ConnectionId(20);
const SECRET: [u8; 32] = [7; 32];
/// Where the peer is, and where it is not unless it says so.
const HOME: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(192, 0, 2, 2)), 4000);
const ELSEWHERE: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1)), 4000);

fn now() -> Instant {
    Instant::from_nanos(1_000_000_000)
}

/// Any datagram from a stranger, as it is and filled up to a first packet's length, is answered with a third
/// of it at most, or with a shorter reset; and any answer leaves the side that connects waiting or gives a
/// sound connection.
pub fn strangers(bytes: &[u8]) {
    let mut filled = bytes.to_vec();
    filled.resize(MIN_DATAGRAM.max(bytes.len()), 0);
    for security in [Security::Plaintext, Security::PreShared([9; 32].into())] {
        for datagram in [bytes, &filled] {
            initial(&security, datagram);
            answer(&security, datagram);
        }
    }
}

fn initial(security: &Security, datagram: &[u8]) {
    let Ok(acceptor) = Acceptor::new(security.clone(), SECRET, 7400) else {
        unreachable!("the keys are good")
    };
    let mut out = Vec::new();
    match acceptor.handle(now(), ELSEWHERE, datagram, &mut out) {
        // A reset.
        Handled::Reply if destination(datagram).is_some() => assert!(out.len() < datagram.len()),
        Handled::Reply => assert!(out.len() * 3 <= datagram.len(), "{} for {}", out.len(), datagram.len()),
        Handled::Initial(initial) => {
            assert!(datagram.len() >= MIN_DATAGRAM);
            let connection = initial.take(now(), THERE, b"welcome", config(), &mut out);
            assert!(connection.is_some(), "who knocks rightly is let in");
            assert!(out.len() <= MIN_DATAGRAM);
        }
        _ => assert_eq!(out, [0; 0]),
    }
}

fn answer(security: &Security, datagram: &[u8]) {
    let Ok(connecting) = Connecting::new(security, HERE, b"hello") else { unreachable!("the keys are good") };
    match connecting.handle(now(), datagram, config()) {
        Progress::Retry(connecting) | Progress::None(connecting) => {
            let mut out = Vec::new();
            connecting.initial(&mut out);
            assert_eq!(out.len(), MIN_DATAGRAM);
        }
        Progress::Taken(mut connection, said) => {
            assert!(said.len() < datagram.len());
            settle(&mut connection, now());
        }
        _ => {}
    }
}

/// Any chunks, each packet of them a byte of length and so many bytes, sealed as a peer would, and two of
/// four from elsewhere: the connection passes on no more than came, asks there with thrice as much at most,
/// sends packets that fit until it has no more, and is over for good when it is over.
pub fn chunks(bytes: &[u8]) {
    let mut connection = Connection::plaintext(now(), HERE, THERE, config());
    connection.publish(None, value());
    for lane in UnitLane::ALL {
        connection.end_lane(lane, CloseReason::new(0, "over"));
    }
    connection.follow(HOME, SECRET);
    settle(&mut connection, now());
    let (mut rest, mut at, mut passed, mut elsewhere) = (bytes, now(), 0, 0);
    for number in 0.. {
        let Some((&length, tail)) = rest.split_first() else { break };
        let (body, tail) = tail.split_at(tail.len().min(usize::from(length)));
        rest = tail;
        let closed = connection.closed().cloned();
        let (from, datagram) = (if number & 2 == 0 { ELSEWHERE } else { HOME }, sealed(HERE.0, number, body));
        connection.handle_from(at, from, &datagram);
        elsewhere += if from == ELSEWHERE { 3 * datagram.len() } else { 0 };
        for lane in UnitLane::ALL {
            while let Some(item) = connection.recv(lane) {
                assert_eq!(closed, None, "nothing comes after the end");
                match item {
                    Received::Frame(FrameMessage::Batch(bytes) | FrameMessage::Coded(bytes))
                    | Received::Message(bytes)
                    | Received::Block(bytes) => passed += bytes.len(),
                    _ => {}
                }
            }
        }
        settle(&mut connection, at);
        let mut out = Vec::new();
        while let Some(to) = connection.poll_excursion(at, &mut out) {
            assert!(out.len() <= MIN_DATAGRAM && connection.closed().is_none());
            if to == ELSEWHERE {
                assert!(out.len() <= elsewhere, "more than thrice what came from there");
                elsewhere -= out.len();
            }
        }
        assert!(passed <= bytes.len(), "{passed} bytes out of {}", bytes.len());
        assert!(closed.is_none() || connection.closed() == closed.as_ref(), "over for good");
        at = connection.poll_timeout().unwrap_or(at).max(at.after(Duration::from_micros(1)));
        connection.handle_timeout(at);
    }
}

/// Sends what there is.
fn settle(connection: &mut Connection, at: Instant) {
    let mut out = Vec::new();
    for _ in 0..64 {
        if !connection.poll_transmit(at, &mut out) {
            assert_ne!(connection.closed(), Some(&Closed::Exhausted));
            assert_eq!(connection.poll_timeout().is_none(), connection.closed().is_some());
            return;
        }
        assert!(out.len() <= config().max_datagram);
    }
    unreachable!("it never stops to send");
}
