//! Links: their options, and what measures, watches and emulates them.

use std::path::PathBuf;

use clap::Args;
use trimaran::config::{GivenOption, positive};
use trimaran_proto::IdCoding;
use trimaran_transport::Endpoint;

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

/// The options of links.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct LinkFlags {
    /// Set an option of links, such as `udp.mode=deadline` or `link.idle_timeout_s=5`; may be repeated.
    /// `trimaran config display` prints all keys. Environment variables do the same: `TRIMARAN_UDP_MODE`.
    #[arg(short = 'o', long = "option", value_name = "KEY=VALUE")]
    pub(crate) options: Vec<GivenOption>,
}

#[derive(Debug, Args)]
pub(crate) struct PingArgs {
    /// Where, such as `tcp://host:7500`, `udp://host:7500`, `quic://host:7500`,
    /// `ws://host:7500`, `wss://host:7500` or `unix:/path`.
    pub(crate) endpoint: Endpoint,
    /// Listen there and send back what comes, until interrupted: the other end of a ping.
    #[arg(long)]
    pub(crate) answer: bool,
    /// How many round trips.
    #[arg(
        long,
        short,
        value_name = "N",
        default_value_t = 20,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pub(crate) count: u32,
    /// Seconds from one to the next; 0 sends as soon as the last has come back.
    #[arg(
        long,
        short,
        value_name = "S",
        default_value_t = 0.1,
        value_parser = not_negative,
        allow_negative_numbers = true
    )]
    pub(crate) interval: f64,
    /// Send a frame of so many ids there and back, not a camera.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) ids: u32,
    /// How many ids travel in one batch.
    #[arg(
        long,
        value_name = "B",
        default_value_t = 1024,
        value_parser = clap::value_parser!(u16).range(1..=16384)
    )]
    pub(crate) batch: u16,
    /// How this end's ids travel.
    #[arg(long, value_enum, default_value = "plain")]
    pub(crate) coding: Coding,
    /// How long to wait for the other end at the start, and for each camera, seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 5.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) timeout: f64,
    /// This machine's private keys, for transports that encrypt (`trimaran keys new`).
    #[arg(long, value_name = "NAME.key")]
    pub(crate) keys: Option<PathBuf>,
    /// The other end's public keys.
    #[arg(long, value_name = "NAME.pub")]
    pub(crate) peer: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) links: LinkFlags,
    /// Print the result as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatArgs {
    /// Where the role shows its metrics: the HOST:PORT of its `--metrics`.
    #[arg(value_name = "HOST:PORT")]
    pub(crate) at: String,
    /// Seconds from one reading to the next.
    #[arg(
        long,
        short,
        value_name = "S",
        default_value_t = 1.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) interval: f64,
    /// How many readings [default: until interrupted or the role ends].
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) count: Option<u32>,
    /// Print each reading as a line of JSON: all that each link has carried.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Where the role shows its metrics: its `--metrics`, as HOST:PORT or as http://HOST:PORT.
    #[arg(value_name = "URL", env = "TRIMARAN_METRICS", default_value = "127.0.0.1:9464")]
    pub(crate) at: String,
    /// The longest wait for its answer, seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) timeout: f64,
    /// Print all that is known as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[cfg(feature = "lab")]
#[derive(Debug, Args)]
pub(crate) struct NetemArgs {
    /// The network: fast-ethernet, gigabit, 10g, wifi, lte, wan-20ms, wan-80ms, satellite, or a file ending
    /// in .toml.
    #[arg(long, value_name = "PROFILE")]
    pub(crate) profile: String,
    /// The network namespaces to join: those of 1 to 8 cullers, and last the display's. Those that do not
    /// exist are made, and removed at the end. Their addresses are 10.0.0.1, 10.0.0.2 and so on, and
    /// fd00::1, fd00::2.
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_value = "culler-1,culler-2,display")]
    pub(crate) namespaces: Vec<String>,
    /// The seed of losses and delays.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// End after so many seconds [default: when interrupted].
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Print at the end what became of the packets as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..1e6).contains(&seconds) => Ok(seconds),
        _ => Err("give seconds, 0 or more".to_owned()),
    }
}
