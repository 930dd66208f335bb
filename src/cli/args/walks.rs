//! Walking through a scene on this machine.

use std::{net::SocketAddr, path::PathBuf};

use bytesize::ByteSize;
use clap::{Args, ValueEnum};
use trimaran::{
    config::{WhileLoading, memory, positive},
    culling::CullingMethod,
};

use super::{
    cullers::{CullerArgs, ScheduleArg},
    links::{Coding, LinkFlags},
    serve::DeviceArgs,
};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LinkKind {
    /// Display and cullers as threads of this process.
    Inproc,
    /// A process each on this machine, over Unix sockets.
    Unix,
    /// The same over TCP on its loopback.
    Tcp,
    /// The same over WebSockets, which pages in browsers open.
    Ws,
    /// The same over QUIC, with keys made for the session.
    Quic,
    /// The same over the project's own datagrams, with keys made for the session.
    Udp,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum OcclusionTestArg {
    /// Vulkan occlusion queries, the paper's method.
    Query,
    /// One instanced draw that counts pixels with atomics; counts equal the queries'.
    Raster,
    /// A pyramid of farthest depths; the fastest, never hides what a query shows.
    Hzb,
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
    /// A path file (JSON: eye, forward and up per frame), a report.json to walk again, or `auto`: a seeded
    /// walk at eye height that avoids solid space.
    #[arg(long, value_name = "FILE|auto", default_value = "auto")]
    pub(crate) path: String,
    /// The seed of an automatic path.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// The picture's size in pixels.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub(crate) size: Size,
    /// How many ids travel in one batch.
    #[arg(
        long,
        value_name = "B",
        default_value_t = 1024,
        value_parser = clap::value_parser!(u16).range(1..=16384)
    )]
    pub(crate) batch: u16,
    /// How ids travel between processes.
    #[arg(long, value_enum, default_value = "changes")]
    pub(crate) coding: Coding,
    /// The test of boxes against the occluders.
    #[arg(long, value_enum, default_value = "hzb")]
    pub(crate) occlusion_test: OcclusionTestArg,
    /// Do not refine what shows at fewer pixels than epsilon (section 4.5.2 of the paper). The report says
    /// what that costs. Needs a occlusion test that counts pixels: query or raster.
    #[arg(long)]
    pub(crate) few_pixels: bool,
    /// The Vulkan device, by a part of its name or as `trimaran doctor` prints it [default: the best one].
    #[arg(long, value_name = "NAME")]
    pub(crate) device: Option<String>,
    /// The most memory of each device for the scene's triangles, such as 64MiB; the least used make room for
    /// those that show [default: three quarters of what is free].
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub(crate) gpu_memory: Option<ByteSize>,
    /// How long the device may make no progress before it counts as hung, seconds.
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = positive)]
    pub(crate) device_timeout: f64,
    /// Cull on the device whatever its kind, and compare each frame with culling on the host. Slower; ends
    /// with an error at the first difference.
    #[arg(long)]
    pub(crate) check_device: bool,
    /// Let the roles compute one after another, so that no busy time contains another role's work: a model
    /// of a machine for each role is made of such times. The frames are the same. Within one process only.
    #[arg(long)]
    pub(crate) alone: bool,
    /// Check every N-th frame against the unculled picture and the exactly visible set; 0 checks none.
    #[arg(long, value_name = "N", default_value_t = Self::AUDIT_EVERY)]
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
    pub(crate) links: LinkFlags,
    /// The largest error on the screen, pixels.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 2.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) epsilon: f64,
    #[command(flatten)]
    pub(crate) cullers: CullerArgs,
    /// How cullers find what is visible: to compare with other methods.
    #[arg(long, value_name = "METHOD", value_enum, default_value_t)]
    pub(crate) culling: CullingMethod,
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
    /// Show what this process's links carry on this address while it walks, unless they are within it:
    /// `/metrics` for Prometheus, `/links` and `/listener` for `trimaran stat`.
    #[arg(long, value_name = "HOST:PORT")]
    pub(crate) metrics: Option<SocketAddr>,
    /// Walk by the clock, so many poses of the path a second, and show in each frame the newest pose.
    /// Without it every pose is a frame.
    #[arg(long, value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) live: Option<f64>,
    /// Change at frames what is seen, as this TOML file says: sections, hidden, isolated and see-through
    /// objects, picture size, epsilon, occlusion test.
    #[arg(long, value_name = "FILE")]
    pub(crate) state: Option<PathBuf>,
    /// Add to the report, per audited frame, the objects exactly visible at full detail by name and index in
    /// their file.
    #[arg(long)]
    pub(crate) visible: bool,
    /// Let the display begin without the scene: its cullers send it what becomes visible. The scene is for
    /// audits alone then.
    #[arg(long)]
    pub(crate) empty_display: bool,
    /// The most memory for what cullers send to such a display, packed; what was not shown for the longest
    /// time goes first, and is sent again where it is needed.
    #[arg(long, value_name = "SIZE", default_value = "256MiB", value_parser = memory)]
    pub(crate) geometry_cache: ByteSize,
    /// The picture of such a display while some of a frame is still to come [default: coarser]. With --live
    /// only: in lockstep it always waits.
    #[arg(long, value_name = "WHAT", value_enum)]
    pub(crate) while_loading: Option<WhileLoading>,
    /// Record what each frame asked of the roles (ids, when they were found, computing times, camera), for
    /// `trimaran sim --trace`.
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    /// Where to write report.json, report.html and the frames.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Print the report's summary as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

