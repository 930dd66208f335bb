//! Why a session cannot be simulated.

use thiserror::Error;
use trimaran_actors::SessionError;
use trimaran_netsim::{CaptureError, Stalled};
use trimaran_proto::{LodRuleError, SettingsError};
use trimaran_transport::keys::KeysError;
use trimaran_transport::{EndpointError, EndpointFault};

/// Why a session could not be simulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// No keys for the machines.
    #[error("no keys for the simulated machines")]
    Keys(#[from] KeysError),
    /// A machine's address or name cannot be written.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// A key has an invalid name.
    #[error(transparent)]
    Name(#[from] EndpointFault),
    /// The session's settings are invalid.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The rule for levels of detail is invalid.
    #[error(transparent)]
    Rule(#[from] LodRuleError),
    /// The schedule is invalid for this number of cullers.
    #[error("the schedule switch takes two cullers, not {0}")]
    Schedule(usize),
    /// A display without the scene has no culler to supply it.
    #[error("a display without the scene needs at least one culler, which sends it what it shows")]
    NoSupplier,
    /// A role ended early.
    #[error("the {role} failed on {network} over {link}")]
    Role {
        /// Its name.
        role: &'static str,
        /// The network's name.
        network: String,
        /// The link's name.
        link: &'static str,
        /// The cause.
        #[source]
        cause: Box<SessionError>,
    },
    /// The machines never got a link over this network.
    #[error(
        "nothing gets through {network} over {link}: look at its keys rate, loss, queue and mtu (quic and udp begin with packets of 1228 bytes)"
    )]
    NoLink {
        /// The network's name.
        network: String,
        /// The link's name.
        link: &'static str,
    },
    /// The packet capture cannot be written.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The roles wait for each other.
    #[error(transparent)]
    Stalled(#[from] Stalled),
}
