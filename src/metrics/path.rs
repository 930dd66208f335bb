//! Packets and their path.

use std::fmt;

use prometheus_client::{
    encoding::{DescriptorEncoder, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter, gauge::ConstGauge},
};
use serde::{Deserialize, Serialize};
use trimaran_transport::PathStats;

use super::links::{LinkReading, Peer};

/// Packets since the link was made, and the current path, as seen from this side.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PathReading {
    /// Packets sent.
    pub packets_sent: u64,
    /// Their bytes, without the headers of UDP and IP.
    pub packet_bytes_sent: u64,
    /// Packets received.
    pub packets_received: u64,
    /// Their bytes.
    pub packet_bytes_received: u64,
    /// Packets sent and found lost.
    pub packets_lost: u64,
    /// Parts of frames sent again.
    pub parts_repeated: u64,
    /// Repair shards sent.
    pub repair_sent: u64,
    /// Received frames that are whole only thanks to repair shards.
    pub frames_repaired: u64,
    /// Frames sent that were given up because they could not arrive in time.
    pub frames_given_up: u64,
    /// Probes sent because nothing was acknowledged.
    pub probes: u64,
    /// The largest datagram known to arrive, bytes.
    pub path_mtu: u64,
    /// The smoothed round-trip time, milliseconds.
    pub round_trip_ms: f64,
    /// The congestion window, bytes.
    pub window_bytes: u64,
    /// Bytes in flight.
    pub in_flight_bytes: u64,
    /// The deadline of frames is shorter than the one-way delay: hardly any arrives whole.
    pub deadline_too_short: bool,
}

impl PathReading {
    /// Its counts, without the state of the path.
    pub(super) fn counts(self) -> Self {
        Self {
            path_mtu: 0,
            round_trip_ms: 0.0,
            window_bytes: 0,
            in_flight_bytes: 0,
            deadline_too_short: false,
            ..self
        }
    }

    /// Both as one: the sums of counts and of windows, the longest way and the smallest datagram.
    pub(super) fn joined(self, other: Self) -> Self {
        let mtu = [self.path_mtu, other.path_mtu].into_iter().filter(|mtu| *mtu > 0).min();
        Self {
            packets_sent: self.packets_sent + other.packets_sent,
            packet_bytes_sent: self.packet_bytes_sent + other.packet_bytes_sent,
            packets_received: self.packets_received + other.packets_received,
            packet_bytes_received: self.packet_bytes_received + other.packet_bytes_received,
            packets_lost: self.packets_lost + other.packets_lost,
            parts_repeated: self.parts_repeated + other.parts_repeated,
            repair_sent: self.repair_sent + other.repair_sent,
            frames_repaired: self.frames_repaired + other.frames_repaired,
            frames_given_up: self.frames_given_up + other.frames_given_up,
            probes: self.probes + other.probes,
            path_mtu: mtu.unwrap_or(0),
            round_trip_ms: self.round_trip_ms.max(other.round_trip_ms),
            window_bytes: self.window_bytes + other.window_bytes,
            in_flight_bytes: self.in_flight_bytes + other.in_flight_bytes,
            deadline_too_short: self.deadline_too_short || other.deadline_too_short,
        }
    }
}

impl From<PathStats> for PathReading {
    fn from(path: PathStats) -> Self {
        Self {
            packets_sent: path.sent,
            packet_bytes_sent: path.sent_bytes,
            packets_received: path.received,
            packet_bytes_received: path.received_bytes,
            packets_lost: path.lost,
            parts_repeated: path.repeated,
            repair_sent: path.repair_sent,
            frames_repaired: path.frames_repaired,
            frames_given_up: path.frames_given_up,
            probes: path.probes,
            path_mtu: path.datagram_size as u64,
            round_trip_ms: path.round_trip.as_secs_f64() * 1e3,
            window_bytes: path.window as u64,
            in_flight_bytes: path.in_flight as u64,
            deadline_too_short: path.deadline_too_short,
        }
    }
}

