//! Serving a scene to pages and displays.

use std::{net::SocketAddr, path::PathBuf};

use bytesize::ByteSize;
use clap::Args;
use trimaran::config::{memory, positive};
use trimaran_proto::Viewport;

#[cfg(feature = "window")]
use super::walks::{Size, size};
use super::{
    access::{AccessArgs, EmbeddingArgs},
    links::LinkFlags,
    scenes::ReadingArgs,
};

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// Where to listen for pages and for displays. Others than this machine's own reach it at an address of
    /// its network, such as 0.0.0.0:7480. It is not encrypted without --tls-cert.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7480", env = "TRIMARAN_LISTEN")]
    pub(crate) listen: SocketAddr,
    #[command(flatten)]
    pub(crate) access: AccessArgs,
    /// The folder of the notes that people write. It is made with the first note [default: that beside the
    /// scene, such as plant.notes].
    #[arg(long, value_name = "DIR", env = "TRIMARAN_NOTES")]
    pub(crate) notes: Option<PathBuf>,
    /// Show notes, and let nobody write any.
    #[arg(long, env = "TRIMARAN_READ_ONLY")]
    pub(crate) read_only: bool,
    #[command(flatten)]
    pub(crate) embedding: EmbeddingArgs,
    /// Show metrics on http://ADDRESS:PORT/metrics, and probes at /livez and /readyz.
    #[arg(long, value_name = "ADDRESS:PORT", env = "TRIMARAN_METRICS")]
    pub(crate) metrics: Option<SocketAddr>,
    #[command(flatten)]
    pub(crate) guests: GuestArgs,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) links: LinkFlags,
}

/// The limits for displays that come.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct GuestArgs {
    /// How many people may be there at once; more are told that it is full. A page with several cullers takes
    /// a place for each [default: 64].
    #[arg(long, value_name = "N", value_parser = people, env = "TRIMARAN_LIMITS_PEERS")]
    pub(crate) people: Option<usize>,
    /// The largest picture that a page or display may ask for: its width and its height.
    #[arg(long, value_name = "WxH", default_value = "4096x4096", env = "TRIMARAN_MAX_PICTURE")]
    pub(crate) max_picture: Viewport,
    /// The most memory for the depth of all of them together, such as 2GiB; a pixel takes 14 bytes [default:
    /// a quarter of the device's].
    #[arg(long, value_name = "SIZE", value_parser = memory, env = "TRIMARAN_DEPTH_MEMORY")]
    pub(crate) depth_memory: Option<ByteSize>,
}

fn people(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(people) if people > 0 => Ok(people),
        _ => Err("give a number above 0".to_owned()),
    }
}

/// Reading files and showing them to a browser of this machine.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// A cooked scene, or files of a model: glTF, AVEVA review (.rvm), OBJ, STL, PLY, STEP, IGES, IFC.
    /// Several make one model. With --window also the address that `trimaran serve` has printed elsewhere.
    #[arg(required = true, value_name = "FILES")]
    pub(crate) files: Vec<PathBuf>,
    /// Print the page's address, and leave opening it to you.
    #[arg(long)]
    pub(crate) no_browser: bool,
    /// Show it in a window of the system instead. Only in programs that were built with the feature `window`.
    #[arg(long, conflicts_with = "no_browser")]
    pub(crate) window: bool,
    /// The size of the window's picture at first.
    #[cfg(feature = "window")]
    #[arg(long, value_name = "WxH", requires = "window", default_value = "1280x720", value_parser = size)]
    pub(crate) size: Size,
    /// When a picture takes the place of the one in the window. `mailbox` follows the hand a little sooner
    /// than `fifo` and takes more power, and `immediate` may tear.
    #[cfg(feature = "window")]
    #[arg(long, value_name = "MODE", requires = "window", value_enum, default_value = "fifo")]
    pub(crate) present_mode: PresentModeArg,
    /// Let the page or the window walk along a camera path by itself, print how it fared, and end.
    #[arg(long, value_name = "PATH.json")]
    pub(crate) drive: Option<PathBuf>,
    /// A network that is simulated between the page and its culler on that walk: fast-ethernet, gigabit, 10g,
    /// wifi, lte, wan-20ms, wan-80ms, satellite.
    #[cfg(feature = "lab")]
    #[arg(
        long,
        value_name = "NAME",
        requires = "drive",
        conflicts_with = "window",
        hide_possible_values = true
    )]
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(trimaran_netsim::Profile::names()))]
    pub(crate) network: Option<String>,
    /// Print how it fared as JSON.
    #[arg(long, requires = "drive")]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) embedding: EmbeddingArgs,
    #[command(flatten)]
    pub(crate) guests: GuestArgs,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) reading: ReadingArgs,
}

/// The present modes of Vulkan that are of use.
#[cfg(feature = "window")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum PresentModeArg {
    Fifo,
    Mailbox,
    Immediate,
}

#[cfg(feature = "window")]
impl From<PresentModeArg> for trimaran_gpu::PresentMode {
    fn from(mode: PresentModeArg) -> Self {
        match mode {
            PresentModeArg::Fifo => Self::Fifo,
            PresentModeArg::Mailbox => Self::Mailbox,
            PresentModeArg::Immediate => Self::Immediate,
        }
    }
}

/// The device that culls.
#[derive(Debug, Args)]
pub(crate) struct DeviceArgs {
    /// The Vulkan device, as `trimaran doctor` prints it: a part of its name, its UUID, its PCI address or its
    /// number, such as '#1' [default: the one that CUDA_VISIBLE_DEVICES names, or else the best one].
    #[arg(long, value_name = "DEVICE", env = "TRIMARAN_DEVICE")]
    pub(crate) device: Option<String>,
    /// The most memory of the device for triangles, such as 2GiB [default: three quarters of what is free].
    #[arg(long, value_name = "SIZE", value_parser = memory, env = "TRIMARAN_GPU_MEMORY")]
    pub(crate) gpu_memory: Option<ByteSize>,
    /// The longest that the device may make no progress, seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        value_parser = positive,
        env = "TRIMARAN_DEVICE_TIMEOUT_S"
    )]
    pub(crate) device_timeout: f64,
    /// Cull on the device whatever its kind, and compare each frame with culling on the host. Slower; ends
    /// with an error at the first difference.
    #[arg(long, env = "TRIMARAN_CHECK_DEVICE")]
    pub(crate) check_device: bool,
}
