//! Options of a link over any transport.

use std::time::Duration;

use trimaran_wire::{BatchSize, Batching, IdleTimeout, WireVersions};

/// Options of a link over any transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct LinkConfig {
    /// How long a sender waits for a peer that lives and takes nothing: longer than the peer's longest pause
    /// in reading. A receiver waits for as long as its peer lives. Default 30 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "timeout_s", with = "trimaran_net::config::seconds"),
        schemars(with = "f64")
    )]
    pub timeout: Duration,
    /// The silence after which the peer counts as lost, on any transport: an idle peer sends keep-alives as
    /// long as its process runs. Time in which nobody waits for the peer does not count. Where the two sides
    /// differ, the shorter one holds for both. Default 20 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "idle_timeout_s", with = "crate::config::range::idle_timeout_s"),
        schemars(with = "f64")
    )]
    pub idle_timeout: Duration,
    /// How long one handshake may take, from the connection to the last answer. Default 5 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "handshake_timeout_s", with = "trimaran_net::config::seconds"),
        schemars(with = "f64")
    )]
    pub handshake_timeout: Duration,
    /// How items travel, if the peers' hellos do not decide it. Within one process they are not coded.
    /// Default batches of 256, plain.
    #[cfg_attr(feature = "config", serde(skip))]
    pub batching: Batching,
    /// How many items a frame may have at most, sent or received. A peer that sends more breaks the protocol,
    /// and is detected before room is made for them. Give what the application can have. Default 4,194,304.
    #[cfg_attr(feature = "config", serde(skip))]
    pub max_frame: u32,
    /// How many messages the peer may send in a second on the frames lane, measured over that many, and on
    /// the messages lane. A peer that sends more is a flood, and the lane fails. Of latest values only the
    /// newest is read anyway. Not within one process. Default 1,000,000.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::range::above_zero"))]
    pub messages_per_s: u32,
    /// The versions of the wire that this side speaks, among those that are
    /// [supported](WireVersions::SUPPORTED). A link has the highest that both sides speak. Default all.
    #[cfg_attr(feature = "config", serde(skip))]
    pub versions: WireVersions,
}

impl LinkConfig {
    trimaran_net::setters! {
        with_timeout timeout: Duration,
        with_idle_timeout idle_timeout: Duration,
        with_handshake_timeout handshake_timeout: Duration,
        with_batching batching: Batching,
        with_max_frame max_frame: u32,
        with_messages_per_s messages_per_s: u32,
        with_versions versions: WireVersions,
    }
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self {
            timeout: Duration::from_secs(30),
            idle_timeout: Duration::from_secs(20),
            handshake_timeout: Duration::from_secs(5),
            batching: Batching { size: BatchSize::default(), coded: false },
            max_frame: 1 << 22,
            messages_per_s: 1_000_000,
            versions: WireVersions::SUPPORTED,
        }
    }
}

impl LinkConfig {
    /// The idle timeout of a link with a peer that wants `theirs`.
    pub(crate) fn agreed(&self, theirs: IdleTimeout) -> Duration {
        IdleTimeout::from(self.idle_timeout).agreed(theirs)
    }
}
