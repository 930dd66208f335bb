//! What each role can be told.

use std::{net::SocketAddr, path::PathBuf};

use confique::Config;
use serde::{Deserialize, Serialize};
use trimaran_proto::{IdCoding, OcclusionTestKind};
use trimaran_transport::{Endpoint, Endpoints};

use super::{ConfigError, RoleConfig, positive, seconds};

/// Which culler.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// Culls even frames and listens for the second.
    First,
    /// Culls odd frames and connects to the first.
    Second,
}

/// `trimaran role culler`: a culler.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct CullerConfig {
    /// The cooked scene; all three roles hold the same one. Paths in a file start at the file's folder.
    #[config(env = "TRIMARAN_SCENE", layer_attr(arg(long, value_name = "X.scene")))]
    pub scene: PathBuf,
    /// Which of the two machines this is: `first` culls even frames and listens for the second, `second`
    /// culls odd frames and connects to the first.
    #[config(env = "TRIMARAN_INDEX", layer_attr(arg(long, value_enum)))]
    pub index: Which,
    /// Where the display listens, such as `tcp://show:7400`.
    #[config(env = "TRIMARAN_DISPLAY", layer_attr(arg(long, value_name = "ENDPOINT")))]
    pub display: Endpoint,
    /// Where the cullers meet: the first listens there, the second connects to it. It need not
    /// be the transport that leads to the display.
    #[config(env = "TRIMARAN_PAIR", layer_attr(arg(long, value_name = "ENDPOINT")))]
    pub pair: Endpoint,
    /// The Vulkan device, by a part of its name; the best there is if not given.
    #[config(env = "TRIMARAN_DEVICE", layer_attr(arg(long, value_name = "NAME")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How long the device may make no progress before it counts as hung, seconds. The culler then ends with
    /// exit code 1, and its peers wait for it to come again.
    #[config(
        env = "TRIMARAN_DEVICE_TIMEOUT_S",
        default = 30.0,
        validate(device_timeout_s.is_finite() && *device_timeout_s > 0.0, "give seconds above 0"),
        layer_attr(arg(long = "device-timeout", value_name = "S", value_parser = positive))
    )]
    pub device_timeout_s: f64,
    /// How long to wait for the other roles at the start, seconds.
    #[config(
        env = "TRIMARAN_JOIN_TIMEOUT_S",
        default = 30.0,
        validate = seconds,
        layer_attr(arg(long = "join-timeout", value_name = "S"))
    )]
    pub join_timeout_s: f64,
    /// How long to wait for a peer that was lost to come again, seconds: the session then goes on with the
    /// frame that was due. 0 ends the session with the peer.
    #[config(
        env = "TRIMARAN_RECONNECT_S",
        default = 60.0,
        validate = seconds,
        layer_attr(arg(long = "reconnect", value_name = "S"))
    )]
    pub reconnect_s: f64,
    /// Show what the links carry on this address while the session runs: `/metrics` for Prometheus, `/links`
    /// as JSON.
    #[config(env = "TRIMARAN_METRICS", layer_attr(arg(long, value_name = "HOST:PORT")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<SocketAddr>,
    /// This machine's private keys, `NAME.key` of `trimaran keys new NAME`: for transports that encrypt.
    #[config(env = "TRIMARAN_KEYS", layer_attr(arg(long, value_name = "NAME.key")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keys: Option<PathBuf>,
    /// By what this machine knows the others: their public keys.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: CullerPeers,
}

/// By what a culler knows the others.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct CullerPeers {
    /// The display's public keys, `NAME.pub`.
    #[config(
        env = "TRIMARAN_PEERS_DISPLAY",
        layer_attr(arg(long = "peer-display", id = "peers_display", value_name = "NAME.pub"))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<PathBuf>,
    /// The other machine's public keys.
    #[config(env = "TRIMARAN_PEERS_OTHER", layer_attr(arg(long = "peer-other", value_name = "NAME.pub")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other: Option<PathBuf>,
}

