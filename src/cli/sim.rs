//! `trimaran sim`: what three roles see on a network, before it is bought.

use std::fs;
use std::io::Write;
use std::time::Duration;

use trimaran::report::text;
use trimaran::simulate::{Load, Outcome, Scenario, Transport, Workload, simulate};
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

use super::{
    Failure,
    args::{SimArgs, SimLink},
    print_json, progress,
};

pub(super) fn run(args: &SimArgs) -> Result<(), Failure> {
    let scenarios = scenarios(args)?;
    let bar = progress::bar("simulating", scenarios.len() as u64);
    let mut outcomes = Vec::new();
    for scenario in &scenarios {
        outcomes.push(simulate(scenario).map_err(Failure::broken)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        let write = |name: &str, text: &str| fs::write(folder.join(name), text);
        fs::create_dir_all(folder)
            .and_then(|()| write("sim.json", &serde_json::to_string_pretty(&outcomes)?))
            .and_then(|()| write("frames.csv", &frames_csv(&outcomes)))
            .map_err(Failure::broken)?;
    }
    if args.json {
        return print_json(&outcomes);
    }
    let mut out = std::io::stdout().lock();
    let written = write!(out, "{}", text::simulations(&outcomes));
    written.map_err(Failure::broken)
}

fn scenarios(args: &SimArgs) -> Result<Vec<Scenario>, Failure> {
    let workload = match &args.trace {
        Some(report) => Workload::recorded(report).map_err(Failure::bad_input)?,
        None => {
            let time = |ms: f64| Duration::from_secs_f64(ms / 1e3);
            let (or, hc, rvg) = (time(args.or_ms), time(args.hc_ms), time(args.rvg_ms));
            Workload::steady(Load { nodes: args.nodes, or, hc, rvg })
        }
    };
    let mut scenarios = Vec::new();
    for name in &args.network {
        let network = Profile::find(name).map_err(Failure::bad_input)?;
        for link in &args.link {
            for batch in &args.batch {
                scenarios.push(Scenario {
                    network: network.clone(),
                    link: match link {
                        SimLink::Tcp => Transport::Tcp,
                        SimLink::Quic => Transport::Quic,
                        SimLink::Udp => Transport::Udp,
                    },
                    batch: BatchSize::new(u32::from(*batch)).map_err(Failure::bad_input)?,
                    frames: args.frames,
                    seed: args.seed,
                    workload: workload.clone(),
                });
            }
        }
    }
    Ok(scenarios)
}

/// When what happened to each frame, in nanoseconds of the run's own clock.
fn frames_csv(outcomes: &[Outcome]) -> String {
    let mut csv = "network,link,batch,frame,nodes,published_ns,taken_ns,fed_ns,occluded_ns,culled_ns,arrived_ns,shown_ns\n".to_owned();
    for outcome in outcomes {
        for (frame, times) in outcome.times.iter().enumerate() {
            let moments = [
                times.published,
                times.taken,
                times.fed,
                times.occluded,
                times.culled,
                times.arrived,
                times.shown,
            ];
            let moments: Vec<String> = moments.iter().map(|at| at.as_nanos().to_string()).collect();
            csv += &format!(
                "{},{},{},{frame},{},{}\n",
                outcome.network,
                outcome.link.name(),
                outcome.batch,
                times.nodes,
                moments.join(",")
            );
        }
    }
    csv
}
