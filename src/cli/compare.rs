//! `trimaran compare`: compares systems on one scene and one path.

mod audit;
mod lag;
mod walks;

use trimaran::{
    comparison::{
        Coherence, ComparedPicture, System,
        schema::{
            AloneFigures, COMPARISON_VERSION, CoherencePoint, Comparison, ComparisonTable, CurvePoint,
            DrawnFigures, ExactFrame, FrameCost, MeasuredFigures, SystemFigures, SystemFrame,
        },
        summary, write,
    },
    report::{
        Report,
        schema::{Stat, timestamp},
    },
    walkthrough::{CameraPath, Plan, scene_info},
};

use trimaran_proto::LodRule;

use self::{
    audit::References,
    walks::{Comparing, Mode},
};
use super::{
    Failure,
    args::{CompareArgs, LinkKind},
    print_json, walking,
};

pub(super) fn run(args: &CompareArgs) -> Result<(), Failure> {
    let args = &args.quickened();
    check(args)?;
    std::fs::create_dir_all(&args.out)
        .map_err(|cause| Failure::bad_input(format!("cannot write to {}: {cause}", args.out.display())))?;
    let comparing = Comparing::open(args)?;
    let (mut found, mut pictures) = (about(&comparing), Vec::new());
    let ended = comparing.fill(&mut found, &mut pictures);
    comparing.bar.finish_and_clear();
    if found.tables.is_empty() {
        return ended;
    }
    if let Err(failure) = &ended {
        found.notes.push(format!("ended early: {failure}"));
    }
    let page = write(&args.out, &found, &pictures).map_err(Failure::broken)?;
    if args.json {
        print_json(&found)?;
    } else {
        print!("{}", summary(&found));
        println!("page: {}", page.display());
    }
    ended.map_err(|why| {
        Failure::incomplete(format!("the comparison ended early, and its page says so: {why}"))
    })
}

fn check(args: &CompareArgs) -> Result<(), Failure> {
    let CompareArgs { walk, link, .. } = args;
    if walk.alone {
        return Err(Failure::bad_input("a comparison walks with --alone and without: leave --alone out"));
    }
    if walk.few_pixels {
        return Err(Failure::bad_input("--few-pixels lets pictures depend on the culling: leave it out"));
    }
    if *link == LinkKind::Inproc {
        return Err(Failure::bad_input(
            "--link joins the processes of a system: give unix, tcp, quic or udp",
        ));
    }
    Ok(())
}

/// The parts of a comparison beside its figures.
fn about(comparing: &Comparing<'_>) -> Comparison {
    let Comparing { args, drawn, paths, .. } = comparing;
    let info = drawn.gpu().info();
    Comparison {
        schema_version: COMPARISON_VERSION,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command_line: std::env::args().collect(),
        started: timestamp(walking::date()),
        scene: scene_info(&comparing.file),
        device: info.name.clone(),
        driver: info.driver.clone(),
        cores: std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32),
        width: args.walk.size.width,
        height: args.walk.size.height,
        path: args.walk.path.clone(),
        seed: (args.walk.path == "auto").then_some(args.walk.seed),
        paths: args.paths,
        frames: paths.first().map_or(0, |path| path.cameras.frames()),
        link: comparing.link_name(),
        ..Comparison::default()
    }
}

/// The walks at one error bound.
struct Walked {
    table: ComparisonTable,
    points: Vec<CurvePoint>,
    /// Why some paths were not walked.
    ended: Result<(), Failure>,
}

