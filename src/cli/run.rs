//! `trimaran run`: walks a camera through a scene with the three roles and writes the report.

use std::path::Path;

use trimaran::{
    report::{
        Writer,
        schema::{HowEnded, Seat},
    },
    walkthrough::{
        Plan, Recorder, ReportPlan, SceneFile, Stage, StageError, Trail, begin, how_ended, in_process,
    },
};
use trimaran_actors::SessionError;
use trimaran_scene::walk::WalkKind;

use super::{
    Failure,
    args::{LinkKind, RunArgs, WalkArgs},
    progress,
    recording::{Early, Outcome, check_trace, open_folder, report_on},
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
            let trail = walking::trail(&args.walk, &plan, &file.scene)?;
            let record = args.record.as_deref();
            check_trace(record)?;
            let folder = open_folder(&args.out)?;
            let stage = set_stage(&file, &args.walk)?;
            let outcome = walk_and_report(&stage, folder, &file, &plan, &trail, &args.walk, record)?;
            outcome.conclude(&args.out, args.json)
        }
        LinkKind::Unix => three_processes::run(args, Transport::Unix),
        LinkKind::Tcp => three_processes::run(args, Transport::Tcp),
        LinkKind::Quic => three_processes::run(args, Transport::Quic),
        LinkKind::Udp => three_processes::run(args, Transport::Udp),
    }
}

/// Opens the devices of three roles in this process.
pub(super) fn set_stage(file: &SceneFile, walk: &WalkArgs) -> Result<Stage, Failure> {
    Stage::set(&file.scene, &gpu_options(walk.device.as_deref(), walk.device_timeout))
        .map_err(Failure::broken)
}

/// Walks in this process, records into `trace` and reports into `folder`.
pub(super) fn walk_and_report(
    stage: &Stage,
    folder: Writer,
    file: &SceneFile,
    plan: &Plan,
    trail: &Trail,
    walk: &WalkArgs,
    trace: Option<&Path>,
) -> Result<Outcome, Failure> {
    let [first, second, display] = &stage.drawn;
    let devices = [(Seat::SwitchA, first), (Seat::SwitchB, second), (Seat::Display, display)]
        .map(|(seat, drawn)| (seat, drawn.gpu().info().clone()));
    let about = ReportPlan {
        command_line: std::env::args().collect(),
        started: walking::date(),
        link: "inproc".to_owned(),
        transport: "in one process: shared memory, nothing is encoded".to_owned(),
        path: walk.path.clone(),
        seed: (walk.path == "auto").then_some(walk.seed),
        devices: devices.into(),
        notes: notes(trail),
    };
    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
    let bar = progress::walk(plan.pace, trail);
    let mut advance = |_| bar.inc(1);
    let mut recorder = Recorder::new(plan.audit_every, &mut advance);
    recorder.write_into(begin(folder, file, plan, &about, trail).map_err(Failure::broken)?);
    let walked = in_process(stage, plan, trail, &mut recorder, runtime.handle(), &stop);
    bar.finish_and_clear();
    let early = walked.err().map(|error| Early { how: how_it_ended(&error), why: Failure::broken(error) });
    report_on(recorder, None, early, trace, file, display, plan, about, trail, &stop)
}

fn how_it_ended(error: &StageError) -> HowEnded {
    let StageError::Session(session) = error else { return HowEnded::DeviceFailed };
    match &**session {
        SessionError::Pair { cause, .. } => how_ended(cause),
        SessionError::Display(cause) => how_ended(cause),
        _ => HowEnded::Failed,
    }
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
