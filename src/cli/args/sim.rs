//! Simulating the roles on a network.

use std::path::PathBuf;

use bytesize::ByteSize;
use clap::{Args, ValueEnum};
use trimaran::config::memory;

use super::{Coding, cullers::CullerLists};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SimLink {
    /// TCP, as in the paper: a connection for each lane. The TCP is a model of Linux's with CUBIC; with BBR
    /// long paths take longer.
    Tcp,
    /// The same in WebSockets, as pages in browsers open them.
    Ws,
    /// A QUIC connection a link.
    Quic,
    /// The project's own connection over datagrams: every frame arrives whole.
    Udp,
    /// The same with deadlines: what of a frame would come too late is given up.
    UdpDeadline,
}

#[derive(Debug, Args)]
pub(crate) struct SimArgs {
    /// The networks: fast-ethernet, gigabit, 10g, wifi, lte, wan-20ms, wan-80ms, satellite, or files ending
    /// in .toml.
    #[arg(long, value_name = "PROFILE,..", value_delimiter = ',', default_value = "fast-ethernet")]
    pub(crate) network: Vec<String>,
    /// The links between the roles.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "tcp,quic,udp")]
    pub(crate) link: Vec<SimLink>,
    #[command(flatten)]
    pub(crate) cullers: CullerLists,
    /// How many ids travel in one batch: the paper's b.
    #[arg(
        long,
        value_name = "B,..",
        value_delimiter = ',',
        default_value = "1024",
        value_parser = clap::value_parser!(u16).range(1..=16384)
    )]
    pub(crate) batch: Vec<u16>,
    /// How many ids each frame has: the paper's n.
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        default_value = "4000",
        conflicts_with = "trace",
        value_parser = clap::value_parser!(u32).range(..=100_000_000)
    )]
    pub(crate) nodes: Vec<u32>,
    /// How long OR draws, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause, allow_negative_numbers = true)]
    pub(crate) or_ms: Option<f64>,
    /// How long HC culls, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause, allow_negative_numbers = true)]
    pub(crate) hc_ms: Option<f64>,
    /// How long RVG draws, milliseconds [default: 5, or what the trace says].
    #[arg(long, value_name = "MS", value_parser = pause, allow_negative_numbers = true)]
    pub(crate) rvg_ms: Option<f64>,
    /// A walk recorded with `trimaran run --record`: each frame has its ids, when they were found, its times
    /// and its camera. Or a report.json: counts and times only.
    #[arg(long, value_name = "TRACE")]
    pub(crate) trace: Option<PathBuf>,
    /// How many frames to show.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) frames: u32,
    /// The seeds of losses and delays: the same one gives the same run. The tables take the frames of all
    /// seeds together.
    #[arg(long, value_name = "SEED,..", value_delimiter = ',', default_value = "1")]
    pub(crate) seed: Vec<u64>,
    /// How ids travel; changes need a trace.
    #[arg(long, value_enum, default_value = "plain")]
    pub(crate) coding: Coding,
    /// For udp-deadline: how long after its end a frame may arrive, milliseconds.
    #[arg(long, value_name = "MS,..", value_delimiter = ',', default_value = "50", value_parser = pause, allow_negative_numbers = true)]
    pub(crate) udp_deadline_ms: Vec<f64>,
    /// For udp and udp-deadline: bytes of repair while packets are lost, percent of the frames' own; 0 for
    /// none.
    #[arg(
        long,
        value_name = "PERCENT,..",
        value_delimiter = ',',
        default_value = "15",
        value_parser = clap::value_parser!(u8).range(0..=100)
    )]
    pub(crate) udp_repair: Vec<u8>,
    /// For udp and udp-deadline: nothing is encrypted.
    #[arg(long)]
    pub(crate) udp_in_the_clear: bool,
    /// The scene of the trace: draw the frames that came with gaps, and count the pixels that are wrong.
    /// With --empty-display nothing is drawn: it is what cullers send.
    #[arg(long, value_name = "X.scene", requires = "trace")]
    pub(crate) scene: Option<PathBuf>,
    /// Let the display begin without the scene: its cullers send it what becomes visible. Packing and
    /// unpacking take no time here.
    #[arg(long, requires = "scene")]
    pub(crate) empty_display: bool,
    /// The most memory for what cullers send to such a display, packed.
    #[arg(long, value_name = "SIZE", default_value = "256MiB", value_parser = memory)]
    pub(crate) geometry_cache: ByteSize,
    /// The Vulkan device that draws them, by a part of its name or as `trimaran doctor` prints it [default:
    /// the best one].
    #[arg(long, value_name = "NAME", requires = "scene")]
    pub(crate) device: Option<String>,
    /// Where to write a run's packets for Wireshark, a pcapng file a run.
    #[arg(long, value_name = "DIR")]
    pub(crate) pcap: Option<PathBuf>,
    /// Where to write sim.json, with all figures, runs.csv and frames.csv, with the times of every frame,
    /// and sim.html, a page with charts.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print all figures as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

fn pause(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=60_000.0).contains(&value) => Ok(value),
        _ => Err("give milliseconds from 0 to 60000".to_owned()),
    }
}