impl Comparing<'_> {
    /// Walks all requested paths. Results from before a failure stay.
    fn fill(&self, found: &mut Comparison, pictures: &mut Vec<ComparedPicture>) -> Result<(), Failure> {
        let mut bounds = self.args.epsilon.clone();
        bounds.extend(self.args.curve.iter().filter(|px| !self.args.epsilon.contains(px)));
        let mut references = References::find(self, &bounds)?;
        found.popping = references.popping();
        for &epsilon in &self.args.epsilon {
            let Walked { table, points, ended } = self.table(epsilon, &mut references)?;
            found.paths = found.paths.min(table.paths());
            found.tables.push(table);
            ended?;
            pictures.extend(references.pictures(&Plan { lod: lod(epsilon)?, ..self.first_plan })?);
            if self.args.curve.contains(&epsilon) {
                found.curve.extend(points);
            }
        }
        for &epsilon in self.args.curve.iter().filter(|px| !self.args.epsilon.contains(px)) {
            for (index, path) in (0..).zip(&self.paths) {
                for system in self.by_work() {
                    let report = self.audited(system, epsilon, index, path, &mut references)?;
                    found.curve.extend(self.all_of(system).map(|system| point(system, index, &report)));
                }
            }
        }
        let Some(&epsilon) = self.args.epsilon.first() else { return Ok(()) };
        if !self.args.no_coherence {
            self.coherence(epsilon, &mut found.coherence)?;
        }
        self.lag(epsilon, &mut references, &mut found.lag)
    }

    /// All systems at one error bound, path by path, so that other load on the machine affects them equally.
    /// If it ends early, with the paths that all have walked, if there are any.
    fn table(&self, epsilon: f64, references: &mut References) -> Result<Walked, Failure> {
        let mut alone: Vec<(System, Vec<Report>)> =
            self.by_work().map(|system| (system, Vec::new())).collect();
        let mut measured: Vec<(System, Vec<Report>)> =
            self.args.systems.iter().map(|system| (*system, Vec::new())).collect();
        let mut walk = |index, path| {
            for (system, reports) in &mut alone {
                reports.push(self.audited(*system, epsilon, index, path, references)?);
            }
            for (system, reports) in &mut measured {
                reports.push(self.walk(*system, epsilon, Mode::Measured, path)?);
            }
            Ok(())
        };
        let ended = (0..).zip(&self.paths).try_for_each(|(index, path)| walk(index, path));
        let whole = measured.iter().map(|(_, reports)| reports.len()).min().unwrap_or(0);
        alone.iter_mut().chain(&mut measured).for_each(|(_, reports)| reports.truncate(whole));
        let ended = match ended {
            Err(failure) if whole == 0 => return Err(failure),
            ended => ended,
        };
        let figures = |(system, measured): &(System, Vec<Report>)| {
            let (_, alone) = alone.iter().find(|(other, _)| other.same_work(*system))?;
            Some(figures(*system, alone, measured))
        };
        let systems: Vec<_> = measured.iter().filter_map(figures).collect();
        let points = alone.iter().flat_map(|(of, reports)| {
            let points = (0..).zip(reports);
            points.flat_map(|(path, report)| self.all_of(*of).map(move |system| point(system, path, report)))
        });
        let points = points.collect();
        let mut exact = exact(references, epsilon);
        exact.retain(|frame| (frame.path as usize) < whole);
        Ok(Walked { table: ComparisonTable { epsilon_px: epsilon, exact, systems }, points, ended })
    }

    /// The same at other speeds along the path.
    fn coherence(&self, epsilon: f64, found: &mut Vec<CoherencePoint>) -> Result<(), Failure> {
        let Some(first) = self.paths.first() else { return Ok(()) };
        for coherence in Coherence::ALL {
            let poses = coherence.path(&first.poses).map_err(Failure::broken)?;
            let mut walked = Vec::new();
            for system in self.by_work() {
                let path = self.path_of(system, epsilon, &poses)?;
                walked.push((system, self.walk_on(system, epsilon, Mode::Alone, &path)?, path));
            }
            let exact = walked.iter().find(|(system, ..)| *system == System::Exact);
            let exact = exact.map(|(_, report, _)| report.clone());
            for (system, report, path) in &walked {
                let (step_m, turn_deg) = motion(path);
                let cost = FrameCost::of(report);
                let nodes_over_exact = exact.as_ref().and_then(|exact| nodes_over(report, exact));
                found.extend(self.all_of(*system).map(|system| CoherencePoint {
                    system,
                    coherence,
                    epsilon_px: epsilon,
                    step_m,
                    turn_deg,
                    cost,
                    nodes_over_exact,
                }));
            }
        }
        Ok(())
    }
}

fn lod(epsilon: f64) -> Result<LodRule, Failure> {
    LodRule::new(epsilon).map_err(Failure::bad_input)
}

