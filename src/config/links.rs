//! How links are made: what every transport has in common, what each has of its own, and who is let in.

use std::{path::Path, time::Duration};

use confique::{Config, Layer};
use serde::Serialize;
use trimaran_proto::Role;
use trimaran_transport::{
    Endpoint, Endpoints, Limits, Options,
    keys::{Keys, KnownPeer, PublicKeys, Security},
};

use super::{ConfigError, seconds};

mod limits;
mod quic;
mod streams;
mod udp;

pub use limits::LimitsConfig;
pub use quic::QuicConfig;
pub use streams::{FileMode, FileModeError, TcpConfig, UnixConfig};
pub use udp::{FrameMode, RepairMode, UdpConfig, UdpCongestion, UdpTrust};

/// How links are made, whatever the role.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct LinkConfig {
    /// How long any one wait for a peer may last once it has joined, seconds: longer than its longest pause,
    /// loading included.
    #[config(
        env = "TRIMARAN_LINK_TIMEOUT_S",
        default = 30.0,
        validate = seconds,
        layer_attr(arg(
            long = "link-timeout",
            id = "link_timeout_s",
            value_name = "S",
            value_parser = pause,
            allow_negative_numbers = true
        ))
    )]
    pub timeout_s: f64,
    /// The silence after which a peer counts as lost, seconds: its process sends keep-alives while it has
    /// nothing to say. The same for all roles.
    #[config(
        env = "TRIMARAN_LINK_IDLE_TIMEOUT_S",
        default = 20.0,
        validate = idle_timeout,
        layer_attr(arg(
            long = "link-idle-timeout",
            value_name = "S",
            value_parser = idle_timeout_flag,
            allow_negative_numbers = true
        ))
    )]
    pub idle_timeout_s: f64,
    /// How long one handshake may take, seconds.
    #[config(
        env = "TRIMARAN_LINK_HANDSHAKE_S",
        default = 5.0,
        validate = seconds,
        layer_attr(arg(
            long = "link-handshake",
            value_name = "S",
            value_parser = pause,
            allow_negative_numbers = true
        ))
    )]
    pub handshake_s: f64,
    /// How many peers a listener has links with at once; more are told that it is busy.
    #[config(
        env = "TRIMARAN_LINK_PEERS",
        default = 16,
        layer_attr(arg(long = "link-peers", id = "link_peers", value_name = "N"))
    )]
    pub peers: usize,
    /// How many handshakes a listener has under way at once; one more takes the slot of the oldest.
    #[config(
        env = "TRIMARAN_LINK_HANDSHAKES",
        default = 64,
        layer_attr(arg(long = "link-handshakes", value_name = "N"))
    )]
    pub handshakes: usize,
    /// What others may ask for in a second.
    #[config(nested, layer_attr(command(flatten)))]
    pub limits: LimitsConfig,
    /// TCP.
    #[config(nested, layer_attr(command(flatten)))]
    pub tcp: TcpConfig,
    /// Unix sockets.
    #[config(nested, layer_attr(command(flatten)))]
    pub unix: UnixConfig,
    /// QUIC.
    #[config(nested, layer_attr(command(flatten)))]
    pub quic: QuicConfig,
    /// Datagrams of this program's own protocol.
    #[config(nested, layer_attr(command(flatten)))]
    pub udp: UdpConfig,
}

/// A peer's public keys, as a configuration names them.
#[derive(Debug, Clone, Copy)]
pub struct PeerFile<'p> {
    /// The key of the configuration.
    pub name: &'static str,
    /// The role that their holder may have; any if not given.
    pub role: Option<Role>,
    /// The file, where one is named.
    pub path: Option<&'p Path>,
}

/// An idle timeout that can be kept.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "as the derived code calls it")]
fn idle_timeout(seconds: &f64) -> Result<(), &'static str> {
    if (0.1..=86_400.0).contains(seconds) { Ok(()) } else { Err("give 0.1 to 86400 seconds") }
}