impl WalkArgs {
    /// How often a frame is audited by default. Without the feature `lab` there are no audits.
    pub(crate) const AUDIT_EVERY: u32 = if cfg!(feature = "lab") { 10 } else { 0 };
}

impl RunArgs {
    /// The defaults of a walk within this process.
    pub(crate) fn of(scene: PathBuf, walk: WalkArgs, out: PathBuf) -> Self {
        Self {
            scene,
            link: LinkKind::Inproc,
            links: LinkFlags::default(),
            epsilon: 2.0,
            cullers: CullerArgs { cullers: 2, schedule: ScheduleArg::Independent },
            culling: CullingMethod::default(),
            walk,
            metrics: None,
            live: None,
            state: None,
            visible: false,
            empty_display: false,
            geometry_cache: ByteSize::mib(256),
            while_loading: None,
            record: None,
            out,
            json: false,
        }
    }
}

#[cfg(feature = "lab")]
#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// The error bounds to walk at, pixels.
    #[arg(
        long,
        value_name = "PX,PX,..",
        value_delimiter = ',',
        default_value = "0.5,1,2,5,10,20",
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) epsilons: Vec<f64>,
    #[command(flatten)]
    pub(crate) cullers: super::cullers::CullerLists,
    #[command(flatten)]
    pub(crate) walk: WalkArgs,
    /// Where to write report.json and report.html.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Print the sweep as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// The folder of the report; with --together the folders of many.
    #[arg(required = true, value_name = "DIR")]
    pub(crate) folders: Vec<PathBuf>,
    /// Write one page about all walks: a row a walk, and medians over the walks of a kind. Nothing is drawn or
    /// checked. Exit code 3 if a walk ended early, lacks checks or has no report.
    #[arg(long, value_name = "PAGE.html", conflicts_with = "scene")]
    pub(crate) together: Option<PathBuf>,
    /// The scene, where it is not where it was.
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// Print the report's summary as JSON, or with --together the walks.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Walk this scene instead of a generated plant.
    pub(crate) scene: Option<PathBuf>,
    /// Where to write the scene and the report.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub(crate) out: PathBuf,
}

pub(super) fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width @ 1.., height @ 1..)) => Ok(Size { width, height }),
        _ => Err("give WIDTHxHEIGHT in pixels, such as 1024x1024".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_needs_two_sides_above_zero() {
        assert_eq!(size("1920x1080"), Ok(Size { width: 1920, height: 1080 }));
        for bad in ["", "10", "0x10", "10x0", "x", "10x-1", "1e3x5", "99999999999x1"] {
            assert!(size(bad).is_err(), "{bad:?} was taken");
        }
    }
}
