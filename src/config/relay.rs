//! The settings of a relay and of a display that watches.

use std::path::PathBuf;

use confique::Config;
use serde::Serialize;
use trimaran_transport::{Endpoints, Options, UdpMode};

use super::{CommonConfig, ConfigError, GpuConfig, RoleConfig};

/// `trimaran role relay`: passes the frames of one display on to many that watch.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct RelayConfig {
    /// The culler, or another relay, whose frames it passes on: `tcp://one:7400`.
    #[config(env = "TRIMARAN_UPSTREAM", layer_attr(arg(long, value_name = "ENDPOINT")))]
    pub upstream: Endpoints,
    /// Where to listen for displays and for other relays, such as `tcp://0.0.0.0:7400`; a list where they
    /// come over different transports. At most `limits.peers` of them come.
    #[config(env = "TRIMARAN_LISTEN", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    pub listen: Endpoints,
    /// Start, keys and metrics.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub common: CommonConfig,
    /// By what this machine knows the others: their public keys.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: RelayPeers,
}

/// By what a relay knows the others.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct RelayPeers {
    /// The public key of the culler or relay upstream, `NAME.pub`.
    #[config(
        env = "TRIMARAN_PEERS_UPSTREAM",
        parse_env = confique::env::parse::list_by_comma,
        default = [],
        layer_attr(arg(
            long = "peer-upstream",
            id = "peers_upstream",
            value_name = "NAME.pub,..",
            value_delimiter = ','
        ))
    )]
    pub upstream: Vec<PathBuf>,
    /// The public keys of displays and of relays downstream. Each of them may lead.
    #[config(
        env = "TRIMARAN_PEERS_DISPLAYS",
        parse_env = confique::env::parse::list_by_comma,
        default = [],
        layer_attr(arg(
            long = "peer-displays",
            id = "peers_displays",
            value_name = "NAME.pub,..",
            value_delimiter = ','
        ))
    )]
    pub displays: Vec<PathBuf>,
}

/// `trimaran role watcher`: a display that draws the frames of another one, which leads at the same relay.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct WatcherConfig {
    /// The cooked scene, the same as the culler's. Paths in a file start at the file's folder.
    #[config(env = "TRIMARAN_SCENE", layer_attr(arg(long, value_name = "X.scene")))]
    pub scene: PathBuf,
    /// Where the relay listens: `tcp://hall:7400`.
    #[config(env = "TRIMARAN_RELAY", layer_attr(arg(long, value_name = "ENDPOINT")))]
    pub relay: Endpoints,
    /// A file for the last picture, written when the watcher is stopped. Each picture is then read back.
    #[config(env = "TRIMARAN_PICTURE", layer_attr(arg(long, value_name = "X.png")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<PathBuf>,
    /// The graphics device.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub gpu: GpuConfig,
    /// Start, keys and metrics.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub common: CommonConfig,
    /// By what this machine knows the relay: its public key.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: WatcherPeers,
}

/// By what a watcher knows its relay.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct WatcherPeers {
    /// The relay's public key, `NAME.pub`.
    #[config(
        env = "TRIMARAN_PEERS_RELAY",
        parse_env = confique::env::parse::list_by_comma,
        default = [],
        layer_attr(arg(
            long = "peer-relay",
            id = "peers_relay",
            value_name = "NAME.pub,..",
            value_delimiter = ','
        ))
    )]
    pub relay: Vec<PathBuf>,
}

/// Checks that a key names one endpoint.
fn one(key: &'static str, endpoints: &Endpoints) -> Result<(), ConfigError> {
    match endpoints.iter().count() {
        1 => Ok(()),
        _ => Err(ConfigError::Value { key, why: "give one endpoint" }),
    }
}

impl RoleConfig for RelayConfig {
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf> {
        let peers = &mut layer.peers;
        let known = [&mut peers.upstream, &mut peers.displays];
        layer.common.keys.iter_mut().chain(known.into_iter().flatten().flatten())
    }

    fn check(&self) -> Result<(), ConfigError> {
        one("upstream", &self.upstream)
    }

    fn check_links(options: &Options) -> Result<(), ConfigError> {
        if options.udp.mode == UdpMode::Deadline {
            let why = "a relay passes on whole frames: leave it at reliable";
            return Err(ConfigError::Value { key: "udp.mode", why });
        }
        Ok(())
    }
}

impl RoleConfig for WatcherConfig {
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf> {
        let own = [&mut layer.scene, &mut layer.picture, &mut layer.common.keys];
        own.into_iter().flatten().chain(layer.peers.relay.iter_mut().flatten())
    }

    fn check(&self) -> Result<(), ConfigError> {
        one("relay", &self.relay)
    }
}
