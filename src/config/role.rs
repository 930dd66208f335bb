//! The keys of cullers and displays.

use std::path::PathBuf;

use bytesize::ByteSize;
use clap::ValueEnum;
use confique::Config;
use serde::{Deserialize, Serialize};
use trimaran_actors::{CullerId, Schedule};
use trimaran_proto::{IdCoding, OcclusionTestKind, Viewport};
use trimaran_transport::Endpoints;

use super::{CommonConfig, ConfigError, GpuConfig, RoleConfig, enough_memory, memory, positive};
use crate::culling::CullingMethod;

/// `trimaran role culler`: a culler, which serves displays as they come.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct CullerConfig {
    /// The cooked scene; cullers and display hold the same one. Paths in a file start at the file's folder.
    #[config(env = "TRIMARAN_SCENE", layer_attr(arg(long, value_name = "X.scene")))]
    pub scene: PathBuf,
    /// Where to listen for displays, such as `tcp://0.0.0.0:7400`; a list where they come over different
    /// transports. In the schedule `switch` the other culler comes there as well.
    #[config(env = "TRIMARAN_LISTEN", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub listen: Option<Endpoints>,
    /// Displays to connect to, where these listen: `tcp://show:7400`.
    #[config(env = "TRIMARAN_DISPLAYS", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub displays: Option<Endpoints>,
    /// Other cullers that a display may let this one meet, where these listen, for the schedule `switch`:
    /// `tcp://two:7400`, as the display's own configuration names them. It connects to no others.
    #[config(env = "TRIMARAN_CULLERS", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cullers: Option<Endpoints>,
    /// How to find what is visible: `trimaran`, or to compare with it `gigawalk`, `frustum`, `rays` or
    /// `exact`.
    #[config(
        env = "TRIMARAN_CULLING",
        default = "trimaran",
        layer_attr(arg(long, value_name = "METHOD", value_enum))
    )]
    pub culling: CullingMethod,
    /// The largest picture that a display may ask for, such as `4096x4096`: its width and its height.
    #[config(
        env = "TRIMARAN_MAX_PICTURE",
        default = "4096x4096",
        validate(max_picture.parse::<Viewport>().is_ok(), "give WIDTHxHEIGHT, such as 4096x4096"),
        layer_attr(arg(long = "max-picture", value_name = "WxH"))
    )]
    pub max_picture: String,
    /// The most memory for the depth of all displays together, such as `2GiB`. A pixel takes 14 bytes. A
    /// quarter of the device's memory if not given.
    #[config(
        env = "TRIMARAN_DEPTH_MEMORY",
        validate = enough_memory,
        layer_attr(arg(long = "depth-memory", value_name = "SIZE", value_parser = memory))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_memory: Option<ByteSize>,
    /// Whether the culler ends with its first display, as a job of a scheduler does: with exit code 0 if that
    /// has finished, and 1 if it was lost or has not come within `join_timeout_s`.
    #[config(
        env = "TRIMARAN_FOR_ONE_SESSION",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub for_one_session: bool,
    /// The graphics device.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub gpu: GpuConfig,
    /// Start, keys and metrics.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub common: CommonConfig,
    /// By what this machine knows the others: their public keys.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: CullerPeers,
}

/// By what a culler knows the others.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct CullerPeers {
    /// The displays' public keys, `NAME.pub`.
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
    /// The other cullers' public keys, for the schedule `switch`.
    #[config(
        env = "TRIMARAN_PEERS_CULLERS",
        parse_env = confique::env::parse::list_by_comma,
        default = [],
        layer_attr(arg(
            long = "peer-cullers",
            id = "peers_cullers",
            value_name = "NAME.pub,..",
            value_delimiter = ','
        ))
    )]
    pub cullers: Vec<PathBuf>,
}

/// `trimaran role display`: the machine that shows the pictures, holds the camera and dictates the session.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct DisplayConfig {
    /// The cooked scene. Paths in a file start at the file's folder. Without it the display begins empty, and
    /// its cullers send it what becomes visible.
    #[config(env = "TRIMARAN_SCENE", layer_attr(arg(long, value_name = "X.scene")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<PathBuf>,
    /// Whether the display begins empty though it has the scene, which is for audits alone then.
    #[config(
        env = "TRIMARAN_EMPTY_DISPLAY",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub empty_display: bool,
    /// The most memory for the geometry that cullers send to a display that began empty, packed. Geometry not
    /// shown for the longest time goes first, and is sent again where it is needed.
    #[config(
        env = "TRIMARAN_GEOMETRY_CACHE",
        default = "256MiB",
        validate = enough_memory,
        layer_attr(arg(long, value_name = "SIZE", value_parser = memory))
    )]
    pub geometry_cache: ByteSize,
    /// The picture of a display that began empty while some of a frame is still to come: `coarser` drawables
    /// in its place, or with `wait` none. It acts in a live session only: in lockstep the display always
    /// waits.
    #[config(
        env = "TRIMARAN_WHILE_LOADING",
        default = "coarser",
        layer_attr(arg(long, value_name = "WHAT", value_enum))
    )]
    pub while_loading: WhileLoading,
    /// Where the cullers listen, at most 8: `tcp://one:7400,tcp://two:7400`. Without any the display culls
    /// for itself.
    #[config(env = "TRIMARAN_CULLERS", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cullers: Option<Endpoints>,
    /// Where to listen for cullers that connect by themselves, such as `tcp://0.0.0.0:7400`.
    #[config(env = "TRIMARAN_LISTEN", layer_attr(arg(long, value_name = "ENDPOINT,..")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub listen: Option<Endpoints>,
    /// How many cullers to wait for at the start, up to `join_timeout_s`, those that connect by themselves among
    /// them. By default those that `cullers` names, and none in a live session.
    #[config(
        env = "TRIMARAN_AWAIT_CULLERS",
        validate(*await_cullers <= 8, "give a number up to 8"),
        layer_attr(arg(long = "await", value_name = "N", value_parser = clap::value_parser!(u8).range(..=8)))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub await_cullers: Option<u8>,
    /// How frames are dealt: `independent`, where no culler waits for another one, or the paper's `switch`,
    /// where each of two draws what the other one finds.
    #[config(
        env = "TRIMARAN_SCHEDULE",
        default = "independent",
        validate(schedule.parse::<Schedule>().is_ok(), "give independent or switch"),
        layer_attr(arg(long, value_name = "SCHEDULE"))
    )]
    pub schedule: String,
    /// Where report and frames go.
    #[config(env = "TRIMARAN_OUT", layer_attr(arg(long, value_name = "DIR")))]
    pub out: PathBuf,
    /// Whether a walk that was asked to stop, or whose disk was full, goes on with the next start, as one that
    /// was killed does: its records stay beside its report. A scheduler may then stop and start its job.
    #[config(
        env = "TRIMARAN_RESUMABLE",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub resumable: bool,
    /// Where to record what each frame asked of the roles, for `trimaran sim --trace`.
    #[config(env = "TRIMARAN_RECORD", layer_attr(arg(long, value_name = "X.trace")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record: Option<PathBuf>,
    /// The graphics device.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub gpu: GpuConfig,
    /// Start, keys and metrics.
    #[config(nested, layer_attr(command(flatten)))]
    #[serde(flatten)]
    pub common: CommonConfig,
    /// By what this machine knows the others: their public keys.
    #[config(nested, layer_attr(command(flatten)))]
    pub peers: DisplayPeers,
    /// The walk and its settings.
    #[config(nested, layer_attr(command(flatten)))]
    pub session: SessionConfig,
}

