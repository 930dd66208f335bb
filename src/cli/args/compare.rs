//! Systems held against each other.

use std::path::PathBuf;

use clap::Args;
use trimaran::{comparison::System, config::positive};

use super::{
    links::LinkFlags,
    walks::{LinkKind, WalkArgs},
};

#[derive(Debug, Clone, Args)]
pub(crate) struct CompareArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// The systems to compare [default: all but whole].
    #[arg(
        long,
        value_name = "SYSTEM,..",
        value_enum,
        value_delimiter = ',',
        default_values_t = System::of_the_cut(),
        hide_default_value = true
    )]
    pub(crate) systems: Vec<System>,
    /// The error bounds of the tables, pixels. Coherence and lag are looked at with the first one.
    #[arg(
        long,
        value_name = "PX,PX,..",
        value_delimiter = ',',
        default_value = "10,20",
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) epsilon: Vec<f64>,
    /// The error bounds at which speed is held against error, pixels; none if no number follows.
    #[arg(
        long,
        value_name = "PX,PX,..",
        value_delimiter = ',',
        num_args = 0..,
        default_value = "0.5,1,2,5,10,20",
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) curve: Vec<f64>,
    /// How many poses of the path pass in a second where it is walked by the clock; none if no number
    /// follows.
    #[arg(
        long,
        value_name = "HZ,HZ,..",
        value_delimiter = ',',
        num_args = 0..,
        default_value = "15,30,60",
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) live: Vec<f64>,
    /// Leave out the same walk at other paces: slow, turning on the spot, from place to place.
    #[arg(long)]
    pub(crate) no_coherence: bool,
    /// How many automatic paths are walked, the first with --seed, each further one with the next seed. A
    /// path from a file is walked as often.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) paths: u32,
    /// Three paths of 60 frames at the first error bound, without curve, coherence and walks by the clock.
    #[arg(long, conflicts_with_all = ["paths", "curve", "live", "no_coherence"])]
    pub(crate) quick: bool,
    /// How processes are joined, where a system is measured as processes.
    #[arg(long, value_enum, default_value = "tcp", env = "TRIMARAN_LINK")]
    pub(crate) link: LinkKind,
    #[command(flatten)]
    pub(crate) links: LinkFlags,
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
    /// Where to write compare.json, compare.html and the figures.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Print the comparison as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

impl CompareArgs {
    /// The same with what --quick stands for.
    pub(crate) fn quickened(&self) -> Self {
        let mut args = self.clone();
        if args.quick {
            args.paths = 3;
            args.epsilon.truncate(1);
            args.curve.clear();
            args.live.clear();
            args.no_coherence = true;
            args.walk.frames = Some(args.walk.frames.unwrap_or(60));
        }
        args
    }
}
