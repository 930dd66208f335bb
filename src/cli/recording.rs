//! The records of a walk: the folder is opened before the walk, filled while it goes on, and finished however
//! it ends.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
    time::Duration,
};

use trimaran::{
    report::{
        Report, ReportError, Run, Writer,
        schema::{Ended, HowEnded},
        text,
    },
    walkthrough::{FrameRecord, GivesUp, Journal, Plan, ReportingError, Walk, Written, write_report},
};
use trimaran_actors::{Stop, Stopwatch};
use trimaran_transport::causes;

#[cfg(feature = "lab")]
use super::output;
use super::{Failure, log::SAID, print_json, progress};

/// Why a walk ended before its end.
#[derive(Debug)]
pub(super) struct Early {
    pub(super) how: HowEnded,
    pub(super) why: Failure,
}

impl Early {
    /// The walk could not go on.
    pub(super) fn failed(why: Failure) -> Self {
        Self { how: HowEnded::Failed, why }
    }
}

/// A walk that is over and reported.
#[derive(Debug)]
pub(super) struct Outcome {
    pub(super) report: Report,
    /// The missing parts of the report.
    missing: Option<Failure>,
}

/// Opens the folder of a report with [`Writer::create`] or [`Writer::open`], before the walk begins.
pub(super) fn open_folder(
    open: fn(&Path) -> Result<Writer, ReportError>,
    out: &Path,
) -> Result<Writer, Failure> {
    open(out)
        .map_err(|error| if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) })
}

/// Whether the program can make what is wanted beside a walk: its audits, and a trace at this path.
pub(super) fn check(plan: &Plan, trace: Option<&Path>) -> Result<(), Failure> {
    if cfg!(not(feature = "lab")) && (plan.audit_every > 0 || plan.visible || trace.is_some()) {
        return Err(Failure::bad_input(
            "this program was built without the feature `lab`, which has audits and traces: set audit-every \
             to 0, and leave out visible and record",
        ));
    }
    #[cfg(feature = "lab")]
    if let Some(path) = trace {
        output::check(path, &output::TRACE, &[]).map_err(Failure::bad_input)?;
        trimaran::trace::Trace::check_path(path).map_err(Failure::bad_input)?;
    }
    Ok(())
}

/// A walk that is over, and not reported yet.
pub(super) struct Recording<'w> {
    pub(super) walk: Walk<'w>,
    pub(super) about: Run,
    pub(super) records: Vec<FrameRecord>,
    /// Remarks made on the way.
    pub(super) notes: Vec<String>,
    /// The journal of the frames, if there is one.
    pub(super) journal: Option<Journal>,
    /// The report's folder, if the walk did not begin to fill it.
    pub(super) unused: Option<Writer>,
    /// Whether this process has shown a frame of it.
    pub(super) shown: bool,
    pub(super) early: Option<Early>,
    /// Where to record the work of each frame.
    pub(super) trace: Option<PathBuf>,
    pub(super) stop: Stop,
}

impl Recording<'_> {
    #[cfg(feature = "lab")]
    /// Its frames, if the walk has all that its path asks for.
    pub(super) fn whole(self) -> Result<Vec<FrameRecord>, Failure> {
        let due = self.walk.plan.frames_due(self.walk.path.frames());
        match self.early {
            Some(early) => Err(early.why),
            None if self.stop.requested() => Err(Failure::stopped("interrupted")),
            None if due.is_some_and(|due| self.records.len() < due as usize) => {
                Err(Failure::broken("the walk ended before its path did"))
            }
            None => Ok(self.records),
        }
    }

    /// Reports it, with progress.
    pub(super) fn report(self) -> Result<Outcome, Failure> {
        let Self { walk, about: mut run, records, notes, journal, unused, shown, early, trace, stop } = self;
        run.notes.extend(notes);
        let (writer, full) = match journal.map(Journal::finish) {
            Some((writer, full)) => (Some(writer), full),
            None => (unused, None),
        };
        let due = walk.plan.frames_due(walk.path.frames());
        let ended = ended(early.as_ref(), full.as_ref(), &stop, records.len(), due);
        // An earlier process's frames stay for the next one.
        let nothing = !shown && (records.is_empty() || ended.early());
        let (Some(writer), false) = (writer, nothing) else {
            let nothing = || match stop.requested() {
                true => {
                    Failure::stopped("interrupted before the first frame: there is nothing new to report")
                }
                false => Failure::incomplete(
                    "the path was over before its first frame: give more --frames, or a slower --live",
                ),
            };
            return Err(early.map_or_else(nothing, |early| early.why));
        };
        let frames = u32::try_from(records.len()).unwrap_or(u32::MAX);
        if let Some(said) = ended.sentence(frames) {
            // The error with which the process ends says it once more: a journal has one fault of it.
            tracing::info!(target: SAID, "the walk {said}; reporting it");
        }
        let bar = progress::bar("reporting", records.len() as u64);
        let is_given_up = Grace::of(&stop).into_gives_up();
        let mut advance = |_| bar.inc(1);
        let written = write_report(writer, full, walk, run, &records, ended, &mut advance, &is_given_up);
        bar.finish_and_clear();
        let Written { report, incomplete, .. } = written.map_err(Failure::broken)?;
        let missing = match (report.summary.ended.sentence(frames), incomplete) {
            (Some(said), _) => Some(Failure::incomplete(format!("the walk {said}"))),
            (None, Some(why)) => {
                let why = causes(&why);
                Some(Failure::incomplete(format!("the report lacks pictures and checks: {why}")))
            }
            (None, None) => None,
        };
        let recorded = record(trace.as_deref(), walk, &records);
        Ok(Outcome { report, missing: missing.or(recorded.err()) })
    }
}

