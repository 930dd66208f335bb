//! The parameters of a simulation.

use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use trimaran_actors::Schedule;
use trimaran_netsim::Profile;
use trimaran_proto::{BatchSize, IdCoding};
use trimaran_scene::Scene;

use super::workload::Workload;

/// The parameters of a simulation.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The network.
    pub network: Profile,
    /// The transport of the links.
    pub link: Transport,
    /// How many cullers; without any the display culls for itself.
    pub cullers: usize,
    /// The visible set from which they draw their occluders.
    pub schedule: Schedule,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// How many frames are shown.
    pub frames: u32,
    /// The seed of losses and delays.
    pub seed: u64,
    /// The work of each frame.
    pub workload: Workload,
    /// The source of the display's geometry; none for a display that has the scene.
    pub geometry: Option<Geometry>,
    /// Further settings.
    pub knobs: Knobs,
}

/// The geometry for a display without the scene: packing and unpacking take no time.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// The scene that the cullers hold: that of the workload's trace.
    pub scene: Arc<Scene>,
    /// How many bytes of it the display keeps, packed.
    pub cache: u64,
}

impl Scenario {
    /// Whether a frame's deadline ends before the frame's end can reach the display.
    #[must_use]
    pub fn gives_up_everything(&self) -> bool {
        // The one-way delay excludes the packet's bits, so an equal deadline is over before they have come.
        self.link == Transport::UdpDeadline && self.knobs.deadline <= self.network.one_way_delay()
    }
}

/// Settings of links in a simulation, beside the transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Knobs {
    /// How ids travel. Default plain, as the formulas count them.
    pub coding: IdCoding,
    /// For `udp` with deadlines: how long after its end a frame may arrive. Default 50 ms.
    pub deadline: Duration,
    /// For `udp`: how many bytes of repair may be sent while packets are lost, percent of the frames' own.
    /// Default 15.
    pub repair_percent: u8,
    /// For `udp`: nothing is encrypted, so that a capture is readable. Default no.
    pub in_the_clear: bool,
}

impl Default for Knobs {
    fn default() -> Self {
        Self {
            coding: IdCoding::Plain,
            deadline: Duration::from_millis(50),
            repair_percent: 15,
            in_the_clear: false,
        }
    }
}

/// The transport between machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Transport {
    /// TCP, as in the paper: one connection per lane.
    Tcp,
    /// The same in WebSockets, as pages in browsers open them.
    Ws,
    /// One QUIC connection per link.
    Quic,
    /// The project's own connection over datagrams: every frame arrives whole.
    Udp,
    /// The same with deadlines: late parts of a frame are given up, and the display makes up for them.
    UdpDeadline,
}

impl Transport {
    /// The name in flags and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::Ws => "ws",
            Self::Quic => "quic",
            Self::Udp => "udp",
            Self::UdpDeadline => "udp-deadline",
        }
    }

    /// The endpoint of `address`, a host with its port.
    pub(super) fn endpoint(self, address: &str) -> String {
        match self {
            Self::Tcp => format!("tcp://{address}"),
            Self::Ws => format!("ws://{address}"),
            Self::Quic => format!("quic://{address}"),
            Self::Udp => format!("udp://{address}"),
            Self::UdpDeadline => format!("udp://{address}?mode=deadline"),
        }
    }
}