/// The picture of a live display that began empty while some of a frame is still to come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum WhileLoading {
    /// Coarser drawables in the place of what is still to come, which are sent first.
    #[default]
    Coarser,
    /// Nothing: it waits until all of the frame has come.
    Wait,
}

impl From<WhileLoading> for trimaran_actors::WhileLoading {
    fn from(told: WhileLoading) -> Self {
        match told {
            WhileLoading::Coarser => Self::Coarser,
            WhileLoading::Wait => Self::Wait,
        }
    }
}

/// By what the display knows the cullers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct DisplayPeers {
    /// The cullers' public keys, `NAME.pub`.
    #[config(
        env = "TRIMARAN_PEERS_CULLERS",
        parse_env = confique::env::parse::list_by_comma,
        default = [],
        layer_attr(arg(
            long = "peer-cullers",
            id = "peers_cullers",
            value_name = "NAME.pub,..",
            value_delimiter = ','
        ))
    )]
    pub cullers: Vec<PathBuf>,
}

/// The walk and its settings.
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
    /// The occlusion test: `query`, `raster` or `hzb`.
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
    /// A file of view states: what of the scene is seen, as it changes at frames.
    #[config(env = "TRIMARAN_SESSION_STATE", layer_attr(arg(long, value_name = "FILE")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<PathBuf>,
    /// Every how many frames the report checks one against the truth; 0 checks none. A program without the
    /// feature `lab` checks none.
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
        let known = [&mut peers.displays, &mut peers.cullers];
        let own = [&mut layer.scene, &mut layer.common.keys].into_iter().flatten();
        own.chain(known.into_iter().flatten().flatten())
    }

    fn check(&self) -> Result<(), ConfigError> {
        if self.listen.is_none() && self.displays.is_none() {
            let why = "say where to listen for displays, or in `displays` where these listen";
            return Err(ConfigError::Value { key: "listen", why });
        }
        Ok(())
    }
}

impl RoleConfig for DisplayConfig {
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf> {
        let session = &mut layer.session;
        let own =
            [&mut layer.scene, &mut layer.out, &mut layer.record, &mut layer.common.keys, &mut session.state];
        own.into_iter().flatten().chain(layer.peers.cullers.iter_mut().flatten())
    }

    fn check(&self) -> Result<(), ConfigError> {
        if self.session.few_pixels && self.session.occlusion_test == "hzb" {
            let why = "it needs the occlusion test query or raster";
            return Err(ConfigError::Value { key: "session.few_pixels", why });
        }
        let count = self.cullers.iter().flat_map(Endpoints::iter).count();
        if count > CullerId::MOST {
            return Err(ConfigError::Value { key: "cullers", why: "give at most 8" });
        }
        if self.scene.is_none() && count == 0 && self.listen.is_none() {
            let why = "without it say in `cullers` or `listen` who sends what becomes visible";
            return Err(ConfigError::Value { key: "scene", why });
        }
        if self.empty_display && count == 0 && self.listen.is_none() {
            let why = "say in `cullers` or `listen` who sends what becomes visible";
            return Err(ConfigError::Value { key: "empty_display", why });
        }
        if self.scene.is_none() && self.session.path == "auto" {
            let why = "an automatic path needs the scene: give a path file";
            return Err(ConfigError::Value { key: "session.path", why });
        }
        if self.scene.is_none() && self.session.state.is_some() {
            let why = "view states name objects, which only the scene knows: leave it out";
            return Err(ConfigError::Value { key: "session.state", why });
        }
        if self.scene.is_none() && self.resumable {
            let why = "a display without the scene always begins anew: leave it out";
            return Err(ConfigError::Value { key: "resumable", why });
        }
        if self.schedule == Schedule::Switch.name() && count != 2 {
            return Err(ConfigError::Value { key: "schedule", why: "`switch` takes two `cullers`" });
        }
        Ok(())
    }
}