/// How long a report continues its pictures and checks once it is asked to stop: it is there soon, and whole
/// if little was left.
const GRACE: Duration = Duration::from_secs(2);

/// How long a report may take once it is asked to stop.
#[derive(Debug, Clone)]
pub(super) struct Grace {
    stop: Stop,
    /// Starts when the request is first seen.
    asked: Arc<OnceLock<Stopwatch>>,
}

impl Grace {
    pub(super) fn of(stop: &Stop) -> Self {
        Self { stop: stop.clone(), asked: Arc::default() }
    }

    /// Decides whether to leave out the rest.
    pub(super) fn into_gives_up(self) -> GivesUp {
        Arc::new(move || {
            let has_passed = || self.asked.get_or_init(Stopwatch::start).elapsed() > GRACE;
            self.stop.requested() && (self.stop.insisted() || has_passed())
        })
    }
}

/// How a walk of `frames` frames ended, if its path has `due`.
fn ended(
    early: Option<&Early>,
    full: Option<&ReportingError>,
    stop: &Stop,
    frames: usize,
    due: Option<u32>,
) -> Ended {
    let missing = due.is_some_and(|due| frames < due as usize);
    let (how, why) = match (full, early) {
        (Some(full), _) => (HowEnded::NotRecorded, causes(full)),
        (None, Some(Early { how, why })) => (*how, why.to_string()),
        (None, None) if stop.requested() && (missing || due.is_none()) => {
            (HowEnded::Interrupted, "it was asked to stop".to_owned())
        }
        (None, None) => return Ended::finished(due),
    };
    Ended { how, why: Some(why), frames_due: due }
}

/// Writes the trace of a walk, if one is wanted.
#[cfg(feature = "lab")]
fn record(trace: Option<&Path>, walk: Walk<'_>, records: &[FrameRecord]) -> Result<(), Failure> {
    let Some(path) = trace else { return Ok(()) };
    let trace = trimaran::trace::Trace::of(walk.file.scene.hash(), walk.plan, records);
    trace.map_err(Failure::incomplete)?.write(path).map_err(Failure::incomplete)
}

/// Without the laboratory [`check`] refuses a trace.
#[cfg(not(feature = "lab"))]
fn record(_: Option<&Path>, _: Walk<'_>, _: &[FrameRecord]) -> Result<(), Failure> {
    Ok(())
}

impl Outcome {
    #[cfg(feature = "lab")]
    /// The report, if it lacks nothing.
    pub(super) fn whole(self) -> Result<Report, Failure> {
        match self.missing {
            Some(missing) => Err(missing),
            None => Ok(self.report),
        }
    }

    /// Prints the result and its folder; fails if something is missing.
    pub(super) fn conclude(self, out: &Path, json: bool) -> Result<(), Failure> {
        if json {
            print_json(&self.report.summary)?;
        } else {
            print!("{}", text::summary(&self.report));
            println!("report: {}", out.join("report.html").display());
        }
        self.missing.map_or(Ok(()), Err)
    }
}
