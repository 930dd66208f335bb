//! Checks of the program itself.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use trimaran::config::positive;

#[derive(Debug, Subcommand)]
pub(crate) enum AuditCommand {
    /// Walk the hard cases of culling in every system with every occlusion test, on the f64 oracle and on
    /// every Vulkan device: wrong pixels, lost nodes, toggles. The exit code is 1 if a figure is wrong.
    Hard(HardArgs),
    /// Draw scenes and walks at random, and search for a frame whose pixels culling changes. The exit code is
    /// 1 if there is one; the smallest such walk is written to a file.
    Search(SearchArgs),
}

#[derive(Debug, Args)]
pub(crate) struct HardArgs {
    /// The Vulkan devices, by a part of their names [default: all that can be used].
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    pub(crate) device: Vec<String>,
    /// Only these of the 23 difficulties, by number [default: all].
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        value_parser = clap::value_parser!(u8).range(1..=23)
    )]
    pub(crate) only: Vec<u8>,
    /// The error bound of levels of detail, pixels.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 2.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) epsilon: f64,
    /// A page (Markdown) to write: the table, and how figures change with scale, offset, field of view, depth
    /// and the picture's size.
    #[arg(long, value_name = "FILE.md")]
    pub(crate) out: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SearchArgs {
    /// Stop once this many frames were culled and compared.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    pub(crate) frames: u64,
    /// The seed of the first walk; each later one has the next number.
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub(crate) seed: u64,
    /// The Vulkan device, by a part of its name or as `trimaran doctor` prints it [default: the best one].
    #[arg(long, value_name = "NAME", env = "TRIMARAN_DEVICE")]
    pub(crate) device: Option<String>,
    /// Where to write the smallest walks that fail.
    #[arg(long, value_name = "DIR", default_value = "found")]
    pub(crate) keep: PathBuf,
    /// Walk what an earlier search has written, instead of searching.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "seed", "keep"])]
    pub(crate) replay: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}
