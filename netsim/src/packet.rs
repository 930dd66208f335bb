//! Packets between hosts.

use std::net::SocketAddr;

use bytes::Bytes;

use crate::host::HostId;
use crate::link::Ecn;
use crate::tcp::{Class, Segment};

/// The header of UDP, bytes (RFC 768).
const UDP_HEADER: u32 = 8;

/// The largest payload of a small datagram, bytes: see [`Class::SmallDatagram`].
const SMALL_DATAGRAM: usize = 64;

/// An IP packet.
#[derive(Debug, Clone)]
pub(crate) struct Packet {
    pub(crate) from: HostId,
    pub(crate) to: HostId,
    pub(crate) src: SocketAddr,
    pub(crate) dst: SocketAddr,
    pub(crate) ecn: Ecn,
    pub(crate) body: Body,
}

/// The payload of an IP packet.
#[derive(Debug, Clone)]
pub(crate) enum Body {
    Udp(Bytes),
    Tcp(Segment),
}

impl Packet {
    /// The IP header: 20 bytes for IPv4 (RFC 791), 40 for IPv6 (RFC 8200).
    pub(crate) const fn ip_header(&self) -> u32 {
        if self.dst.is_ipv4() { 20 } else { 40 }
    }

    pub(crate) fn transport_header(&self) -> u32 {
        match &self.body {
            Body::Udp(_) => UDP_HEADER,
            Body::Tcp(segment) => segment.header(),
        }
    }

    pub(crate) fn payload(&self) -> u32 {
        match &self.body {
            Body::Udp(data) => data.len() as u32,
            Body::Tcp(segment) => segment.data.len() as u32,
        }
    }

    pub(crate) fn ip_bytes(&self) -> u32 {
        self.ip_header() + self.transport_header() + self.payload()
    }

    /// The protocol number in the IP header.
    pub(crate) const fn protocol(&self) -> u8 {
        match &self.body {
            Body::Udp(_) => 17,
            Body::Tcp(_) => 6,
        }
    }

    pub(crate) const fn class(&self) -> Class {
        match &self.body {
            Body::Udp(data) if data.len() <= SMALL_DATAGRAM => Class::SmallDatagram,
            Body::Udp(_) => Class::Datagram,
            Body::Tcp(segment) => segment.class,
        }
    }
}
