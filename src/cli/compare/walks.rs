//! The walks of a comparison.

use std::{cell::OnceCell, sync::Arc};

use indicatif::ProgressBar;
use tokio::runtime::Runtime;
use trimaran::{
    comparison::{Coherence, Place, System},
    report::Report,
    walkthrough::{CameraPath, FrameRecord, Pace, Plan, SceneFile, SceneOnDevices, Walk, report_of},
};
use trimaran_actors::{Schedule, Stop};
use trimaran_gpu::GpuScene;
use trimaran_scene::{Scene, path::PosePath};

use super::audit::References;
use crate::cli::{
    Failure,
    args::{CompareArgs, CullerArgs, RunArgs, ScheduleArg, WalkArgs},
    progress,
    recording::Recording,
    run::record,
    walking::{self, open, stop_on_signal, upload},
};

/// How a system walks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mode {
    /// Its roles one after another, as threads.
    Alone,
    /// The same, with pictures read back for comparison with the exact ones.
    Audited,
    /// All at once, as they are measured.
    Measured,
    /// Likewise, live: this many poses a second.
    Live(f64),
}

/// A path that every system walks.
pub(super) struct Path {
    /// One pose per frame.
    pub(super) poses: PosePath,
    /// The same at the first error bound.
    pub(super) cameras: CameraPath,
}

/// A comparison under way.
pub(super) struct Comparing<'c> {
    pub(super) args: &'c CompareArgs,
    pub(super) file: SceneFile,
    /// The scene on the display's device, and on that of all roles if they run one after another.
    pub(super) drawn: Arc<GpuScene>,
    /// The same on a second device, for cullers that are threads of this process.
    other: OnceCell<Arc<GpuScene>>,
    /// The paths.
    pub(super) paths: Vec<Path>,
    pub(super) first_plan: Plan,
    pub(super) bar: ProgressBar,
    pub(super) runtime: Runtime,
    pub(super) stop: Stop,
}

impl<'c> Comparing<'c> {
    /// Opens the scene and the device, and finds the path.
    pub(super) fn open(args: &'c CompareArgs) -> Result<Self, Failure> {
        let file = open(&args.scene)?;
        let (Some(&system), Some(&epsilon)) = (args.systems.first(), args.epsilon.first()) else {
            return Err(Failure::bad_input("name at least one system, and one error bound"));
        };
        let first_plan = plan(args, system, epsilon, Mode::Alone)?;
        let seeds = (args.walk.seed..).take(args.paths as usize);
        let find = |seed| path(&WalkArgs { seed, ..args.walk.clone() }, &first_plan, &file.scene);
        let paths = seeds.map(find).collect::<Result<Vec<_>, _>>()?;
        let drawn = upload(&file, &args.walk.gpu_options())?;
        let runtime = walking::runtime()?;
        let stop = stop_on_signal(&runtime);
        let bar = progress::bar("comparing", steps(args) as u64);
        Ok(Self { args, file, drawn, other: OnceCell::new(), paths, first_plan, bar, runtime, stop })
    }

