//! Rate limits for peers and strangers.

use parking_lot::{Mutex, RwLock};
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;

use crate::{Limits, PeerAddress};
use trimaran_net::{Instant, StreamPeer};

const SECOND: Duration = Duration::from_secs(1);

/// A rate exceeded the [limits](crate::Limits).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TooMany {
    /// Handshakes from one address, one IPv6 network of 64 bits, or over Unix sockets one user.
    #[error("more than {0} handshakes a second from this address")]
    FromAddress(u32),
    /// Handshakes at one listener.
    #[error("more than {0} handshakes a second")]
    InAll(u32),
    /// Messages of one peer on the frames lane, or on the messages lane.
    #[error("it sent more than {0} messages a second")]
    Messages(u32),
}

/// The counts of refused handshakes of a listener since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct TurnedAway {
    /// Open handshakes that gave way to newer ones, because there were too many.
    pub no_room: u64,
    /// Handshakes beyond what one address, or one user of this machine, may begin in a second.
    pub from_address: u64,
    /// Handshakes beyond the limit for all addresses together, and beyond their address's even share of it.
    pub in_all: u64,
    /// Connections of peers without a free place: the limit of peers was reached.
    pub no_place: u64,
}

/// The counts of a listener, readable through its links even if the listener itself is gone.
#[derive(Debug, Clone)]
pub struct ListenerStats(pub(crate) Arc<Handshakes>);

impl ListenerStats {
    /// The counts of refused handshakes since the listener was made.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAway {
        self.0.turned_away()
    }
}

impl PartialEq for ListenerStats {
    /// Whether both are of the same listener.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// The limits of a listener, which may change while it listens.
#[derive(Debug, Clone)]
pub struct ListenerLimits(pub(crate) Arc<Handshakes>);

impl ListenerLimits {
    /// Holds new peers and handshakes to these limits from now on. Links that are there stay.
    pub fn change(&self, limits: Limits) {
        *self.0.limits.write() = limits;
    }
}

/// Counts the handshakes of a second, and holds them to the limits.
#[derive(Debug)]
pub(crate) struct Handshakes {
    limits: RwLock<Limits>,
    counts: Mutex<Counts>,
}

/// Counts of the current second. There are no more origins than handshakes for all, so that strangers cannot
/// make it grow.
#[derive(Debug, Default)]
struct Counts {
    begun: Option<Instant>,
    all: u32,
    origins: HashMap<Origin, u32>,
    turned_away: TurnedAway,
}

impl Handshakes {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { limits: RwLock::new(limits), counts: Mutex::default() }
    }

    /// The limits of this moment.
    pub(crate) fn limits(&self) -> Limits {
        *self.limits.read()
    }

    /// Counts a new handshake. An origin has its even share even where others have begun too many, so at most
    /// twice the limit for all together gets through.
    pub(crate) fn begin(&self, now: Instant, from: &PeerAddress) -> Result<(), TooMany> {
        let Limits { handshakes_per_s: in_all, handshakes_per_s_per_address: from_address, .. } =
            self.limits();
        let mut counts = self.counts.lock();
        if counts.begun.is_none_or(|begun| now.since(begun) >= SECOND) {
            counts.begun = Some(now);
            counts.all = 0;
            counts.origins.clear();
        }
        let origin = Origin::of(from);
        let known = counts.origins.get(&origin).copied();
        let count = known.unwrap_or(0);
        if count >= from_address {
            counts.turned_away.from_address += 1;
            return Err(TooMany::FromAddress(from_address));
        }
        let origins = counts.origins.len() + usize::from(known.is_none());
        let share = in_all / u32::try_from(origins).unwrap_or(u32::MAX).max(1);
        if counts.all >= in_all && count >= share {
            counts.turned_away.in_all += 1;
            return Err(TooMany::InAll(in_all));
        }
        counts.origins.insert(origin, count + 1);
        counts.all += 1;
        Ok(())
    }

    /// Counts a handshake that gave way to another.
    pub(crate) fn no_room(&self) {
        self.counts.lock().turned_away.no_room += 1;
    }

    /// Counts a peer without a free place.
    pub(crate) fn no_place(&self) {
        self.counts.lock().turned_away.no_place += 1;
    }

    pub(crate) fn turned_away(&self) -> TurnedAway {
        self.counts.lock().turned_away
    }
}

/// The origin of handshakes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Origin {
    /// An address, or the first 64 bits of an IPv6 address: the holder of one of these has 2^64.
    Network(IpAddr),
    /// A user of this machine.
    User(u32),
    /// This process.
    Process,
}

