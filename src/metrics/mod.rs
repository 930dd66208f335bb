//! Traffic of links, for a monitoring system to read during a session: `/metrics` in the OpenMetrics text
//! format that Prometheus scrapes, `/links` the same as JSON, `/listener` the refusals of the process's
//! listener.

mod path;
mod server;
mod skipped;
mod turned_away;

use std::{fmt, sync::Arc};

use parking_lot::{RwLock, RwLockReadGuard};
use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric, text},
    metrics::{MetricType, counter::ConstCounter},
    registry::Registry,
};
use serde::{Deserialize, Serialize};
use trimaran_actors::Link;
use trimaran_transport::{LinkStats, ListenerStats, StatsHandle, Tally, Traffic};

pub use path::PathReading;
pub use server::{MetricsError, Serving};
pub use skipped::SkippedReading;
pub use turned_away::TurnedAwayReading;

/// The links of this process. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct LinkMetrics {
    watched: Arc<RwLock<Watched>>,
}

#[derive(Debug, Default)]
struct Watched {
    links: Vec<WatchedLink>,
    /// The listeners through which their peers came, each once.
    listeners: Vec<ListenerStats>,
}

#[derive(Debug)]
struct WatchedLink {
    peer: String,
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

    /// Watches a link to `peer` from now on, in place of an earlier one. Its counters start at zero, as a
    /// scraper expects of a restarted program.
    pub fn add(&self, peer: String, link: &Link) {
        self.watched.write().insert(peer, link.stats.clone());
    }

    /// Stops watching the link to `peer`.
    pub fn remove(&self, peer: &str) {
        self.watched.write().links.retain(|link| link.peer != peer);
    }

    /// Watches a link to one of many peers of a kind until the result is dropped. Its label has the lowest
    /// free number, such as `display 2`. So there are no more labels than links, and none holds a secret.
    #[must_use]
    pub fn watch(&self, kind: &str, link: &Link) -> Watching {
        Watching { peer: self.insert_numbered(kind, link.stats.clone()), metrics: self.clone() }
    }

    fn insert_numbered(&self, kind: &str, stats: StatsHandle) -> String {
        let mut watched = self.watched.write();
        let is_free = |peer: &String| watched.links.iter().all(|link| link.peer != *peer);
        let peer = (1..=u32::MAX).map(|number| format!("{kind} {number}")).find(is_free);
        let peer = peer.unwrap_or_else(|| kind.to_owned());
        watched.insert(peer.clone(), stats);
        peer
    }

    /// The traffic of each link until now.
    #[must_use]
    pub fn read(&self) -> Vec<LinkReading> {
        let read = |WatchedLink { peer, stats }: &WatchedLink| {
            let LinkStats { sent, received, floods, skipped, path, .. } = stats.read();
            LinkReading {
                peer: peer.clone(),
                sent: sent.into(),
                received: received.into(),
                floods,
                skipped: skipped.into(),
                path: path.map(PathReading::from),
            }
        };
        self.watched().links.iter().map(read).collect()
    }

    /// The refusals of the listeners through which the links' peers came.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAwayReading {
        TurnedAwayReading::of(&self.watched().listeners)
    }

    fn watched(&self) -> RwLockReadGuard<'_, Watched> {
        self.watched.read()
    }

    /// The OpenMetrics text.
    ///
    /// # Errors
    /// Never in practice: text is written to memory.
    fn text(&self) -> Result<String, fmt::Error> {
        let mut registry = Registry::with_prefix("trimaran_link");
        registry.register_collector(Box::new(self.clone()));
        let mut text = String::new();
        text::encode(&mut text, &registry)?;
        Ok(text)
    }
}

impl Watched {
    /// Replaces an earlier link to the same peer.
    fn insert(&mut self, peer: String, stats: StatsHandle) {
        self.links.retain(|link| link.peer != peer);
        if let Some(listener) = stats.listener().filter(|listener| !self.listeners.contains(listener)) {
            self.listeners.push(listener);
        }
        // Sorted by name.
        let place = self.links.partition_point(|link| link.peer < peer);
        self.links.insert(place, WatchedLink { peer, stats });
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
struct Peer {
    peer: String,
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
        let readings = self.read();
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
        skipped::encode(&readings, &mut encoder)?;
        self.turned_away().encode(&mut encoder)?;
        path::encode(&readings, &mut encoder)
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Identity, LodRule, Role, SceneHash, SessionKey, Settings, Viewport, Walkthrough};
    use trimaran_transport::{LinkConfig, Net, TokioNet, inproc};

    use super::*;

    /// However many displays come, one after the other.
    #[tokio::test]
    async fn labels_are_small_numbers_that_are_used_again_and_say_no_key() {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let metrics = LinkMetrics::default();
        let mut kept = Vec::new();
        for key in 0x1234_5678_9abc_def0..0x1234_5678_9abc_def0 + 40_u64 {
            let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap());
            let identity = |role| Identity {
                role,
                scene: Some(SceneHash(1).into()),
                session: (role == Role::Display).then_some((SessionKey(key), settings)),
            };
            let config = LinkConfig::default();
            let (culler, _display) =
                inproc::pair::<Walkthrough>(&net, identity(Role::Culler), identity(Role::Display), &config)
                    .unwrap();
            let watching = metrics.watch("display", &culler);
            assert!(["display 1", "display 2", "display 3"].contains(&watching.peer()), "{watching:?}");
            let text = metrics.text().unwrap();
            assert!(text.contains("peer=\"display 1\"") && !text.contains("9abcdef"), "{text}");
            kept.push(watching);
            // The oldest of three leaves.
            if kept.len() > 2 {
                kept.remove(0);
            }
            assert!(metrics.read().len() <= 2);
        }
        drop(kept);
        assert!(metrics.read().is_empty());
    }
}
