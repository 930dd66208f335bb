//! What the command line accepts. The help texts are the manual: each says what a thing is, its unit and its default.

use std::{net::SocketAddr, path::PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use confique::Config;
use trimaran::config::{DisplayConfig, LinkConfig, SwitchConfig, positive};
use trimaran_proto::IdCoding;
use trimaran_transport::Name;

use super::{netem::NetemArgs, ping::PingArgs, stat::StatArgs};

/// Walk through 3D models too large for one GPU.
///
/// Two machines take turns, one culling a frame with occlusion queries while the other draws the occluders of the next; a
/// third shows what is visible. A typical first hour:
///
///   trimaran doctor                               what this machine can do
///   trimaran demo                                 a walk through a generated plant
///   trimaran import plant/*.rvm -o plant.scene    your own model
///   trimaran run plant.scene --out walk           walk it; open walk/report.html
#[derive(Debug, Parser)]
#[command(
    name = "trimaran",
    version,
    verbatim_doc_comment,
    arg_required_else_help = true,
    max_term_width = 110
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Log more: -v what is done, -vv each frame, -vvv each message. `TRIMARAN_LOG` takes a tracing filter instead.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Read CAD files and cook them into one scene.
    Import(ImportArgs),
    /// Generate a plant or a tanker and cook it: models of any size for machines without data.
    Generate(GenerateArgs),
    /// Say what a cooked scene holds.
    Info(InfoArgs),
    /// Walk a camera through a scene with the three roles and write a report.
    Run(RunArgs),
    /// Walk the same path at several error bounds: speed against error.
    Sweep(SweepArgs),
    /// Simulate the three roles on a network: frame latency and bandwidth by transport, before a cable is bought.
    Sim(SimArgs),
    /// Put a network of the simulator between real programs: network namespaces whose packets are late, lost or queued.
    Netem(NetemArgs),
    /// Run one role of a deployment on several machines.
    #[command(subcommand)]
    Role(Box<RoleCommand>),
    /// Print a role's configuration file with every key, its flag, its environment variable, its default and what it means.
    Config {
        /// The role.
        role: RoleName,
    },
    /// Make and show the keys by which machines know each other where a transport encrypts.
    #[command(subcommand)]
    Keys(KeysCommand),
    /// Measure round trips over any transport, of a camera or of a frame of ids.
    Ping(PingArgs),
    /// Watch what the links of a running role carry.
    Stat(StatArgs),
    /// Generate a plant, walk through it and say where the report is.
    Demo(DemoArgs),
    /// Check GPU, memory and sockets: what works, what is missing, what to install.
    Doctor(DoctorArgs),
    /// Print completions for a shell.
    Completions {
        /// The shell to print them for.
        shell: Shell,
    },
}

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The files: glTF (.glb, .gltf), AVEVA review (.rvm), OBJ (.obj). Several make one scene.
    #[arg(required = true, value_name = "FILES")]
    pub(crate) files: Vec<PathBuf>,
    /// Where to write the scene.
    #[arg(short, long, value_name = "X.scene")]
    pub(crate) output: PathBuf,
    /// How far a tessellated curve may lie from the true one, millimetres (RVM).
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    pub(crate) chord_tolerance: f64,
    /// Which way is up in the files [default: y for glTF and OBJ, z for RVM].
    #[arg(long, value_enum)]
    pub(crate) up: Option<Up>,
    /// Metres a unit of the files' coordinates [default: 1 for glTF and OBJ, 0.001 for RVM].
    #[arg(long, value_name = "METRES", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) unit: Option<f64>,
    /// Print what was read and made as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Decks, rooms, pipe racks and vessels of a process plant.
    Plant,
    /// A ship: hull, bulkheads, tanks, superstructure.
    Tanker,
}

#[derive(Debug, Args)]
pub(crate) struct GenerateArgs {
    /// What to generate.
    #[arg(value_enum)]
    pub(crate) kind: Kind,
    /// Where to write the scene.
    #[arg(short, long, value_name = "X.scene")]
    pub(crate) output: PathBuf,
    /// About how many triangles; instances count each time [default: 0.4 million].
    #[arg(long, value_name = "N")]
    pub(crate) triangles: Option<u64>,
    /// About how many objects [default: as suits the triangles].
    #[arg(long, value_name = "N")]
    pub(crate) objects: Option<u32>,
    /// The same seed gives the same model, byte for byte.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// The size the paper measured: a plant of 13 million triangles in 1,200 objects, a tanker of 82 million in 127 thousand.
    #[arg(long, conflicts_with_all = ["triangles", "objects"])]
    pub(crate) paper: bool,
    /// Print what was made as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LinkKind {
    /// Three roles as threads of this process.
    Inproc,
    /// Three processes of this machine over Unix sockets.
    Unix,
    /// Three processes of this machine over TCP on its loopback.
    Tcp,
    /// Three processes of this machine over QUIC on its loopback, with keys made for the session.
    Quic,
    /// Three processes of this machine over the project's own datagrams on its loopback, with keys made for the session.
    Udp,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Tester {
    /// Vulkan occlusion queries, the paper's method.
    Query,
    /// One instanced draw that counts pixels with atomics; counts equal the queries'.
    Raster,
    /// A pyramid of farthest depths; the fastest, never hides what a query shows.
    Hzb,
}

/// How ids travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Coding {
    /// As changes against an earlier frame, where that is shorter.
    Changes,
    /// 4 bytes an id, as in the paper's bandwidth formula.
    Plain,
}