impl Origin {
    pub(crate) fn of(from: &PeerAddress) -> Self {
        match from {
            PeerAddress::Tcp(at)
            | PeerAddress::Udp(at)
            | PeerAddress::Quic(at)
            | PeerAddress::Other { at: StreamPeer::Tcp(at), .. } => Self::Network(match at.ip() {
                IpAddr::V4(v4) => v4.into(),
                IpAddr::V6(v6) => v6.to_ipv4_mapped().map_or_else(
                    || {
                        let [a, b, c, d, ..] = v6.segments();
                        IpAddr::from([a, b, c, d, 0, 0, 0, 0])
                    },
                    IpAddr::from,
                ),
            }),
            PeerAddress::Unix(peer) | PeerAddress::Other { at: StreamPeer::Unix(peer), .. } => {
                Self::User(peer.uid)
            }
            PeerAddress::InProcess => Self::Process,
        }
    }
}

/// Lets at most one event per interval be logged.
#[derive(Debug, Default)]
pub(crate) struct Sparse(Mutex<(Option<Instant>, u64)>);

impl Sparse {
    const PAUSE: Duration = Duration::from_secs(5);

    /// How many events were not logged since the last one that was, if this one may be.
    pub(crate) fn take(&self, now: Instant) -> Option<u64> {
        let (told, untold) = &mut *self.0.lock();
        if told.is_some_and(|told| now.since(told) < Self::PAUSE) {
            *untold += 1;
            return None;
        }
        *told = Some(now);
        Some(std::mem::take(untold))
    }
}

/// Counts the messages of a peer. It reads the clock once in as many messages as a second may have.
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

    /// Counts one message.
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
        Handshakes::new(limits)
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
        assert_eq!(begin(998, "10.0.0.2"), Err(TooMany::FromAddress(2)));
        assert_eq!(begin(999, "10.0.0.3"), Err(TooMany::InAll(5)), "its share among three is one");
        assert_eq!(begin(1000, "10.0.0.1"), Ok(()), "another second");
        assert_eq!(
            handshakes.turned_away(),
            TurnedAway { from_address: 2, in_all: 1, ..TurnedAway::default() }
        );
    }

    #[test]
    fn changed_limits_hold_from_then_on() {
        let handshakes = Arc::new(handshakes(100, 1));
        let begin = || handshakes.begin(at(0), &from("10.0.0.1"));
        assert_eq!((begin(), begin()), (Ok(()), Err(TooMany::FromAddress(1))));
        let limits = Limits::default().with_handshakes_per_s_per_address(2);
        ListenerLimits(Arc::clone(&handshakes)).change(limits);
        assert_eq!((begin(), begin()), (Ok(()), Err(TooMany::FromAddress(2))));
    }

    #[test]
    fn an_address_has_its_even_share_though_others_have_begun_too_many() {
        let handshakes = handshakes(6, 3);
        let begin = |ip| handshakes.begin(at(0), &from(ip));
        for _ in 0..3 {
            assert_eq!((begin("10.0.0.1"), begin("10.0.0.2")), (Ok(()), Ok(())));
        }
        assert_eq!((begin("10.0.0.3"), begin("10.0.0.3")), (Ok(()), Ok(())), "a third of six");
        assert_eq!(begin("10.0.0.3"), Err(TooMany::InAll(6)));
        assert_eq!((begin("10.0.0.4"), begin("10.0.0.5"), begin("10.0.0.6")), (Ok(()), Ok(()), Ok(())));
        assert_eq!(begin("10.0.0.7"), Err(TooMany::InAll(6)), "a seventh of six is none");
    }

    #[test]
    fn a_user_of_this_machine_counts_as_one_address_does() {
        let handshakes = handshakes(10, 1);
        let user = |uid| PeerAddress::Unix(crate::Credentials { uid, gid: 0, pid: None });
        let begin = |uid| handshakes.begin(at(0), &user(uid)).is_ok();
        assert!(begin(1) && !begin(1) && begin(2));
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
        assert!(handshakes.counts.lock().origins.len() <= 100);
        assert_eq!(handshakes.turned_away().in_all, 99_900);
    }

    #[test]
    fn one_event_in_five_seconds_is_told_with_how_many_were_not() {
        let sparse = Sparse::default();
        let told: Vec<_> = [0, 1, 4999, 5000, 5001, 60_000].map(|ms| sparse.take(at(ms))).into();
        assert_eq!(told, [Some(0), None, None, Some(2), None, Some(1)]);
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
