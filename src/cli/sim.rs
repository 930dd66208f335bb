//! `trimaran sim`: simulates three roles on a network before it is bought.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;
use trimaran::simulate::{
    Geometry, Knobs, Load, Outcome, Painter, Scenario, SimulateError, Times, Transport, Workload, frames_csv,
    page, pooled, runs_csv, simulate_watched, tables,
};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_netsim::Profile;
use trimaran_proto::{BatchSize, IdCoding};
use trimaran_scene::Scene;

use super::{
    Failure,
    args::{Coding, CullerArgs, SimArgs, SimLink},
    print_json, printed, progress,
    walking::{gpu_options, open},
};

/// How long each role computes by default.
const USUAL: Duration = Duration::from_millis(5);

pub(super) fn run(args: &SimArgs) -> Result<(), Failure> {
    let scene = args.scene.as_deref().map(|path| Ok::<_, Failure>(open(path)?.scene)).transpose()?;
    let scenarios = scenarios(args, scene.as_ref())?;
    warn_of_deadlines(&scenarios);
    warn_of_idle_flags(args);
    // Before anything is simulated: that may take long.
    for folder in [&args.pcap, &args.out].into_iter().flatten() {
        fs::create_dir_all(folder).map_err(|cause| unwritten(folder, &cause))?;
    }
    let frames = scenarios.iter().map(|scenario| u64::from(scenario.frames)).sum();
    let bar = progress::bar("simulating", frames);
    // Each run has one thread, and its outcome a fixed place: more cores change only the time.
    let runs: Result<Vec<Outcome>, _> = scenarios
        .par_iter()
        .map(|scenario| {
            let capture = args.pcap.as_ref().map(|folder| capture(scenario, folder)).transpose()?;
            simulate_watched(scenario, capture, || bar.inc(1)).map_err(Failure::broken)
        })
        .collect();
    bar.finish_and_clear();
    let mut runs = runs?;
    if let Some(scene) = scene.filter(|_| !args.empty_display) {
        draw_gaps(&scene, args.device.as_deref(), &scenarios, &mut runs)?;
    }
    let pooled = pooled(&runs);
    if let Some(folder) = &args.out {
        let write = |name: &str, text: &str| fs::write(folder.join(name), text);
        let command: Vec<String> = std::env::args().collect();
        let json = serde_json::to_string_pretty(&runs).map_err(Failure::broken)?;
        write("sim.json", &json)
            .and_then(|()| write("runs.csv", &runs_csv(&pooled)))
            .and_then(|()| write("frames.csv", &frames_csv(&runs)))
            .and_then(|()| write("sim.html", &page(&pooled, &command)))
            .map_err(|cause| unwritten(folder, &cause))?;
    }
    if args.json {
        return print_json(&runs);
    }
    printed(write!(super::terminal::stdout(), "{}", tables(&pooled)))
}

fn unwritten(place: &Path, cause: &io::Error) -> Failure {
    Failure::broken(format!("cannot write to {}: {cause}", place.display()))
}

/// Every network with every transport, number of cullers, schedule, number of ids, batch and seed; seeds of
/// the same are neighbours.
fn scenarios(args: &SimArgs, scene: Option<&Arc<Scene>>) -> Result<Vec<Scenario>, Failure> {
    let networks: Vec<Profile> = (args.network.iter())
        .map(|name| Profile::find(name).map_err(Failure::bad_input))
        .collect::<Result<_, _>>()?;
    let batches: Vec<BatchSize> = (args.batch.iter())
        .map(|batch| BatchSize::new(u32::from(*batch)).map_err(Failure::bad_input))
        .collect::<Result<_, _>>()?;
    if args.trace.is_none() && args.coding == Coding::Changes {
        return Err(Failure::bad_input("--coding changes needs --trace: made-up frames are all alike"));
    }
    let workloads = workloads(args)?;
    if let Some(scene) = scene {
        for workload in &workloads {
            let trace = workload.trace().ok_or_else(no_ids)?;
            trace.check_scene(scene.hash()).map_err(Failure::bad_input)?;
        }
    }
    let geometry = scene
        .filter(|_| args.empty_display)
        .map(|scene| Geometry { scene: Arc::clone(scene), cache: args.geometry_cache.as_u64() });
    let shared = args.cullers.combinations()?;
    if geometry.is_some() && shared.iter().any(|at| at.cullers == 0) {
        return Err(Failure::bad_input(SimulateError::NoSupplier));
    }
    let mut sessions = Vec::new();
    for (link, knobs) in args.link.iter().flat_map(|link| knobs(args, *link)) {
        sessions.extend(shared.iter().map(|at| (link, knobs, *at)));
    }
    // A seed given twice would count the same frames twice.
    let seeds: BTreeSet<u64> = args.seed.iter().copied().collect();
    let mut scenarios = Vec::new();
    for network in &networks {
        for (link, knobs, CullerArgs { cullers, schedule }) in &sessions {
            for workload in &workloads {
                for batch in &batches {
                    scenarios.extend(seeds.iter().map(|seed| Scenario {
                        network: network.clone(),
                        link: *link,
                        cullers: usize::from(*cullers),
                        schedule: (*schedule).into(),
                        batch: *batch,
                        frames: args.frames,
                        seed: *seed,
                        workload: workload.clone(),
                        geometry: geometry.clone(),
                        knobs: *knobs,
                    }));
                }
            }
        }
    }
    Ok(scenarios)
}

