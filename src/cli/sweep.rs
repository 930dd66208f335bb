//! `trimaran sweep`: the same path at several error bounds, speed against error.

use trimaran::report::{SweepPoint, text, write};

use super::{
    Failure,
    args::{RunArgs, SweepArgs},
    print_json,
    run::{open_devices, walk},
    walking::open,
};

pub(super) fn run(args: &SweepArgs) -> Result<(), Failure> {
    let file = open(&args.scene)?;
    let devices = open_devices(&file, &args.walk)?;
    let mut points = Vec::new();
    let mut last = None;
    for &epsilon in &args.epsilons {
        let out = args.out.join(format!("epsilon-{epsilon}"));
        let at = RunArgs { epsilon, ..RunArgs::of(args.scene.clone(), args.walk.clone(), out) };
        let report = walk(&at, &file, Some(&devices))?.whole()?;
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
