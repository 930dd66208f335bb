//! `trimaran view --window`: the same in a window of the system.

use std::{io::Write as _, path::Path};

use tokio::runtime::Handle;
use trimaran::{
    config::options,
    page::{SceneDescription, model_name},
    report::schema::Stat,
    walkthrough::SceneFile,
    window::{
        About, ServiceAt, WindowError, WindowOptions, WindowReport, navigate::Start, open, open_service,
    },
};
use trimaran_actors::Stop;
use trimaran_proto::LodRule;
use trimaran_scene::path::PosePath;

use super::{
    Failure,
    args::ViewArgs,
    print_json, printed,
    view::{lasting, right},
    walking::{self, runtime, stop_on_signal},
};

/// The largest silhouette error, pixels: as in the page.
const EPSILON: f64 = 2.0;

/// With `drive` it walks along that path by itself, and reports on it.
pub(super) fn run(args: &ViewArgs, scene: &Path, drive: Option<PosePath>) -> Result<(), Failure> {
    let file = walking::open(scene)?;
    let about = about(model_name(&args.files), &file)?;
    show(args, drive, |options, runtime, stop| open(&file.scene, &about, options, runtime, stop))
}

/// The scene of a service.
pub(super) fn run_service(args: &ViewArgs, url: &str) -> Result<(), Failure> {
    let service: ServiceAt = url.parse().map_err(Failure::bad_input)?;
    let links = options(&[], toml::Table::new()).map_err(Failure::bad_input)?;
    let service = service.with_ws(links.ws);
    show(args, None, |options, runtime, stop| open_service(&service, options, runtime, stop))
}

fn about(name: String, file: &SceneFile) -> Result<About, Failure> {
    let described = SceneDescription::new(name, &file.scene).map_err(Failure::broken)?;
    let SceneDescription { name, has_floors, eye_height, clearance, vfov_deg, start, max_picture, .. } =
        described;
    let (eye, forward) = (start.eye.into(), start.forward.into());
    Ok(About {
        name,
        start: Start { eye, forward, eye_height, has_floors, vfov_deg },
        clearance,
        max_picture,
    })
}

fn show(
    args: &ViewArgs,
    drive: Option<PosePath>,
    open: impl FnOnce(&WindowOptions, &Handle, &Stop) -> Result<Option<WindowReport>, WindowError>,
) -> Result<(), Failure> {
    let options = WindowOptions {
        lod: LodRule::new(EPSILON).map_err(Failure::broken)?,
        size: [args.size.width, args.size.height],
        drive,
        present_mode: args.present_mode.into(),
        gpu: args.device.gpu_options(),
    };
    let runtime = runtime()?;
    let stop = stop_on_signal(&runtime);
    let shown = open(&options, runtime.handle(), &stop);
    let report = shown.map_err(|error| {
        if error.is_of_input() { Failure::bad_input(error) } else { Failure::broken(error) }
    })?;
    match report {
        Some(report) if args.json => print_json(&report),
        Some(report) => print_report(&report),
        None if args.drive.is_some() => Err(Failure::stopped("closed before it had walked to the end")),
        None => Ok(()),
    }
}

fn print_report(report: &WindowReport) -> Result<(), Failure> {
    let WindowReport { device, present_mode, width, height, pictures, walk_s, wrong, .. } = report;
    let spread = |stat: Option<Stat>| {
        stat.map_or_else(String::new, |Stat { median, p95, .. }| format!("{median:.1} ms, p95 {p95:.1} ms"))
    };
    let lines = [
        format!("drawn by        {device}, {width} x {height}, {present_mode}"),
        format!("first picture   exact after {:.2} s", report.exact_picture_s),
        format!("pictures        {pictures} in {walk_s:.1} s: {:.1} a second", f64::from(*pictures) / walk_s),
        format!("between two     {}", spread(report.picture_ms)),
        format!("sets are old    {}", spread(report.set_age_ms)),
        format!("at rest         exact after {:.0} ms", report.rest_ms),
        right(wrong),
        lasting(wrong),
    ];
    printed(writeln!(super::terminal::stdout(), "{}", lines.join("\n")))
}