impl From<Coding> for IdCoding {
    fn from(coding: Coding) -> Self {
        match coding {
            Coding::Changes => Self::Changes,
            Coding::Plain => Self::Plain,
        }
    }
}

/// A picture size, `WIDTHxHEIGHT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) width: u32,
    pub(crate) height: u32,
}

#[derive(Debug, Clone, Args)]
pub(crate) struct WalkArgs {
    /// How many frames [default: as many as the path has, 200 for an automatic one].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) frames: Option<u32>,
    /// A path file (JSON: eye, forward and up per frame), a report.json to walk again, or `auto`: a seeded walk at eye height
    /// that avoids solid space.
    #[arg(long, value_name = "FILE|auto", default_value = "auto")]
    pub(crate) path: String,
    /// The seed of an automatic path.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// The picture's size in pixels.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub(crate) size: Size,
    /// How many ids travel in one batch.
    #[arg(long, value_name = "B", default_value_t = 1024, value_parser = clap::value_parser!(u16).range(1..=16384))]
    pub(crate) batch: u16,
    /// How ids travel between processes.
    #[arg(long, value_enum, default_value = "changes")]
    pub(crate) coding: Coding,
    /// What tests boxes against the occluders.
    #[arg(long, value_enum, default_value = "hzb")]
    pub(crate) tester: Tester,
    /// Do not refine what shows at fewer pixels than epsilon (section 4.5.2 of the paper). The report says what that costs. Needs a
    /// tester that counts pixels: query or raster.
    #[arg(long)]
    pub(crate) few_pixels: bool,
    /// The Vulkan device, by a part of its name [default: the best there is].
    #[arg(long, value_name = "NAME")]
    pub(crate) device: Option<String>,
    /// Check every N-th frame against the unculled picture and the exactly visible set; 0 checks none.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) audit_every: u32,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// How the roles are joined.
    #[arg(long, value_enum, default_value = "inproc", env = "TRIMARAN_LINK")]
    pub(crate) link: LinkKind,
    #[command(flatten)]
    pub(crate) links: <LinkConfig as Config>::Layer,
    /// The largest error on the screen, pixels.
    #[arg(long, value_name = "PX", default_value_t = 2.0, value_parser = positive, allow_negative_numbers = true)]
    pub(crate) epsilon: f64,
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
    /// Show what this process's links carry on this address while it walks, unless they are within it: `/metrics` for Prometheus, `/links`
    /// and `/listener` for `trimaran stat`.
    #[arg(long, value_name = "HOST:PORT")]
    pub(crate) metrics: Option<SocketAddr>,
    /// Walk by the clock, so many poses of the path a second, and show in each frame the newest pose. Without it every pose is a frame.
    #[arg(long, value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) live: Option<f64>,
    /// Add to the report, per audited frame, the objects exactly visible at full detail by name and index in their file.
    #[arg(long)]
    pub(crate) visible: bool,
    /// Record what each frame asked of the roles (ids, when they were found, computing times, camera), for `trimaran sim --trace`.
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    /// Where to write report.json, report.html and the frames.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Print the report's summary as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// The error bounds to walk at, pixels.
    #[arg(long, value_name = "PX,PX,..", value_delimiter = ',', default_value = "0.5,1,2,5,10,20", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) epsilons: Vec<f64>,
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
    /// Where to write report.json and report.html.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Print the sweep as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SimLink {
    /// Two TCP connections a link, as in the paper.
    Tcp,
    /// A QUIC connection a link.
    Quic,
    /// The project's own connection over datagrams: every frame arrives whole.
    Udp,
    /// The same with deadlines: what of a frame would come too late is given up.
    UdpDeadline,
}