/// A row of a table.
fn figures(system: System, alone: &[Report], measured: &[Report]) -> SystemFigures {
    let median = |reports: &[Report], key: &str| -> Vec<f64> {
        reports.iter().filter_map(|report| Some(report.summary.metrics.get(key)?.median)).collect()
    };
    let models = || alone.iter().filter_map(|report| report.summary.model);
    let frames = alone.first().map_or_else(Vec::new, |report| {
        let intervals = report.modelled_intervals_ms();
        let frame = |(frame, modelled_ms): (&trimaran::report::Frame, Option<f64>)| SystemFrame {
            frame: frame.frame,
            modelled_ms,
            objects: frame.objects_drawn.unwrap_or(0),
            triangles: frame.triangles_drawn.unwrap_or(0),
        };
        report.frames.iter().zip(intervals).map(frame).collect()
    });
    SystemFigures {
        system,
        alone: AloneFigures {
            or_ms: median(alone, "or_ms"),
            hc_ms: median(alone, "hc_ms"),
            rvg_ms: median(alone, "rvg_ms"),
            model_fps: models().map(|model| model.fps).collect(),
            model_fps_at_least: models().map(|model| model.fps_at_least).collect(),
            model_latency_ms: models().map(|model| model.latency_ms).collect(),
        },
        measured: MeasuredFigures {
            processes: system.processes(),
            fps: measured.iter().filter_map(|report| report.summary.measured_fps).collect(),
            latency_ms: median(measured, "latency_ms"),
        },
        drawn: alone
            .iter()
            .zip(measured)
            .map(|(alone, measured)| DrawnFigures { bytes: bytes(measured), ..DrawnFigures::of(alone) })
            .collect(),
        frames,
    }
}

/// Bytes sent a frame, mean.
fn bytes(report: &Report) -> f64 {
    let bytes: u64 = report.frames.iter().filter_map(|frame| frame.bytes).sum();
    bytes as f64 / report.frames.len().max(1) as f64
}

fn point(system: System, path: u32, report: &Report) -> CurvePoint {
    let metrics = &report.summary.metrics;
    CurvePoint {
        system,
        epsilon_px: report.run.epsilon_px,
        path,
        cost: FrameCost::of(report),
        flip_mean: metrics.get("flip_mean").map(|stat| stat.median),
        silhouette_max_px: metrics.get("silhouette_max_px").map(|stat| stat.max),
        surface_max_px: metrics.get("surface_max_px").map(|stat| stat.max),
        wrong_pixels: report.summary.cut_mismatch_pixels_total.unwrap_or(0),
    }
}

fn exact(references: &References, epsilon: f64) -> Vec<ExactFrame> {
    let frame = |((path, frame), reference): ((u32, u32), &trimaran::walkthrough::Reference)| ExactFrame {
        path,
        frame,
        nodes: reference.exact.len() as u64,
        objects: reference.objects,
        triangles: reference.triangles,
    };
    references.at(epsilon).map(frame).collect()
}

/// Nodes drawn over nodes exactly visible, median over the frames that show something.
fn nodes_over(report: &Report, exact: &Report) -> Option<f64> {
    let nodes = |report: &Report| -> Vec<u64> {
        report.frames.iter().map(|frame| frame.nodes_drawn.unwrap_or(0)).collect()
    };
    let pairs = nodes(report).into_iter().zip(nodes(exact)).filter(|(_, exact)| *exact > 0);
    Stat::of(pairs.map(|(drawn, exact)| drawn as f64 / exact as f64)).map(|stat| stat.median)
}

/// How far the eye moves between two frames, metres, and turns, degrees: medians.
fn motion(path: &CameraPath) -> (f64, f64) {
    let pairs = || path.poses().frames().windows(2).filter_map(<[_]>::first_chunk::<2>);
    let median = |values: Vec<f64>| Stat::of(values).map_or(0.0, |stat| stat.median);
    let step = median(pairs().map(|[a, b]| a.eye().distance(b.eye())).collect());
    let turn = pairs().map(|[a, b]| a.orientation().angle_between(b.orientation()).to_degrees()).collect();
    (step, median(turn))
}
