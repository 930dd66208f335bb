//! The hosts of a topology, and their addresses.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

/// A host with sockets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct HostId(pub(crate) usize);

impl HostId {
    /// Its address for IPv4.
    #[must_use]
    pub fn v4(self) -> IpAddr {
        Ipv4Addr::from_bits(0x0a00_0001 + self.0 as u32).into()
    }

    /// Its address for IPv6.
    #[must_use]
    pub fn v6(self) -> IpAddr {
        Ipv6Addr::from_bits((0xfd00_u128 << 112) + 1 + self.0 as u128).into()
    }

    /// The host that `address` belongs to, seen from this one: its own for loopback and unspecified
    /// addresses.
    pub(crate) fn of(self, address: IpAddr) -> Option<Self> {
        if address.is_loopback() || address.is_unspecified() {
            return Some(self);
        }
        let number = match address {
            IpAddr::V4(v4) => u128::from(v4.to_bits().checked_sub(0x0a00_0001)?),
            IpAddr::V6(v6) => v6.to_bits().checked_sub((0xfd00_u128 << 112) + 1)?,
        };
        usize::try_from(number).ok().map(Self)
    }

    /// The address from which it sends to the host `to` at `address`: its own of the same family. For
    /// itself it is `address`, which may be its loopback.
    pub(crate) fn source_to(self, to: Self, address: IpAddr) -> IpAddr {
        match address {
            own if self == to => own,
            IpAddr::V4(_) => self.v4(),
            IpAddr::V6(_) => self.v6(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_name_hosts() {
        let me = HostId(4);
        for host in [HostId(0), HostId(7)] {
            assert_eq!((me.of(host.v4()), me.of(host.v6())), (Some(host), Some(host)));
        }
        for own in ["127.0.0.1", "0.0.0.0", "::1", "::"] {
            assert_eq!(me.of(own.parse().unwrap()), Some(me));
        }
        assert_eq!(me.of("9.9.9.9".parse().unwrap()), None);
    }
}