#[derive(Debug, Args)]
pub(crate) struct SimArgs {
    /// The networks: fast-ethernet, gigabit, 10g, wifi, lte, wan-20ms, wan-80ms, satellite, or files ending in .toml.
    #[arg(long, value_name = "PROFILE,..", value_delimiter = ',', default_value = "fast-ethernet")]
    pub(crate) network: Vec<String>,
    /// What joins the roles.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "tcp,quic,udp")]
    pub(crate) link: Vec<SimLink>,
    /// How many ids travel in one batch: the paper's b.
    #[arg(long, value_name = "B,..", value_delimiter = ',', default_value = "1024", value_parser = clap::value_parser!(u16).range(1..=16384))]
    pub(crate) batch: Vec<u16>,
    /// How many ids each frame has: the paper's n.
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        default_value = "4000",
        conflicts_with = "trace"
    )]
    pub(crate) nodes: Vec<u32>,
    /// How long OR draws, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause)]
    pub(crate) or_ms: Option<f64>,
    /// How long HC culls, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause)]
    pub(crate) hc_ms: Option<f64>,
    /// How long RVG draws, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause)]
    pub(crate) rvg_ms: Option<f64>,
    /// A walk recorded with `trimaran run --record`: each frame has its ids, when they were found, its times and its camera. Or a
    /// report.json: counts and times only.
    #[arg(long, value_name = "TRACE")]
    pub(crate) trace: Option<PathBuf>,
    /// How many frames to show.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) frames: u32,
    /// The seeds of losses and delays: the same one gives the same run. The tables take the frames of all seeds together.
    #[arg(long, value_name = "SEED,..", value_delimiter = ',', default_value = "1")]
    pub(crate) seed: Vec<u64>,
    /// How ids travel; changes need a trace.
    #[arg(long, value_enum, default_value = "plain")]
    pub(crate) coding: Coding,
    /// For udp-deadline: how long after its end a frame may arrive, milliseconds.
    #[arg(long, value_name = "MS,..", value_delimiter = ',', default_value = "50", value_parser = pause)]
    pub(crate) udp_deadline_ms: Vec<f64>,
    /// For udp and udp-deadline: bytes of repair while packets are lost, percent of the frames' own; 0 for none.
    #[arg(long, value_name = "PERCENT,..", value_delimiter = ',', default_value = "15", value_parser = clap::value_parser!(u8).range(0..=100))]
    pub(crate) udp_repair: Vec<u8>,
    /// For udp and udp-deadline: nothing is encrypted.
    #[arg(long)]
    pub(crate) udp_in_the_clear: bool,
    /// The scene of the trace: draw the frames that came with gaps, and count the pixels that are wrong.
    #[arg(long, value_name = "X.scene", requires = "trace")]
    pub(crate) scene: Option<PathBuf>,
    /// The Vulkan device that draws them, by a part of its name [default: the best there is].
    #[arg(long, value_name = "NAME", requires = "scene")]
    pub(crate) device: Option<String>,
    /// Where to write a run's packets for Wireshark, a pcapng file a run.
    #[arg(long, value_name = "DIR")]
    pub(crate) pcap: Option<PathBuf>,
    /// Where to write sim.json, with all figures, runs.csv and frames.csv, with the times of every frame, and sim.html, a page with charts.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print all figures as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum RoleCommand {
    /// One of the two machines that take turns: draws occluders, culls.
    Switch(RoleArgs<<SwitchConfig as Config>::Layer>),
    /// The machine that shows the pictures and holds the camera.
    Display(RoleArgs<<DisplayConfig as Config>::Layer>),
}

/// What a role is told: a flag overrides its environment variable, that overrides the file, and that the default.
#[derive(Debug, Args)]
pub(crate) struct RoleArgs<L: Args> {
    /// The role's configuration (TOML); `trimaran config` prints one with every key.
    #[arg(long, value_name = "F.toml", env = "TRIMARAN_CONFIG")]
    pub(crate) config: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) flags: L,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RoleName {
    /// A machine of the pair.
    Switch,
    /// The machine that shows the pictures.
    Display,
}

#[derive(Debug, Subcommand)]
pub(crate) enum KeysCommand {
    /// Make the keys of a machine: NAME.key, which is private and stays there, and NAME.pub for its peers.
    New {
        /// What to call the machine: up to 64 letters, digits, dots, hyphens and underscores.
        name: Name,
        /// The folder to write both files into.
        #[arg(long, value_name = "DIR", default_value = ".")]
        out: PathBuf,
    },
    /// Print who a key file is.
    Show {
        /// A private or a public key file.
        file: PathBuf,
    },
}

#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Walk this scene instead of a generated plant.
    pub(crate) scene: Option<PathBuf>,
    /// Where to write the scene and the report.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// An address whose port is to be tried for listening.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub(crate) listen: SocketAddr,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width @ 1.., height @ 1..)) => Ok(Size { width, height }),
        _ => Err("give WIDTHxHEIGHT in pixels, such as 1024x1024".to_owned()),
    }
}

fn pause(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=60_000.0).contains(&value) => Ok(value),
        _ => Err("give milliseconds from 0 to 60000".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_size_needs_two_sides_above_zero() {
        assert_eq!(size("1920x1080"), Ok(Size { width: 1920, height: 1080 }));
        for bad in ["", "10", "0x10", "10x0", "x", "10x-1", "1e3x5", "99999999999x1"] {
            assert!(size(bad).is_err(), "{bad:?} was taken");
        }
    }

    #[test]
    fn an_error_bound_is_a_number_above_zero() {
        assert_eq!(positive("0.5"), Ok(0.5));
        for bad in ["0", "-1", "NaN", "inf", "two"] {
            assert!(positive(bad).is_err(), "{bad:?} was taken");
        }
    }
}
