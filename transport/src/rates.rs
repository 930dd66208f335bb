//! How much peers and strangers may ask for in a second.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use thiserror::Error;

use crate::desk::lock;
use crate::net::Instant;
use crate::{Limits, PeerAddress};

const SECOND: Duration = Duration::from_secs(1);

/// More came in a second than the [limits](crate::Limits) allow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TooMany {
    /// Handshakes from one address, or, of IPv6, from one network of 64 bits.
    #[error("more than {0} handshakes a second from this address")]
    FromAddress(u32),
    /// Handshakes at one listener.
    #[error("more than {0} handshakes a second")]
    InAll(u32),
    /// Messages of one peer on the frames lane.
    #[error("it sent more than {0} messages a second")]
    Messages(u32),
}

/// What a listener has turned away since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TurnedAway {
    /// Handshakes for which there was no room: too many were under way.
    pub no_room: u64,
    /// Handshakes beyond what one address may begin in a second.
    pub from_address: u64,
    /// Handshakes beyond what all together may begin in a second.
    pub in_all: u64,
    /// Connections of peers for which there was no place: as many peers as may come were there.
    pub no_place: u64,
}

/// A listener as those who came through it know it: reads what it turns away, though the listener itself is gone.
#[derive(Debug, Clone)]
pub struct Door(pub(crate) Arc<Handshakes>);

impl Door {
    /// What was turned away since the listener was made.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAway {
        self.0.turned_away()
    }
}

impl PartialEq for Door {
    /// Whether both are the same listener's.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Counts the handshakes of a second.
#[derive(Debug)]
pub(crate) struct Handshakes {
    in_all: u32,
    from_address: u32,
    counts: Mutex<Counts>,
}

/// Of the second under way. There are no more addresses than handshakes, so that strangers cannot make it grow.
#[derive(Debug, Default)]
struct Counts {
    begun: Option<Instant>,
    all: u32,
    addresses: HashMap<IpAddr, u32>,
    turned_away: TurnedAway,
}

impl Handshakes {
    pub(crate) fn new(limits: &Limits) -> Self {
        Self {
            in_all: limits.handshakes_per_s,
            from_address: limits.handshakes_per_s_per_address,
            counts: Mutex::default(),
        }
    }

    /// Counts a handshake that begins.
    pub(crate) fn begin(&self, now: Instant, from: &PeerAddress) -> Result<(), TooMany> {
        let mut counts = lock(&self.counts);
        if counts.begun.is_none_or(|begun| now.since(begun) >= SECOND) {
            counts.begun = Some(now);
            counts.all = 0;
            counts.addresses.clear();
        }
        if counts.all >= self.in_all {
            counts.turned_away.in_all += 1;
            return Err(TooMany::InAll(self.in_all));
        }
        if let Some(address) = network_of(from) {
            let count = counts.addresses.entry(address).or_default();
            if *count >= self.from_address {
                counts.turned_away.from_address += 1;
                return Err(TooMany::FromAddress(self.from_address));
            }
            *count += 1;
        }
        counts.all += 1;
        Ok(())
    }

    /// Counts a handshake for which there was no room.
    pub(crate) fn no_room(&self) {
        lock(&self.counts).turned_away.no_room += 1;
    }

    /// Counts a peer for which there was no place.
    pub(crate) fn no_place(&self) {
        lock(&self.counts).turned_away.no_place += 1;
    }