/// Writes the families of all links that have a path.
pub(super) fn encode(links: &[LinkReading], encoder: &mut DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
    let paths: Vec<(Peer, &PathReading)> = links
        .iter()
        .filter_map(|link| Some((Peer { peer: link.peer.clone() }, link.path.as_ref()?)))
        .collect();
    if paths.is_empty() {
        return Ok(());
    }
    type Count = fn(&PathReading) -> u64;
    let counts: [(&str, &str, Count); 10] = [
        ("packets_sent", "Packets sent", |path| path.packets_sent),
        ("packet_bytes_sent", "Bytes of packets sent", |path| path.packet_bytes_sent),
        ("packets_received", "Packets received", |path| path.packets_received),
        ("packet_bytes_received", "Bytes of packets received", |path| path.packet_bytes_received),
        ("packets_lost", "Packets sent and found lost", |path| path.packets_lost),
        ("parts_repeated", "Parts of frames sent again", |path| path.parts_repeated),
        ("repair_sent", "Repair shards sent", |path| path.repair_sent),
        ("frames_repaired", "Received frames that repair made whole", |path| path.frames_repaired),
        ("frames_given_up", "Frames sent that were given up", |path| path.frames_given_up),
        ("probes", "Probes sent because nothing was acknowledged", |path| path.probes),
    ];
    for (name, help, count) in counts {
        let mut family = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
        for (peer, path) in &paths {
            ConstCounter::new(count(path)).encode(family.encode_family(peer)?)?;
        }
    }
    type Level = fn(&PathReading) -> f64;
    let levels: [(&str, &str, Level); 5] = [
        ("path_mtu_bytes", "Largest datagram known to arrive, the smallest of all links", |path| {
            path.path_mtu as f64
        }),
        ("round_trip_seconds", "Smoothed round-trip time, the longest of all links", |path| {
            path.round_trip_ms / 1e3
        }),
        ("window_bytes", "Congestion window", |path| path.window_bytes as f64),
        ("in_flight_bytes", "Bytes in flight", |path| path.in_flight_bytes as f64),
        ("deadline_too_short", "1 where frames sent have no more time than the way takes", |path| {
            path.deadline_too_short.into()
        }),
    ];
    for (name, help, level) in levels {
        let mut family = encoder.encode_descriptor(name, help, None, MetricType::Gauge)?;
        for (peer, path) in &paths {
            ConstGauge::new(level(path)).encode(family.encode_family(peer)?)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use prometheus_client::{collector::Collector, encoding::text, registry::Registry};

    use super::*;

    #[derive(Debug)]
    struct Readings(Vec<LinkReading>);

    impl Collector for Readings {
        fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
            encode(&self.0, &mut encoder)
        }
    }

    fn text_of(path: Option<PathReading>) -> String {
        let link = LinkReading { peer: "display".to_owned(), path, ..LinkReading::default() };
        let mut registry = Registry::with_prefix("trimaran_link");
        registry.register_collector(Box::new(Readings(vec![link])));
        let mut text = String::new();
        text::encode(&mut text, &registry).unwrap();
        text
    }

    #[test]
    fn packets_are_counters_and_the_path_is_gauges() {
        let path = PathReading {
            packets_lost: 7,
            round_trip_ms: 12.5,
            path_mtu: 1452,
            deadline_too_short: true,
            ..PathReading::default()
        };
        let text = text_of(Some(path));
        for line in [
            "# TYPE trimaran_link_packets_lost counter",
            "trimaran_link_packets_lost_total{peer=\"display\"} 7",
            "# TYPE trimaran_link_round_trip_seconds gauge",
            "trimaran_link_round_trip_seconds{peer=\"display\"} 0.0125",
            "trimaran_link_path_mtu_bytes{peer=\"display\"} 1452.0",
            "trimaran_link_deadline_too_short{peer=\"display\"} 1.0",
        ] {
            assert!(text.lines().any(|found| found == line), "no {line} in {text}");
        }
    }

    #[test]
    fn a_transport_that_counts_no_packets_shows_none() {
        assert_eq!(text_of(None), "# EOF\n");
    }
}
