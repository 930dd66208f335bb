//! The fields of IP headers that a relay reads and writes.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use trimaran_netsim::link::Ecn;

/// The fields of an IP packet's header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    /// The packet's destination.
    pub(super) to: IpAddr,
    /// Its ECN field (RFC 3168, section 5).
    pub(super) ecn: Ecn,
}

impl Header {
    /// Reads the header; none if the packet is too short or of another protocol.
    pub(super) fn of(packet: &[u8]) -> Option<Self> {
        match packet.first()? >> 4 {
            4 => {
                let to: [u8; 4] = packet.get(16..20)?.try_into().ok()?;
                Some(Self { to: Ipv4Addr::from(to).into(), ecn: ecn(packet.get(1)? & 3) })
            }
            6 => {
                let to: [u8; 16] = packet.get(24..40)?.try_into().ok()?;
                Some(Self { to: Ipv6Addr::from(to).into(), ecn: ecn(packet.get(1)? >> 4 & 3) })
            }
            _ => None,
        }
    }
}

const fn ecn(bits: u8) -> Ecn {
    match bits {
        0 => Ecn::NotCapable,
        1 => Ecn::Capable1,
        2 => Ecn::Capable0,
        _ => Ecn::Experienced,
    }
}

/// Sets congestion experienced in a packet, and updates its header's checksum.
pub(super) fn mark_congested(packet: &mut [u8]) {
    match packet {
        [first, traffic, _, _, _, _, _, _, _, _, high, low, ..] if *first >> 4 == 4 => {
            let before = u16::from_be_bytes([*first, *traffic]);
            *traffic |= 3;
            let after = u16::from_be_bytes([*first, *traffic]);
            // RFC 1624: the new checksum from the old one and the word that changed, in ones' complement.
            let sum = u32::from(!u16::from_be_bytes([*high, *low])) + u32::from(!before) + u32::from(after);
            let folded = (sum & 0xffff) + (sum >> 16);
            let checksum = !(((folded & 0xffff) + (folded >> 16)) as u16);
            [*high, *low] = checksum.to_be_bytes();
        }
        [first, flow, ..] if *first >> 4 == 6 => *flow |= 0x30,
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An IPv4 header with a correct checksum.
    fn v4(traffic: u8) -> Vec<u8> {
        let mut header =
            vec![0x45, traffic, 0, 84, 0xbe, 0xef, 0x40, 0, 64, 17, 0, 0, 10, 0, 0, 1, 10, 0, 0, 3];
        let checksum = !sum(&header);
        header[10..12].copy_from_slice(&checksum.to_be_bytes());
        header
    }

    /// The sum of all words in ones' complement: all ones if the checksum is correct.
    fn sum(header: &[u8]) -> u16 {
        let mut sum: u32 =
            header.chunks(2).map(|word| u32::from(u16::from_be_bytes([word[0], word[1]]))).sum();
        while sum > 0xffff {
            sum = (sum & 0xffff) + (sum >> 16);
        }
        sum as u16
    }

    fn v6(flow: u8) -> Vec<u8> {
        let mut header = vec![0; 40];
        (header[0], header[1], header[39]) = (0x60, flow, 2);
        header
    }

    #[test]
    fn destinations_and_marks_are_read_from_both_versions() {
        let to = IpAddr::from([10, 0, 0, 3]);
        for (traffic, ecn) in [
            (0b1011_1000, Ecn::NotCapable),
            (1, Ecn::Capable1),
            (2, Ecn::Capable0),
            (0b1011_1011, Ecn::Experienced),
        ] {
            assert_eq!(Header::of(&v4(traffic)), Some(Header { to, ecn }));
        }
        let to = IpAddr::from([0, 0, 0, 0, 0, 0, 0, 2_u16]);
        assert_eq!(Header::of(&v6(0x2f)), Some(Header { to, ecn: Ecn::Capable0 }));
    }

    #[test]
    fn what_is_no_ip_packet_has_no_header() {
        for packet in [&[][..], &[0x45], &v4(0)[..19], &v6(0)[..39], &[0x75; 60]] {
            assert_eq!(Header::of(packet), None, "{packet:?}");
        }
    }

    #[test]
    fn a_marked_packet_has_a_right_checksum_and_is_otherwise_the_same() {
        for traffic in 0..=255 {
            let before = v4(traffic);
            assert_eq!(sum(&before), 0xffff);
            let mut after = before.clone();
            mark_congested(&mut after);
            assert_eq!(sum(&after), 0xffff, "{traffic}");
            assert_eq!(Header::of(&after).map(|header| header.ecn), Some(Ecn::Experienced));
            assert_eq!((after[1] >> 2, &after[12..]), (traffic >> 2, &before[12..]));
        }
        let mut packet = v6(0x2f);
        mark_congested(&mut packet);
        assert_eq!(packet, v6(0x3f));
        mark_congested(&mut []);
    }
}
