//! `trimaran sweep`: the same path at several error bounds, and with several numbers of cullers.

use std::sync::Arc;

use trimaran::{
    report::{SweepPoint, text, write},
    walkthrough::SceneOnDevices,
};

use super::{
    Failure,
    args::{CullerArgs, RunArgs, ScheduleArg, SweepArgs},
    print_json,
    run::{open_devices, walk},
    walking::open,
};

pub(super) fn run(args: &SweepArgs) -> Result<(), Failure> {
    let shared = args.cullers.combinations()?;
    let file = open(&args.scene)?;
    let most = shared.iter().map(|at| at.cullers).max().unwrap_or(0);
    let devices = open_devices(&file, most.into(), &args.walk)?;
    let mut points = Vec::new();
    let mut last = None;
    for &cullers in &shared {
        let devices = SceneOnDevices {
            scene: Arc::clone(&devices.scene),
            cullers: devices.cullers.iter().take(cullers.cullers.into()).map(Arc::clone).collect(),
            display: Arc::clone(&devices.display),
        };
        for &epsilon in &args.epsilons {
            let out = args.out.join(folder(&shared, cullers, epsilon));
            let at = RunArgs { epsilon, cullers, ..RunArgs::of(args.scene.clone(), args.walk.clone(), out) };
            let report = walk(&at, &file, Some(&devices))?.whole()?;
            points.push(SweepPoint::of(&report));
            last = Some(report);
        }
    }
    if let Some(report) = last {
        write(&args.out, report.with_sweep(points.clone()), []).map_err(Failure::broken)?;
    }
    if args.json {
        return print_json(&points);
    }
    print!("{}", text::sweep(&points));
    println!("report: {}", args.out.join("report.html").display());
    Ok(())
}

/// The folder of a run's own report.
fn folder(shared: &[CullerArgs], at: CullerArgs, epsilon: f64) -> String {
    match (shared, at.schedule) {
        ([_], _) => format!("epsilon-{epsilon}"),
        (_, ScheduleArg::Independent) => format!("cullers-{}-epsilon-{epsilon}", at.cullers),
        (_, ScheduleArg::Switch) => format!("switch-epsilon-{epsilon}"),
    }
}
