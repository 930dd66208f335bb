//! The traffic of links: of each one, and the sums that a monitoring system reads.

use std::{collections::BTreeMap, fmt, sync::Arc};

use parking_lot::RwLock;
use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter, gauge::ConstGauge},
};
use serde::{Deserialize, Serialize};
use trimaran_actors::Link;
use trimaran_transport::{LinkStats, ListenerStats, StatsHandle, Tally, Traffic};

use super::{PathReading, SkippedReading, TurnedAwayReading, path, skipped};

/// The links of this process. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct LinkMetrics {
    watched: Arc<RwLock<Watched>>,
}

#[derive(Debug, Default)]
struct Watched {
    links: Vec<WatchedLink>,
    /// The traffic of links that have ended, by their peers' label.
    ended: BTreeMap<String, LinkReading>,
    /// The listeners through which their peers came, each once.
    listeners: Vec<ListenerStats>,
}

#[derive(Debug)]
struct WatchedLink {
    /// The peer, of which there is one.
    peer: String,
    /// The label of all peers of its kind. Peers of a listener are too many for labels of their own.
    label: String,
    stats: StatsHandle,
}

/// The traffic of a link since it was made.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LinkReading {
    /// The role at its other end.
    pub peer: String,
    /// This side's sent traffic.
    pub sent: Carried,
    /// This side's received traffic.
    pub received: Carried,
    /// How often it sent more messages in a second than allowed.
    #[serde(default)]
    pub floods: u64,
    /// Frames that came and were not returned to their reader.
    #[serde(default)]
    pub skipped: SkippedReading,
    /// Packets and their path, over this program's own datagram protocol.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathReading>,
}

/// Messages and bytes in one direction.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Carried {
    /// Frames that have ended.
    pub frames: u64,
    /// Ids of drawables.
    pub ids: u64,
    /// Messages of all kinds.
    pub messages: u64,
    /// Payload bytes of cameras.
    pub camera_bytes: u64,
    /// Payload bytes of frame beginnings.
    pub begin_bytes: u64,
    /// Payload bytes of ids.
    pub id_bytes: u64,
    /// Payload bytes of frame ends.
    pub end_bytes: u64,
    /// Payload bytes of handshake, statistics and close.
    pub control_bytes: u64,
    /// Geometry for a display without the scene, and the display's messages about it.
    pub geometry_bytes: u64,
    /// Bytes of this protocol's headers; those of lower layers are not known here.
    pub header_bytes: u64,
}

impl LinkMetrics {
    /// Watches these links.
    #[must_use]
    pub fn of<'l>(links: impl IntoIterator<Item = &'l Link>) -> Self {
        let metrics = Self::default();
        links.into_iter().for_each(|link| metrics.add(link.peer.hello.role.to_string(), link));
        metrics
    }

    /// Watches a link to `peer` from now on, in place of an earlier one. The peer is a label of the sums: give
    /// those of a configuration, which do not change.
    pub fn add(&self, peer: String, link: &Link) {
        self.watched.write().insert(peer.clone(), peer, link.stats.clone());
    }

    /// Stops watching the link to `peer`. Its traffic stays in the sums.
    pub fn remove(&self, peer: &str) {
        self.watched.write().remove(peer);
    }

    /// Watches a link to one of many peers of a kind until the result is dropped. The peer gets the lowest
    /// free number, such as `display 2`, and the kind is its label in the sums. So there are no more labels
    /// than kinds, and none holds a secret.
    #[must_use]
    pub fn watch(&self, kind: &str, link: &Link) -> Watching {
        let mut watched = self.watched.write();
        let is_free = |peer: &String| watched.links.iter().all(|link| link.peer != *peer);
        let peer = (1..=u32::MAX).map(|number| format!("{kind} {number}")).find(is_free);
        let peer = peer.unwrap_or_else(|| kind.to_owned());
        watched.insert(peer.clone(), kind.to_owned(), link.stats.clone());
        Watching { peer, metrics: self.clone() }
    }

    /// Counts the refusals of this listener as well.
    pub fn listens(&self, listener: ListenerStats) {
        self.watched.write().listens(listener);
    }

    /// The traffic of each link that is there, since it was made.
    #[must_use]
    pub fn read(&self) -> Vec<LinkReading> {
        self.watched.read().links.iter().map(WatchedLink::read).collect()
    }

    /// The traffic of all links since the start, those that have ended among them: the sum of each label.
    #[must_use]
    pub fn sums(&self) -> Vec<LinkReading> {
        let watched = self.watched.read();
        let mut sums = watched.ended.clone();
        for link in &watched.links {
            sum(&mut sums, &link.label, &link.read());
        }
        sums.into_values().collect()
    }

    /// How many links of each label are there, those of which all have ended among them.
    fn present(&self) -> BTreeMap<String, u64> {
        let watched = self.watched.read();
        let mut present: BTreeMap<_, _> = watched.ended.keys().map(|label| (label.clone(), 0)).collect();
        for link in &watched.links {
            *present.entry(link.label.clone()).or_default() += 1;
        }
        present
    }

    /// The refusals of the process's listeners.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAwayReading {
        TurnedAwayReading::of(&self.watched.read().listeners)
    }
}