    /// One of the requested systems for each kind of work. Systems that differ only in their links walk alike
    /// when their roles run one after another.
    pub(super) fn by_work(&self) -> impl Iterator<Item = System> + '_ {
        by_work(&self.args.systems)
    }

    /// The requested systems that do the same work as this one.
    pub(super) fn all_of(&self, system: System) -> impl Iterator<Item = System> + '_ {
        self.args.systems.iter().copied().filter(move |other| other.same_work(system))
    }

    /// How processes are joined.
    pub(super) fn link_name(&self) -> String {
        format!("{:?}", self.args.link).to_lowercase()
    }

    /// The walk, or another path, at an error bound.
    pub(super) fn path_of(
        &self,
        system: System,
        epsilon: f64,
        poses: &PosePath,
    ) -> Result<CameraPath, Failure> {
        let plan = plan(self.args, system, epsilon, Mode::Alone)?;
        let views = plan.settings().into();
        CameraPath::of(poses.clone(), &self.file.scene, views, None).map_err(Failure::broken)
    }

    /// Walks one of the paths, and reports.
    pub(super) fn walk(
        &self,
        system: System,
        epsilon: f64,
        mode: Mode,
        path: &Path,
    ) -> Result<Report, Failure> {
        self.walk_on(system, epsilon, mode, &self.path_of(system, epsilon, &path.poses)?)
    }

    /// The same on another path.
    pub(super) fn walk_on(
        &self,
        system: System,
        epsilon: f64,
        mode: Mode,
        path: &CameraPath,
    ) -> Result<Report, Failure> {
        let plan = plan(self.args, system, epsilon, mode)?;
        Ok(self.recorded(system, &plan, mode, path, |_, _| Ok(()))?.0)
    }

    /// Walks one of the paths with the roles one after another, and compares its frames with the exact ones
    /// if it draws the LOD cut.
    pub(super) fn audited(
        &self,
        system: System,
        epsilon: f64,
        index: u32,
        path: &Path,
        references: &mut References,
    ) -> Result<Report, Failure> {
        let plan = plan(self.args, system, epsilon, Mode::Audited)?;
        let path = self.path_of(system, epsilon, &path.poses)?;
        references.see(&plan);
        let compared = system != System::Whole;
        let audit = |record: &FrameRecord, frame: &mut _| {
            if compared { references.enter(epsilon, index, record, frame) } else { Ok(()) }
        };
        Ok(self.recorded(system, &plan, Mode::Audited, &path, audit)?.0)
    }

    /// Walks; returns the report, with the results of `audit` in its frames, and the recording.
    pub(super) fn recorded(
        &self,
        system: System,
        plan: &Plan,
        mode: Mode,
        path: &CameraPath,
        mut audit: impl FnMut(&FrameRecord, &mut trimaran::report::Frame) -> Result<(), Failure>,
    ) -> Result<(Report, Vec<FrameRecord>), Failure> {
        self.bar.set_message(system.name());
        let way = Walk { file: &self.file, drawn: &self.drawn, plan, path };
        let devices = self.devices(system, mode)?;
        let args = self.run_args(system, plan, mode);
        let seat = (&self.runtime, &self.stop);
        let recording: Recording<'_> = record(&args, way, devices.as_ref(), None, None, seat)?;
        let about = recording.about.clone();
        let records = recording.whole()?;
        let mut failed = None;
        let report = report_of(way, about, &records, |record, frame| {
            if failed.is_none() {
                failed = audit(record, frame).err();
            }
        });
        self.bar.inc(1);
        failed.map_or(Ok((report, records)), Err)
    }

    fn run_args(&self, system: System, plan: &Plan, mode: Mode) -> RunArgs {
        let CompareArgs { scene, walk, link, links, out, .. } = self.args;
        let walk = WalkArgs { alone: plan.alone, audit_every: plan.audit_every, ..walk.clone() };
        RunArgs {
            link: *link,
            links: links.clone(),
            epsilon: plan.lod.epsilon_px(),
            cullers: cullers(system),
            culling: system.culling(),
            live: if let Mode::Live(hz) = mode { Some(hz) } else { None },
            ..RunArgs::of(scene.clone(), walk, out.clone())
        }
    }

    /// The devices of threads of this process; none where cullers are processes of their own.
    fn devices(&self, system: System, mode: Mode) -> Result<Option<SceneOnDevices>, Failure> {
        let on = |culler: &Arc<GpuScene>| SceneOnDevices {
            scene: Arc::clone(&self.file.scene),
            cullers: vec![Arc::clone(culler); system.cullers().into()],
            display: Arc::clone(&self.drawn),
        };
        let one_after_another = matches!(mode, Mode::Alone | Mode::Audited);
        match (one_after_another, system.place()) {
            (true, _) => Ok(Some(on(&self.drawn))),
            (false, Place::Threads) if system.cullers() == 0 => Ok(Some(on(&self.drawn))),
            (false, Place::Threads) => {
                let other = match self.other.get() {
                    Some(other) => Arc::clone(other),
                    None => {
                        let walk = &self.args.walk;
                        upload(&self.file, &walk.gpu_options())?
                    }
                };
                Ok(Some(on(self.other.get_or_init(|| other))))
            }
            (false, Place::Processes) => Ok(None),
        }
    }
}

fn by_work(systems: &[System]) -> impl Iterator<Item = System> + '_ {
    let first = |(place, system): &(usize, &System)| {
        systems.iter().position(|other| other.same_work(**system)) == Some(*place)
    };
    systems.iter().enumerate().filter(first).map(|(_, system)| *system)
}

/// The path of these flags, with one pose per frame.
fn path(walk: &WalkArgs, plan: &Plan, scene: &Scene) -> Result<Path, Failure> {
    let cameras = walking::path(walk, plan, scene, None)?;
    let count = cameras.frames() as usize;
    let poses = cameras.poses().frames().iter().cycle().take(count).copied().collect();
    let poses =
        PosePath::new(cameras.vfov_deg(), poses).and_then(|path| path.with_near(cameras.near().into()));
    Ok(Path { poses: poses.map_err(Failure::broken)?, cameras })
}

fn cullers(system: System) -> CullerArgs {
    let schedule = match system.schedule() {
        Schedule::Switch => ScheduleArg::Switch,
        _ => ScheduleArg::Independent,
    };
    CullerArgs { cullers: system.cullers(), schedule }
}

/// How a system walks at an error bound.
pub(super) fn plan(args: &CompareArgs, system: System, epsilon: f64, mode: Mode) -> Result<Plan, Failure> {
    let pace = match mode {
        Mode::Live(hz) => Pace::Live { hz },
        _ => Pace::Lockstep,
    };
    let plan = walking::plan(&args.walk, cullers(system), epsilon, system.culling(), false, pace)?;
    let audit_every = if mode == Mode::Audited { args.walk.audit_every } else { 0 };
    Ok(Plan { alone: matches!(mode, Mode::Alone | Mode::Audited), audit_every, ..plan })
}

/// How many walks a comparison takes.
fn steps(args: &CompareArgs) -> usize {
    let (all, different) = (args.systems.len(), by_work(&args.systems).count());
    let paths = args.paths as usize;
    let tables = args.epsilon.len() * paths * (all + different);
    let curve = args.curve.iter().filter(|px| !args.epsilon.contains(px)).count() * paths * different;
    let coherence = if args.no_coherence { 0 } else { Coherence::ALL.len() * different };
    tables + curve + coherence + args.live.len() * all
}
