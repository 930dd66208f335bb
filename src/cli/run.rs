//! `trimaran run`: walks a camera through a scene with the three roles and writes the report.

use std::{ops::ControlFlow, path::Path, time::SystemTime};

use trimaran::{
    report::{Report, schema::Seat, text},
    trace::Trace,
    walkthrough::{
        FrameRecord, Plan, Recorder, ReportPlan, SceneFile, Stage, Trail, in_process, write_report,
    },
};
use trimaran_actors::Stop;
use trimaran_scene::walk::WalkKind;

use super::{
    Failure,
    args::{LinkKind, RunArgs, WalkArgs},
    print_json, progress,
    three_processes::{self, Transport},
    walking::{self, gpu_options, open, stop_on_signal},
};

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let plan = walking::plan(&args.walk, args.epsilon, args.visible, walking::pace(args.live))?;
    if args.walk.alone && (args.link != LinkKind::Inproc || args.live.is_some()) {
        return Err(Failure::bad_input(
            "--alone lets the roles of one process take turns: leave --link and --live out",
        ));
    }
    match args.link {
        LinkKind::Inproc if args.metrics.is_some() => Err(Failure::bad_input(
            "--metrics shows what links between processes carry: add --link unix, tcp, quic or udp",
        )),
        LinkKind::Inproc => {
            let file = open(&args.scene)?;
            let stage = set_stage(&file, &args.walk)?;
            let trail = walking::trail(&args.walk, &plan, &file.scene)?;
            let record = args.record.as_deref();
            let report = walk_and_report(&stage, &file, &plan, &trail, &args.walk, record, &args.out)?;
            conclude(&report, &args.out, args.json)
        }
        LinkKind::Unix => three_processes::run(args, Transport::Unix),
        LinkKind::Tcp => three_processes::run(args, Transport::Tcp),
        LinkKind::Quic => three_processes::run(args, Transport::Quic),
        LinkKind::Udp => three_processes::run(args, Transport::Udp),
    }
}

/// Opens the devices of three roles in this process.
pub(super) fn set_stage(file: &SceneFile, walk: &WalkArgs) -> Result<Stage, Failure> {
    Stage::set(&file.scene, &gpu_options(walk.device.as_deref())).map_err(Failure::broken)
}

/// Walks in this process, records into `trace` and writes the report into `out`.
pub(super) fn walk_and_report(
    stage: &Stage,
    file: &SceneFile,
    plan: &Plan,
    trail: &Trail,
    walk: &WalkArgs,
    trace: Option<&Path>,
    out: &Path,
) -> Result<Report, Failure> {
    let started = SystemTime::now();
    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
    let bar = progress::walk(plan.pace, trail);
    let mut advance = |_| bar.inc(1);
    let mut recorder = Recorder::new(plan.audit_every, &mut advance);
    in_process(stage, plan, trail, &mut recorder, runtime.handle(), &stop).map_err(Failure::broken)?;
    let records = recorder.into_frames();
    bar.finish_and_clear();
    record(trace, file, plan, &records)?;
    let [first, second, display] = &stage.drawn;
    let devices = [(Seat::SwitchA, first), (Seat::SwitchB, second), (Seat::Display, display)]
        .map(|(seat, drawn)| (seat, drawn.gpu().info().clone()));
    let about = ReportPlan {
        command_line: std::env::args().collect(),
        started,
        link: "inproc".to_owned(),
        transport: "in one process: shared memory, nothing is encoded".to_owned(),
        path: walk.path.clone(),
        seed: (walk.path == "auto").then_some(walk.seed),
        devices: devices.into(),
        notes: notes(trail),
    };
    report_on(&records, &stop, |records, advance| {
        write_report(out, file, display, plan, &about, trail, records, advance)
    })
}

/// Writes what each frame asked of the roles, if that is wanted.
pub(super) fn record(
    trace: Option<&Path>,
    file: &SceneFile,
    plan: &Plan,
    records: &[FrameRecord],
) -> Result<(), Failure> {
    let Some(path) = trace else { return Ok(()) };
    let trace = Trace::of(file.scene.hash(), plan, records).map_err(Failure::broken)?;
    trace.write(path).map_err(Failure::broken)
}

/// Writes the report of what was recorded, with progress. An interrupted walk has a report as far as it came.
pub(super) fn report_on(
    records: &[FrameRecord],
    stop: &Stop,
    write: impl FnOnce(
        &[FrameRecord],
        &mut dyn FnMut(u32) -> ControlFlow<()>,
    ) -> Result<(Report, trimaran::report::Paths), trimaran::walkthrough::ReportingError>,
) -> Result<Report, Failure> {
    if stop.requested() {
        eprintln!(
            "trimaran: interrupted after {} frames; writing their report (interrupt again to leave without)",
            records.len()
        );
    }
    if records.is_empty() {
        return Err(Failure::broken("interrupted before the first frame: there is nothing to report"));
    }
    let bar = progress::bar("reporting", records.len() as u64);
    let mut advance = |_| {
        bar.inc(1);
        if stop.insisted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let (report, _) = write(records, &mut advance).map_err(Failure::broken)?;
    bar.finish_and_clear();
    Ok(report)
}

/// Remarks that belong beside every figure of the walk.
pub(super) fn notes(trail: &Trail) -> Vec<String> {
    let note = match trail.kind {
        None | Some(WalkKind::Floors) => return Vec::new(),
        Some(WalkKind::Hovering) => {
            "no floor was found to walk on: the automatic path hovers between the objects"
        }
        Some(WalkKind::Orbit) => {
            "no room was found to move in: the automatic path circles the scene from outside"
        }
    };
    vec![note.to_owned()]
}

/// Prints what came of it and where it lies.
pub(super) fn conclude(report: &Report, out: &Path, json: bool) -> Result<(), Failure> {
    if json {
        return print_json(&report.summary);
    }
    print!("{}", text::summary(report));
    println!("report: {}", out.join("report.html").display());
    Ok(())
}
