//! Addresses as programs write them.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, SocketAddrV6};

use crate::net::SimNet;

/// Something that names addresses: an address, or the name of a host of the topology with a port.
pub trait ToSocketAddrs: Lookup {}

impl<T: Lookup + ?Sized> ToSocketAddrs for T {}

/// How an address is looked up; nobody else implements it.
pub trait Lookup {
    /// The addresses as seen by a host.
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>>;
}

/// Makes addresses of types that need no lookup.
macro_rules! plain {
    ($($address:ty),+) => {
        $(impl Lookup for $address {
            fn lookup(&self, _net: &SimNet) -> io::Result<Vec<SocketAddr>> {
                Ok(vec![(*self).into()])
            }
        })+
    };
}

plain!(SocketAddr, SocketAddrV4, SocketAddrV6, (IpAddr, u16), (Ipv4Addr, u16), (Ipv6Addr, u16));

impl Lookup for str {
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        net.lookup(self)
    }
}

impl Lookup for String {
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        net.lookup(self)
    }
}

impl Lookup for (&str, u16) {
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        let (name, port) = *self;
        match name.parse::<IpAddr>() {
            Ok(address) => Ok(vec![(address, port).into()]),
            Err(_) => net.lookup(&format!("{name}:{port}")),
        }
    }
}

impl Lookup for (String, u16) {
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        (self.0.as_str(), self.1).lookup(net)
    }
}

impl Lookup for [SocketAddr] {
    fn lookup(&self, _net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        Ok(self.to_vec())
    }
}

impl<T: Lookup + ?Sized> Lookup for &T {
    fn lookup(&self, net: &SimNet) -> io::Result<Vec<SocketAddr>> {
        (**self).lookup(net)
    }
}

/// The error where a name has no address at all.
pub(super) fn no_address() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, "no address to use")
}