/// `trimaran role display`: the machine that shows the pictures, holds the camera and dictates the session.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct DisplayConfig {
    /// The cooked scene. Paths in a file start at the file's folder.
    #[config(env = "TRIMARAN_SCENE", layer_attr(arg(long, value_name = "X.scene")))]
    pub scene: PathBuf,
    /// Where to listen, such as `tcp://0.0.0.0:7400` or `unix:/run/trimaran/display.sock`; a list where the
    /// cullers come over different transports.
    #[config(env = "TRIMARAN_LISTEN", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    pub listen: Endpoints,
    /// Where report and frames go.
    #[config(env = "TRIMARAN_OUT", layer_attr(arg(long, value_name = "DIR")))]
    pub out: PathBuf,
    /// Where to record what each frame asked of the roles, for `trimaran sim --trace`.
    #[config(env = "TRIMARAN_RECORD", layer_attr(arg(long, value_name = "X.trace")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record: Option<PathBuf>,
    /// The Vulkan device, by a part of its name; the best there is if not given.
    #[config(env = "TRIMARAN_DEVICE", layer_attr(arg(long, value_name = "NAME")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How long the device may make no progress before it counts as hung, seconds. The display then ends
    /// with exit code 3 and its report, and the cullers wait for it to come again.
    #[config(
        env = "TRIMARAN_DEVICE_TIMEOUT_S",
        default = 30.0,
        validate(device_timeout_s.is_finite() && *device_timeout_s > 0.0, "give seconds above 0"),
        layer_attr(arg(long = "device-timeout", value_name = "S", value_parser = positive))
    )]
    pub device_timeout_s: f64,
    /// How long to wait for the other roles at the start, seconds.
    #[config(
        env = "TRIMARAN_JOIN_TIMEOUT_S",
        default = 30.0,
        validate = seconds,
        layer_attr(arg(long = "join-timeout", value_name = "S"))
    )]
    pub join_timeout_s: f64,
    /// How long to wait for a peer that was lost to come again, seconds: the session then goes on with the
    /// frame that was due. 0 ends the session with the peer.
    #[config(
        env = "TRIMARAN_RECONNECT_S",
        default = 60.0,
        validate = seconds,
        layer_attr(arg(long = "reconnect", value_name = "S"))
    )]
    pub reconnect_s: f64,
    /// Show what the links carry on this address while the session runs: `/metrics` for Prometheus, `/links`
    /// as JSON.
    #[config(env = "TRIMARAN_METRICS", layer_attr(arg(long, value_name = "HOST:PORT")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<SocketAddr>,
    /// This machine's private keys, `NAME.key` of `trimaran keys new NAME`: for transports that encrypt.
    #[config(env = "TRIMARAN_KEYS", layer_attr(arg(long, value_name = "NAME.key")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keys: Option<PathBuf>,
    /// By what this machine knows the others: their public keys.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: DisplayPeers,
    /// What is walked and how.
    #[config(nested, layer_attr(command(flatten)))]
    pub session: SessionConfig,
}

/// By what the display knows the cullers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct DisplayPeers {
    /// The first machine's public keys, `NAME.pub`.
    #[config(env = "TRIMARAN_PEERS_FIRST", layer_attr(arg(long = "peer-first", value_name = "NAME.pub")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first: Option<PathBuf>,
    /// The second machine's public keys.
    #[config(env = "TRIMARAN_PEERS_SECOND", layer_attr(arg(long = "peer-second", value_name = "NAME.pub")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second: Option<PathBuf>,
}