/// Adds a reading to the sum of its label.
fn sum(sums: &mut BTreeMap<String, LinkReading>, label: &str, reading: &LinkReading) {
    let of_label = || LinkReading { peer: label.to_owned(), ..LinkReading::default() };
    sums.entry(label.to_owned()).or_insert_with(of_label).add(reading);
}

impl WatchedLink {
    fn read(&self) -> LinkReading {
        let LinkStats { sent, received, floods, skipped, path, .. } = self.stats.read();
        LinkReading {
            peer: self.peer.clone(),
            sent: sent.into(),
            received: received.into(),
            floods,
            skipped: skipped.into(),
            path: path.map(PathReading::from),
        }
    }
}

impl Watched {
    /// Replaces an earlier link to the same peer.
    fn insert(&mut self, peer: String, label: String, stats: StatsHandle) {
        self.remove(&peer);
        if let Some(listener) = stats.listener() {
            self.listens(listener);
        }
        // Sorted by name.
        let place = self.links.partition_point(|link| link.peer < peer);
        self.links.insert(place, WatchedLink { peer, label, stats });
    }

    fn remove(&mut self, peer: &str) {
        let Some(place) = self.links.iter().position(|link| link.peer == peer) else { return };
        let link = self.links.remove(place);
        // A path has ended with its link; only what it has counted stays.
        let reading = link.read();
        let path = reading.path.map(PathReading::counts);
        sum(&mut self.ended, &link.label, &LinkReading { path, ..reading });
    }

    fn listens(&mut self, listener: ListenerStats) {
        if !self.listeners.contains(&listener) {
            self.listeners.push(listener);
        }
    }
}

impl LinkReading {
    /// Adds the traffic of another link.
    fn add(&mut self, other: &Self) {
        self.sent.add(&other.sent);
        self.received.add(&other.received);
        self.floods += other.floods;
        self.skipped.add(other.skipped);
        self.path = match (self.path, other.path) {
            (Some(path), Some(other)) => Some(path.joined(other)),
            (path, other) => path.or(other),
        };
    }
}

/// A link that is watched until this is dropped.
#[derive(Debug)]
pub struct Watching {
    metrics: LinkMetrics,
    peer: String,
}

impl Watching {
    /// The peer's label meanwhile.
    #[must_use]
    pub fn peer(&self) -> &str {
        &self.peer
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        self.metrics.remove(&self.peer);
    }
}

impl Carried {
    fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.ids += other.ids;
        self.messages += other.messages;
        self.camera_bytes += other.camera_bytes;
        self.begin_bytes += other.begin_bytes;
        self.id_bytes += other.id_bytes;
        self.end_bytes += other.end_bytes;
        self.control_bytes += other.control_bytes;
        self.geometry_bytes += other.geometry_bytes;
        self.header_bytes += other.header_bytes;
    }

    /// Bytes by kind.
    #[must_use]
    pub const fn bytes(&self) -> [(&'static str, u64); 7] {
        [
            ("camera", self.camera_bytes),
            ("begin", self.begin_bytes),
            ("ids", self.id_bytes),
            ("end", self.end_bytes),
            ("control", self.control_bytes),
            ("geometry", self.geometry_bytes),
            ("header", self.header_bytes),
        ]
    }

    /// Bytes of all kinds.
    #[must_use]
    pub fn total_bytes(&self) -> u64 {
        self.bytes().iter().map(|(_, bytes)| bytes).sum()
    }
}