fn no_ids() -> Failure {
    Failure::bad_input("--scene needs a --trace with ids: one that `trimaran run --record` wrote")
}

/// Warns of deadlines that end before anything can have arrived.
fn warn_of_deadlines(scenarios: &[Scenario]) {
    let deadline_too_short = scenarios.iter().filter(|scenario| scenario.gives_up_everything());
    let mut said: Vec<String> = deadline_too_short
        .map(|Scenario { network, link, knobs, .. }| {
            let (deadline, way) = (knobs.deadline, network.one_way_delay());
            let (name, link) = (&network.name, link.name());
            format!(
                "trimaran: a frame over {link} may take {deadline:?}, and by {name} the way to the display alone takes {way:?}: what is lost, or \
                 waits at its end, is given up, and many will have gaps; take a longer --udp-deadline-ms, or --link udp"
            )
        })
        .collect();
    said.dedup();
    for line in said {
        eprintln!("{line}");
    }
}

/// Warns of flags for links that are not simulated.
fn warn_of_idle_flags(args: &SimArgs) {
    let none_of = |links: &[SimLink]| !args.link.iter().any(|link| links.contains(link));
    let idle = |flag: &str| eprintln!("trimaran: {flag} changes nothing over the links that --link names");
    if none_of(&[SimLink::UdpDeadline]) && args.udp_deadline_ms != [50.0] {
        idle("--udp-deadline-ms");
    }
    if none_of(&[SimLink::Udp, SimLink::UdpDeadline]) {
        if args.udp_repair != [15] {
            idle("--udp-repair");
        }
        if args.udp_in_the_clear {
            idle("--udp-in-the-clear");
        }
    }
}

fn workloads(args: &SimArgs) -> Result<Vec<Workload>, Failure> {
    let time = |ms: Option<f64>| ms.map(|ms| Duration::from_secs_f64(ms / 1e3));
    let times = Times { or: time(args.or_ms), hc: time(args.hc_ms), rvg: time(args.rvg_ms) };
    if let Some(trace) = &args.trace {
        return Ok(vec![Workload::recorded(trace).map_err(Failure::bad_input)?.taking(times)]);
    }
    let [or, hc, rvg] = [times.or, times.hc, times.rvg].map(|time| time.unwrap_or(USUAL));
    Ok(args.nodes.iter().map(|nodes| Workload::steady(Load { nodes: *nodes, or, hc, rvg })).collect())
}

/// A transport in each requested mode.
fn knobs(args: &SimArgs, link: SimLink) -> Vec<(Transport, Knobs)> {
    let usual = Knobs {
        coding: IdCoding::from(args.coding),
        in_the_clear: args.udp_in_the_clear,
        ..Knobs::default()
    };
    let deadline = |ms: &f64| Duration::from_secs_f64(ms / 1e3);
    let repairs = || args.udp_repair.iter().map(|percent| Knobs { repair_percent: *percent, ..usual });
    match link {
        SimLink::Tcp => vec![(Transport::Tcp, usual)],
        SimLink::Ws => vec![(Transport::Ws, usual)],
        SimLink::Quic => vec![(Transport::Quic, usual)],
        SimLink::Udp => repairs().map(|knobs| (Transport::Udp, knobs)).collect(),
        SimLink::UdpDeadline => (args.udp_deadline_ms.iter())
            .flat_map(|ms| repairs().map(|knobs| Knobs { deadline: deadline(ms), ..knobs }))
            .map(|knobs| (Transport::UdpDeadline, knobs))
            .collect(),
    }
}

/// Opens a packet capture for a run, with a name that identifies the run.
fn capture(scenario: &Scenario, folder: &Path) -> Result<Box<dyn Write + Send>, Failure> {
    let Scenario { network, link, batch, seed, workload, knobs, .. } = scenario;
    // A file's name cannot hold path separators.
    let network = network.name.replace(['/', '\\'], "-");
    let repair = knobs.repair_percent;
    let mode = match link {
        Transport::Tcp | Transport::Ws | Transport::Quic => String::new(),
        Transport::Udp => format!("-r{repair}"),
        Transport::UdpDeadline => format!("-{}ms-r{repair}", knobs.deadline.as_secs_f64() * 1e3),
    };
    let (link, nodes, batch) = (link.name(), workload.of(0).nodes, batch.items());
    let path = folder.join(format!("{network}-{link}{mode}-n{nodes}-b{batch}-s{seed}.pcapng"));
    let file = File::create(&path).map_err(|cause| unwritten(&path, &cause))?;
    Ok(Box::new(BufWriter::new(file)))
}

/// Draws the pictures of displays that got only a part of a frame.
fn draw_gaps(
    scene: &Arc<Scene>,
    device: Option<&str>,
    scenarios: &[Scenario],
    runs: &mut [Outcome],
) -> Result<(), Failure> {
    let Some(trace) = scenarios.first().and_then(|scenario| scenario.workload.trace()) else {
        return Err(no_ids());
    };
    let gpu = Gpu::open(&gpu_options(device, None, GpuOptions::TIMEOUT.as_secs_f64(), false))
        .map_err(Failure::broken)?;
    let drawn = GpuScene::new(&gpu, scene).map_err(Failure::broken)?;
    let mut painter = Painter::new(scene, &drawn, trace).map_err(Failure::bad_input)?;
    let bar = progress::bar("drawing", runs.len() as u64);
    for (run, scenario) in runs.iter_mut().zip(scenarios) {
        run.pixels = Some(painter.cost(&scenario.workload, run).map_err(Failure::broken)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}