/// What is walked and how.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct SessionConfig {
    /// Picture width, pixels.
    #[config(
        env = "TRIMARAN_SESSION_WIDTH",
        default = 1024,
        validate(*width > 0, "a picture has at least one pixel a side"),
        layer_attr(arg(long, value_name = "PX"))
    )]
    pub width: u32,
    /// Picture height, pixels.
    #[config(
        env = "TRIMARAN_SESSION_HEIGHT",
        default = 1024,
        validate(*height > 0, "a picture has at least one pixel a side"),
        layer_attr(arg(long, value_name = "PX"))
    )]
    pub height: u32,
    /// The largest error on the screen, pixels.
    #[config(
        env = "TRIMARAN_SESSION_EPSILON_PX",
        default = 2.0,
        validate(epsilon_px.is_finite() && *epsilon_px > 0.0, "give a number of pixels above 0"),
        layer_attr(arg(
            long = "epsilon",
            value_name = "PX",
            value_parser = positive,
            allow_negative_numbers = true
        ))
    )]
    pub epsilon_px: f64,
    /// How many ids travel in one batch, 1 to 16384.
    #[config(
        env = "TRIMARAN_SESSION_BATCH",
        default = 1024,
        validate((1..=16384).contains(batch), "give 1 to 16384"),
        layer_attr(arg(long, value_name = "B", value_parser = clap::value_parser!(u16).range(1..=16384)))
    )]
    pub batch: u16,
    /// How ids travel between processes: `changes` against an earlier frame, or `plain`, 4 bytes each.
    #[config(
        env = "TRIMARAN_SESSION_CODING",
        default = "changes",
        validate(coding.parse::<IdCoding>().is_ok(), "give changes or plain"),
        layer_attr(arg(long, value_name = "CODING"))
    )]
    pub coding: String,
    /// What tests boxes: `query`, `raster` or `hzb`.
    #[config(
        env = "TRIMARAN_SESSION_OCCLUSION_TEST",
        default = "hzb",
        validate(occlusion_test.parse::<OcclusionTestKind>().is_ok(), "give query, raster or hzb"),
        layer_attr(arg(long, value_name = "TEST"))
    )]
    pub occlusion_test: String,
    /// Walk by the clock, so many poses of the path a second; without it every pose is a frame.
    #[config(
        env = "TRIMARAN_SESSION_LIVE_HZ",
        validate(live_hz.is_finite() && *live_hz > 0.0, "give poses a second above 0, or leave it out"),
        layer_attr(arg(
            long = "live",
            value_name = "HZ",
            value_parser = positive,
            allow_negative_numbers = true
        ))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub live_hz: Option<f64>,
    /// Whether culling stops at what shows at fewer pixels than epsilon (paper, section 4.5.2); not with the
    /// occlusion test `hzb`.
    #[config(
        env = "TRIMARAN_SESSION_FEW_PIXELS",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub few_pixels: bool,
    /// How many frames; as many as the path has if not given, 200 for an automatic one.
    #[config(
        env = "TRIMARAN_SESSION_FRAMES",
        validate(*frames > 0, "give at least 1, or leave it out"),
        layer_attr(arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..)))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// `auto`, a path file or a report.json, relative to the working directory.
    #[config(
        env = "TRIMARAN_SESSION_PATH",
        default = "auto",
        layer_attr(arg(long, value_name = "FILE|auto"))
    )]
    pub path: String,
    /// The seed of an automatic path.
    #[config(env = "TRIMARAN_SESSION_SEED", default = 1, layer_attr(arg(long)))]
    pub seed: u64,
    /// Every how many frames the report checks one against the truth; 0 checks none.
    #[config(env = "TRIMARAN_SESSION_AUDIT_EVERY", default = 10, layer_attr(arg(long, value_name = "N")))]
    pub audit_every: u32,
    /// Whether the report names the objects exactly visible at full detail.
    #[config(
        env = "TRIMARAN_SESSION_VISIBLE",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub visible: bool,
}

impl RoleConfig for CullerConfig {
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf> {
        let peers = &mut layer.peers;
        [&mut layer.scene, &mut layer.keys, &mut peers.display, &mut peers.other].into_iter().flatten()
    }

    fn check(&self) -> Result<(), ConfigError> {
        Ok(())
    }
}

impl RoleConfig for DisplayConfig {
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf> {
        let peers = &mut layer.peers;
        let own = [&mut layer.scene, &mut layer.out, &mut layer.record, &mut layer.keys];
        own.into_iter().chain([&mut peers.first, &mut peers.second]).flatten()
    }

    fn check(&self) -> Result<(), ConfigError> {
        if self.session.few_pixels && self.session.occlusion_test == "hzb" {
            let why = "it needs the occlusion test query or raster";
            return Err(ConfigError::Value { key: "session.few_pixels", why });
        }
        Ok(())
    }
}