impl LinkConfig {
    /// By flags, the environment and the defaults, the first of these that says something.
    ///
    /// # Errors
    /// When a variable of the environment has a bad value.
    pub fn load(flags: <Self as Config>::Layer) -> Result<Self, ConfigError> {
        let environment =
            <Self as Config>::Layer::from_env().map_err(|cause| ConfigError::Environment { cause })?;
        let layers =
            flags.with_fallback(environment).with_fallback(<Self as Config>::Layer::default_values());
        Self::from_layer(layers).map_err(|cause| ConfigError::Missing { cause })
    }

    /// What the transports make of it, for a link that `security` guards.
    #[must_use]
    pub fn options(&self, security: Option<Security>) -> Options {
        Options {
            link: trimaran_transport::LinkConfig {
                timeout: duration(self.timeout_s),
                idle_timeout: duration(self.idle_timeout_s),
                messages_per_s: self.limits.messages_per_s,
                ..trimaran_transport::LinkConfig::default()
            },
            handshake: duration(self.handshake_s),
            limits: Limits {
                peers: self.peers,
                handshakes: self.handshakes,
                handshakes_per_s: self.limits.handshakes_per_s,
                handshakes_per_s_per_address: self.limits.handshakes_per_s_per_address,
            },
            security,
            tcp: self.tcp.options(),
            unix: self.unix.options(),
            quic: self.quic.options(),
            udp: self.udp.options(),
            transports: Vec::new(),
        }
    }

    /// Whether both sides prove who they are at `endpoint`.
    #[must_use]
    pub fn needs_keys(&self, endpoint: &Endpoint) -> bool {
        match endpoint {
            Endpoint::Udp(_) => self.udp.trust == UdpTrust::Keys,
            other => other.needs_keys(),
        }
    }

    /// What guards the links made at `endpoints`: this machine's `keys`, and the public ones of its `peers`,
    /// each for its role. None where no endpoint needs any.
    ///
    /// # Errors
    /// When a file that is needed is not named, or cannot be used.
    pub fn security(
        &self,
        endpoints: &Endpoints,
        keys: Option<&Path>,
        peers: &[PeerFile<'_>],
    ) -> Result<Option<Security>, ConfigError> {
        let Some(endpoint) = endpoints.iter().find(|endpoint| self.needs_keys(endpoint)) else {
            return Ok(None);
        };
        let no_keys = |peer| ConfigError::NoKeys { endpoint: endpoint.clone(), peer };
        // A display may have one machine that comes over another transport: so one peer is enough, but it
        // takes one.
        let known = peers
            .iter()
            .filter_map(|peer| peer.path.map(|path| (path, peer.role)))
            .map(|(path, role)| Ok(KnownPeer { keys: PublicKeys::read(path)?, role: role.map(Into::into) }))
            .collect::<Result<Vec<_>, ConfigError>>()?;
        match (keys, peers) {
            (Some(keys), _) if !known.is_empty() => {
                Ok(Some(Security { keys: Keys::read(keys)?, peers: known }))
            }
            (_, [peer, ..]) => Err(no_keys(peer.name)),
            (_, []) => Err(no_keys("peers")),
        }
    }
}

/// So many seconds; what is no time is none.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

/// A number of seconds, for a flag.
///
/// # Errors
/// Says what to give.
fn pause(text: &str) -> Result<f64, String> {
    checked(text, seconds)
}

/// An idle timeout, for a flag.
fn idle_timeout_flag(text: &str) -> Result<f64, String> {
    checked(text, idle_timeout)
}

/// A number that passes `check`.
fn checked(text: &str, check: fn(&f64) -> Result<(), &'static str>) -> Result<f64, String> {
    let number = text.parse::<f64>().map_err(|e| e.to_string())?;
    check(&number).map_err(str::to_owned)?;
    Ok(number)
}