impl From<Traffic> for Carried {
    fn from(traffic: Traffic) -> Self {
        let Traffic {
            latest, begin, batches, items, end, messages: said, bulk, control, header_bytes, ..
        } = traffic;
        let messages = [latest, begin, batches, end, said, bulk, control]
            .iter()
            .map(|tally: &Tally| tally.messages)
            .sum();
        Self {
            frames: end.messages,
            ids: items,
            messages,
            camera_bytes: latest.bytes,
            begin_bytes: begin.bytes,
            id_bytes: batches.bytes,
            end_bytes: end.bytes,
            // The roles' other messages are counted with it.
            control_bytes: control.bytes + said.bytes,
            geometry_bytes: bulk.bytes,
            header_bytes,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct Peer {
    pub(super) peer: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Way {
    peer: String,
    direction: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Kind {
    peer: String,
    direction: &'static str,
    kind: &'static str,
}

impl Collector for LinkMetrics {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let readings = self.sums();
        let ways: Vec<(Way, &Carried)> = readings
            .iter()
            .flat_map(|LinkReading { peer, sent, received, .. }| {
                [("sent", sent), ("received", received)]
                    .map(|(direction, carried)| (Way { peer: peer.clone(), direction }, carried))
            })
            .collect();
        type Count = fn(&Carried) -> u64;
        let counts: [(&str, &str, Count); 3] = [
            ("frames", "Frames that have ended", |carried| carried.frames),
            ("ids", "Ids of drawables", |carried| carried.ids),
            ("messages", "Messages of all kinds", |carried| carried.messages),
        ];
        for (name, help, count) in counts {
            let mut family = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
            for (way, carried) in &ways {
                ConstCounter::new(count(carried)).encode(family.encode_family(way)?)?;
            }
        }
        let help = "Bytes of payload by kind of message, and of this protocol's headers";
        let mut family = encoder.encode_descriptor("bytes", help, None, MetricType::Counter)?;
        for (Way { peer, direction }, carried) in &ways {
            for (kind, bytes) in carried.bytes() {
                let labels = Kind { peer: peer.clone(), direction, kind };
                ConstCounter::new(bytes).encode(family.encode_family(&labels)?)?;
            }
        }
        let help = "Times that the peer sent more messages in a second than it may";
        let mut family = encoder.encode_descriptor("floods", help, None, MetricType::Counter)?;
        for LinkReading { peer, floods, .. } in &readings {
            ConstCounter::new(*floods).encode(family.encode_family(&Peer { peer: peer.clone() })?)?;
        }
        let help = "Links to these peers that are there";
        let mut family = encoder.encode_descriptor("up", help, None, MetricType::Gauge)?;
        for (peer, links) in self.present() {
            ConstGauge::new(links as f64).encode(family.encode_family(&Peer { peer })?)?;
        }
        skipped::encode(&readings, &mut encoder)?;
        self.turned_away().encode(&mut encoder)?;
        path::encode(&readings, &mut encoder)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use trimaran_proto::{
        Camera, DrawableId, FrameNumber, Identity, LodRule, Role, SceneHash, SessionKey, Settings, Viewport,
        Walkthrough,
    };
    use trimaran_transport::{FrameStart, LinkConfig, Net, TokioNet, inproc};

    use super::*;

    /// Links with the figures of packets. No link over memory has them.
    pub(in crate::metrics) fn of_a_path() -> LinkMetrics {
        let metrics = LinkMetrics::default();
        let path = Some(PathReading::default());
        let reading = LinkReading { peer: "culler 1".to_owned(), path, ..LinkReading::default() };
        metrics.watched.write().ended.insert("culler 1".to_owned(), reading);
        metrics
    }

    const DISPLAYS: u64 = 40;

    /// However many displays come, one after the other.
    #[tokio::test]
    async fn labels_are_kinds_and_what_has_left_stays_counted() {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let metrics = LinkMetrics::default();
        let mut kept = Vec::new();
        for key in 0x1234_5678_9abc_def0..0x1234_5678_9abc_def0 + DISPLAYS {
            let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap());
            let identity = |role| Identity {
                role,
                scene: Some(SceneHash(1).into()),
                session: (role == Role::Display).then_some((SessionKey(key), settings)),
            };
            let config = LinkConfig::default();
            let (culler, mut display) =
                inproc::pair::<Walkthrough>(&net, identity(Role::Culler), identity(Role::Display), &config)
                    .unwrap();
            let watching = metrics.watch("display", &culler);
            assert!(["display 1", "display 2", "display 3"].contains(&watching.peer()), "{watching:?}");
            let start = FrameStart { frame: FrameNumber(0), header: Camera::at_origin(FrameNumber(0)) };
            let mut culler = culler;
            culler.frames_tx.begin(start).await.unwrap();
            culler.frames_tx.push(&[DrawableId(7), DrawableId(8)]).await.unwrap();
            culler.frames_tx.finish().await.unwrap();
            assert_eq!(display.frames_rx.frame().await.unwrap().start.frame, FrameNumber(0));
            kept.push((watching, culler, display));
            // The oldest of three leaves.
            if kept.len() > 2 {
                kept.remove(0);
            }
            assert!(metrics.read().len() <= 2);
        }
        drop(kept);
        assert!(metrics.read().is_empty());
        assert_eq!(metrics.present(), BTreeMap::from([("display".to_owned(), 0)]));
        let [sum] = &metrics.sums()[..] else { panic!("{:?}", metrics.sums()) };
        assert_eq!((sum.peer.as_str(), sum.sent.frames, sum.sent.ids), ("display", DISPLAYS, 2 * DISPLAYS));
    }

    #[test]
    fn sums_have_counts_of_all_links_and_the_path_of_those_that_are_there() {
        let path = |packets_lost, round_trip_ms, path_mtu| PathReading {
            packets_lost,
            round_trip_ms,
            path_mtu,
            window_bytes: 1000,
            ..PathReading::default()
        };
        let mut sums = BTreeMap::new();
        let link = |path| LinkReading { floods: 1, path: Some(path), ..LinkReading::default() };
        sum(&mut sums, "display", &link(path(5, 900.0, 0).counts()));
        sum(&mut sums, "display", &link(path(1, 20.0, 1452)));
        sum(&mut sums, "display", &link(path(2, 10.0, 1200)));
        let sum = &sums["display"];
        let joined = sum.path.unwrap();
        assert_eq!((sum.floods, joined.packets_lost, joined.window_bytes), (3, 8, 2000));
        assert_eq!((joined.round_trip_ms, joined.path_mtu), (20.0, 1200));
    }
}
