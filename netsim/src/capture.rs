//! The hosts' packets as a file for Wireshark: pcapng, with an interface for each host.

use std::fmt;
use std::io::{self, Write};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use etherparse::err::packet::BuildVecWriteError;
use etherparse::{
    IpEcn, IpHeaders, IpNumber, Ipv4Header, Ipv6Header, PacketBuilder, TcpHeader, TcpOptionElement,
};
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use pcap_file::pcapng::blocks::section_header::SectionHeaderBlock;
use pcap_file::pcapng::{PcapNgBlock, PcapNgWriter};
use pcap_file::{DataLink, Endianness, PcapError};
use thiserror::Error;
use trimaran_net::Instant;

use crate::host::HostId;
use crate::link::Ecn;
use crate::packet::{Body, Packet};
use crate::tcp::Segment;

/// The TCP window scale in headers (RFC 7323); the model itself has no such limit.
const WINDOW_SHIFT: u8 = 8;
/// Times have nine decimal places.
const NANOSECONDS: u8 = 9;
/// Linux's initial time to live.
const HOPS: u8 = 64;

/// Why packets could not be captured.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The file cannot be written.
    #[error("cannot write down packets")]
    Write(#[from] io::Error),
    /// A packet is too large for the length fields of its headers.
    #[error("a packet cannot be written down")]
    Packet(#[source] BuildVecWriteError),
    /// A block of the file.
    #[error("cannot write down packets")]
    Block(#[source] PcapError),
}

/// Captures packets in the order and at the times in which hosts send them, also those that links lose.
pub(crate) struct Capture {
    file: PcapNgWriter<Box<dyn Write + Send>>,
    failure: Option<CaptureError>,
}

impl fmt::Debug for Capture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Capture").field("failure", &self.failure).finish_non_exhaustive()
    }
}

impl Capture {
    /// Begins a capture for hosts of these names.
    pub(crate) fn begin<'n>(
        out: Box<dyn Write + Send>,
        hosts: impl Iterator<Item = &'n str>,
    ) -> Result<Self, CaptureError> {
        let section = SectionHeaderBlock { endianness: Endianness::Little, ..SectionHeaderBlock::default() };
        let mut file = PcapNgWriter::with_section_header(out, section).map_err(CaptureError::Block)?;
        for name in hosts {
            let interface = InterfaceDescriptionBlock {
                linktype: DataLink::ETHERNET,
                snaplen: 0,
                options: vec![
                    InterfaceDescriptionOption::IfName(name.into()),
                    InterfaceDescriptionOption::IfTsResol(NANOSECONDS),
                ],
            };
            file.write_block(&interface.into_block()).map_err(CaptureError::Block)?;
        }
        Ok(Self { file, failure: None })
    }

    /// Adds a packet. After one failure no more are added.
    pub(crate) fn add(&mut self, now: Instant, packet: &Packet, mtu: u32) {
        if self.failure.is_none() {
            self.failure = self.write(now, packet, mtu).err();
        }
    }

    fn write(&mut self, now: Instant, packet: &Packet, mtu: u32) -> Result<(), CaptureError> {
        let data = frame(packet, mtu).map_err(CaptureError::Packet)?;
        let block = EnhancedPacketBlock {
            interface_id: packet.from.0 as u32,
            timestamp: Duration::from_nanos(now.as_nanos()),
            original_len: data.len() as u32,
            data: data.into(),
            options: Vec::new(),
        };
        self.file.write_block(&block.into_block()).map(drop).map_err(CaptureError::Block)
    }

    /// Ends the capture, and says whether all packets were written.
    pub(crate) fn end(mut self) -> Result<(), CaptureError> {
        match self.failure {
            Some(failure) => Err(failure),
            None => Ok(self.file.get_mut().flush()?),
        }
    }
}

/// The packet in an Ethernet frame, without its check sequence. `mtu` is the path MTU to its host.
fn frame(packet: &Packet, mtu: u32) -> Result<Vec<u8>, BuildVecWriteError> {
    let ethernet = PacketBuilder::ethernet2(mac(packet.from), mac(packet.to));
    let with_ip = ethernet.ip(ip_header(packet));
    let mut frame = Vec::new();
    match &packet.body {
        Body::Udp(data) => {
            with_ip.udp(packet.src.port(), packet.dst.port()).write_to_vec(&mut frame, data)?;
        }
        Body::Tcp(segment) => {
            let full = mtu.saturating_sub(packet.ip_header() + 20);
            let header = tcp_header(packet.src, packet.dst, segment, full);
            with_ip.tcp_header(header).write_to_vec(&mut frame, &segment.data)?;
        }
    }
    Ok(frame)
}

/// A locally administered address (IEEE 802c).
const fn mac(host: HostId) -> [u8; 6] {
    let [.., high, low] = (host.0 as u64).to_be_bytes();
    [2, 0, 0, 0, high, low]
}

