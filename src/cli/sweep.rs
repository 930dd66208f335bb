//! `trimaran sweep`: the same path at several error bounds, speed against error.

use trimaran::{
    report::{SweepPoint, text, write},
    walkthrough::Pace,
};

use super::{
    Failure,
    args::SweepArgs,
    print_json,
    recording::open_folder,
    run::{set_stage, walk_and_report},
    walking::{self, open},
};

pub(super) fn run(args: &SweepArgs) -> Result<(), Failure> {
    let file = open(&args.scene)?;
    let stage = set_stage(&file, &args.walk)?;
    let mut points = Vec::new();
    let mut last = None;
    for &epsilon in &args.epsilons {
        let plan = walking::plan(&args.walk, epsilon, false, Pace::Lockstep)?;
        let trail = walking::trail(&args.walk, &plan, &file.scene)?;
        let folder = open_folder(&args.out.join(format!("epsilon-{epsilon}")))?;
        let report = walk_and_report(&stage, folder, &file, &plan, &trail, &args.walk, None)?.whole()?;
        points.push(SweepPoint::of(&report));
        last = Some(report);
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
