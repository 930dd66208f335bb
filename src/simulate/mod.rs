//! A session of the three roles on a simulated network: the roles' state machines, the links and the transports are the real
//! ones; their computing takes as long as a recorded walk or a stated model says, and the network is a [`Profile`].
//!
//! Ten thousand frames take seconds, and the same seed gives the same frames.

mod outcome;
mod roles;
mod session;
mod workload;

pub use outcome::{FrameBytes, FrameTimes, Outcome, Percentiles};
pub use session::{RoleFailure, SimulateError, simulate};
pub use workload::{Load, Workload, WorkloadError};

use serde::Serialize;
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

/// What is simulated.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The network.
    pub network: Profile,
    /// What the roles are joined by.
    pub link: Transport,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// How many frames are shown.
    pub frames: u32,
    /// The seed of losses and delays.
    pub seed: u64,
    /// What each frame takes.
    pub workload: Workload,
}

/// What joins machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Transport {
    /// Two TCP connections a link, as in the paper.
    Tcp,
    /// A QUIC connection a link.
    Quic,
    /// The project's own connection over datagrams.
    Udp,
}

impl Transport {
    /// Its name in endpoints.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::Quic => "quic",
            Self::Udp => "udp",
        }
    }
}