/// Lengths and checksums are filled in when the packet is built.
fn ip_header(packet: &Packet) -> IpHeaders {
    let ecn = match packet.ecn {
        Ecn::NotCapable => IpEcn::ZERO,
        Ecn::Capable0 => IpEcn::TWO,
        Ecn::Capable1 => IpEcn::ONE,
        Ecn::Experienced => IpEcn::THREE,
    };
    match (packet.src.ip(), packet.dst.ip()) {
        (IpAddr::V4(source), IpAddr::V4(destination)) => {
            let header = Ipv4Header {
                ecn,
                dont_fragment: true,
                time_to_live: HOPS,
                protocol: IpNumber(packet.protocol()),
                source: source.octets(),
                destination: destination.octets(),
                ..Ipv4Header::default()
            };
            IpHeaders::Ipv4(header, Default::default())
        }
        (source, destination) => {
            let octets = |address: IpAddr| match address {
                IpAddr::V4(v4) => v4.to_ipv6_mapped().octets(),
                IpAddr::V6(v6) => v6.octets(),
            };
            let header = Ipv6Header {
                traffic_class: ecn.value(),
                next_header: IpNumber(packet.protocol()),
                hop_limit: HOPS,
                source: octets(source),
                destination: octets(destination),
                ..Ipv6Header::default()
            };
            IpHeaders::Ipv6(header, Default::default())
        }
    }
}

/// Sequence numbers begin at 0 and wrap here, as they do not in the model.
fn tcp_header(src: SocketAddr, dst: SocketAddr, segment: &Segment, full: u32) -> TcpHeader {
    let shift = if segment.syn { 0 } else { WINDOW_SHIFT };
    let window = u16::try_from(segment.window >> shift).unwrap_or(u16::MAX);
    let mut header = TcpHeader::new(src.port(), dst.port(), segment.seq as u32, window);
    (header.syn, header.fin, header.rst) = (segment.syn, segment.fin, segment.rst);
    header.psh = !segment.data.is_empty();
    if let Some(ack) = segment.ack {
        (header.ack, header.acknowledgment_number) = (true, ack as u32);
    }
    // At most 40 bytes of options; with more, the header would go without.
    let _fits = header.set_options(&options(segment, full));
    header
}

/// As [`Segment::header`] counts them.
fn options(segment: &Segment, full: u32) -> Vec<TcpOptionElement> {
    use TcpOptionElement::{
        MaximumSegmentSize, Noop, SelectiveAcknowledgement, SelectiveAcknowledgementPermitted, Timestamp,
        WindowScale,
    };
    let stamp = Timestamp(segment.timestamp as u32, segment.echo as u32);
    if segment.rst {
        return Vec::new();
    }
    if segment.syn {
        let largest = MaximumSegmentSize(u16::try_from(full).unwrap_or(u16::MAX));
        return vec![largest, SelectiveAcknowledgementPermitted, stamp, Noop, WindowScale(WINDOW_SHIFT)];
    }
    let mut options = vec![Noop, Noop, stamp];
    let mut ranges = segment.sacks.iter().map(|range| (range.from as u32, range.to as u32));
    if let Some(first) = ranges.next() {
        let rest = [ranges.next(), ranges.next(), ranges.next()];
        options.extend([Noop, Noop, SelectiveAcknowledgement(first, rest)]);
    }
    options
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use etherparse::SlicedPacket;

    use super::*;
    use crate::tcp::segment::Range;

    fn packet(v6: bool, body: Body) -> Packet {
        let (from, to) = (HostId(0), HostId(2));
        let at = |host: HostId, port| SocketAddr::new(if v6 { host.v6() } else { host.v4() }, port);
        Packet { from, to, src: at(from, 49_152), dst: at(to, 7400), ecn: Ecn::Experienced, body }
    }

    #[test]
    fn a_frame_is_as_long_as_the_model_says_and_its_checksums_hold() {
        let data = Bytes::from_static(b"four bytes and more");
        let sacks = vec![Range { from: 10, to: 20 }, Range { from: 30, to: 40 }];
        let ack = Some((1 << 32) + 5);
        let segments = [
            Segment { syn: true, window: 1 << 20, ..Segment::default() },
            Segment { seq: 1, ack, data: data.clone(), window: 1 << 20, ..Segment::default() },
            Segment { seq: 1, ack, sacks, ..Segment::default() },
            Segment { seq: 1, ack, rst: true, ..Segment::default() },
        ];
        let bodies = segments.map(Body::Tcp);
        for body in bodies.into_iter().chain([Body::Udp(data), Body::Udp(Bytes::new())]) {
            for v6 in [false, true] {
                let packet = packet(v6, body.clone());
                let frame = frame(&packet, 1500).unwrap();
                assert_eq!(frame.len() as u32, 14 + packet.ip_bytes(), "{packet:?}");
                let sliced = SlicedPacket::from_ethernet(&frame).unwrap();
                let Some(etherparse::NetSlice::Ipv4(ip)) = &sliced.net else { continue };
                let ip = ip.header();
                assert_eq!(ip.to_header().calc_header_checksum(), ip.header_checksum());
                let (from, to) = (ip.source(), ip.destination());
                match sliced.transport.unwrap() {
                    etherparse::TransportSlice::Tcp(tcp) => {
                        assert_eq!(tcp.calc_checksum_ipv4(from, to).unwrap(), tcp.checksum());
                    }
                    etherparse::TransportSlice::Udp(udp) => {
                        let sum = udp.to_header().calc_checksum_ipv4_raw(from, to, udp.payload()).unwrap();
                        assert_eq!(sum, udp.checksum());
                    }
                    other => unreachable!("{other:?}"),
                }
            }
        }
    }
}