    pub(crate) fn turned_away(&self) -> TurnedAway {
        lock(&self.counts).turned_away
    }
}

/// What counts as one address: who has one of IPv6 has 2^64. Peers of this machine have none.
fn network_of(from: &PeerAddress) -> Option<IpAddr> {
    match from {
        PeerAddress::Tcp(at) | PeerAddress::Udp(at) | PeerAddress::Quic(at) => Some(match at.ip() {
            IpAddr::V4(v4) => v4.into(),
            IpAddr::V6(v6) => v6.to_ipv4_mapped().map_or_else(
                || {
                    let [a, b, c, d, ..] = v6.segments();
                    IpAddr::from([a, b, c, d, 0, 0, 0, 0])
                },
                IpAddr::from,
            ),
        }),
        PeerAddress::InProcess | PeerAddress::Unix(_) => None,
    }
}

/// Counts the messages that a peer sends. The clock is asked once in so many messages as a second may have.
#[derive(Debug)]
pub(crate) struct Messages {
    most: u32,
    count: u32,
    begun: Option<Instant>,
}

impl Messages {
    pub(crate) const fn new(most: u32) -> Self {
        Self { most, count: 0, begun: None }
    }

    /// Counts one.
    pub(crate) fn count(&mut self, now: impl FnOnce() -> Instant) -> Result<(), TooMany> {
        self.count += 1;
        if self.count < self.most && self.begun.is_some() {
            return Ok(());
        }
        let now = now();
        let too_many = self.count >= self.most && self.begun.is_some_and(|begun| now.since(begun) < SECOND);
        (self.count, self.begun) = (0, Some(now));
        if too_many { Err(TooMany::Messages(self.most)) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    fn from(ip: &str) -> PeerAddress {
        PeerAddress::Tcp((ip.parse::<IpAddr>().unwrap(), 1).into())
    }

    fn handshakes(in_all: u32, from_address: u32) -> Handshakes {
        let limits = Limits {
            handshakes_per_s: in_all,
            handshakes_per_s_per_address: from_address,
            ..Limits::default()
        };
        Handshakes::new(&limits)
    }

    #[test]
    fn an_address_and_all_together_have_their_handshakes_a_second() {
        let handshakes = handshakes(5, 2);
        let begin = |ms, ip| handshakes.begin(at(ms), &from(ip));
        assert_eq!((begin(0, "10.0.0.1"), begin(0, "10.0.0.1")), (Ok(()), Ok(())));
        assert_eq!(begin(10, "10.0.0.1"), Err(TooMany::FromAddress(2)));
        assert_eq!(
            (begin(10, "10.0.0.2"), begin(10, "10.0.0.2"), begin(10, "10.0.0.3")),
            (Ok(()), Ok(()), Ok(()))
        );
        assert_eq!(begin(999, "10.0.0.4"), Err(TooMany::InAll(5)));
        assert_eq!(begin(1000, "10.0.0.1"), Ok(()), "another second");
        assert_eq!(
            handshakes.turned_away(),
            TurnedAway { from_address: 1, in_all: 1, ..TurnedAway::default() }
        );
    }

    #[test]
    fn a_network_of_ipv6_is_one_address_and_a_mapped_one_is_ipv4() {
        let handshakes = handshakes(10, 1);
        let begin = |ip| handshakes.begin(at(0), &from(ip)).is_ok();
        assert!(begin("2001:db8::1") && !begin("2001:db8::2") && begin("2001:db8:0:1::1"));
        assert!(begin("::ffff:10.0.0.1") && !begin("10.0.0.1") && begin("::ffff:10.0.0.2"));
    }

    #[test]
    fn no_flood_of_addresses_makes_memory_grow() {
        let handshakes = handshakes(100, 10);
        for n in 0..100_000_u32 {
            let ip = IpAddr::from(n.to_be_bytes()).to_string();
            let _turned_away = handshakes.begin(at(u64::from(n) / 1000), &from(&ip));
        }
        assert!(lock(&handshakes.counts).addresses.len() <= 100);
        assert_eq!(handshakes.turned_away().in_all, 99_900);
    }

    #[test]
    fn messages_are_too_many_within_a_second_and_not_over_two() {
        let mut messages = Messages::new(1000);
        for n in 0..10_000 {
            assert_eq!(messages.count(|| at(n * 2)), Ok(()), "500 a second");
        }
        let mut fast = Messages::new(1000);
        let refused = (0..10_000).position(|n| fast.count(|| at(n / 2)).is_err());
        assert_eq!(refused, Some(1000), "2,000 a second");
    }
}
