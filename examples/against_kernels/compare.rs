//! The table.

use std::error::Error;
use std::time::Duration;

use trimaran::netem::Emulation;
use trimaran::simulate::{FrameTimes, Knobs, Load, Scenario, Transport, Workload, simulate};
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

use crate::real::play;

/// What is compared unless something else is asked for.
const NETWORKS: [&str; 3] = ["fast-ethernet", "wifi", "wan-20ms"];
const LINKS: [Transport; 3] = [Transport::Tcp, Transport::Quic, Transport::Udp];
const FRAMES: u32 = 500;
/// Where packets are lost the medians of runs differ by a millisecond (standard deviation): a few runs say little.
const RUNS: u64 = 6;
/// The simulator takes so many seeds for each of a real run.
const SEEDS_A_RUN: u64 = 5;
/// The first frames are left out: connections begin slowly.
const WARM_UP: usize = 20;

/// What is compared.
struct Plan {
    networks: Vec<String>,
    links: Vec<Transport>,
    frames: u32,
    runs: u64,
    csv: bool,
}

impl Plan {
    fn parse(words: impl Iterator<Item = String>) -> Result<Self, Box<dyn Error>> {
        let mut plan =
            Self { networks: Vec::new(), links: Vec::new(), frames: FRAMES, runs: RUNS, csv: false };
        let mut words = words;
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a number"));
            match word.as_str() {
                "--frames" => plan.frames = value()?.parse()?,
                "--runs" => plan.runs = value()?.parse()?,
                "--csv" => plan.csv = true,
                name => match LINKS.into_iter().find(|link| link.name() == name) {
                    Some(link) => plan.links.push(link),
                    None => plan.networks.push(name.to_owned()),
                },
            }
        }
        if plan.networks.is_empty() {
            plan.networks = NETWORKS.map(str::to_owned).to_vec();
        }
        if plan.links.is_empty() {
            plan.links = LINKS.to_vec();
        }
        Ok(plan)
    }
}

/// What some runs of the same scenario were like.
#[derive(Default)]
struct Sample {
    /// Milliseconds, rising.
    latencies: Vec<f64>,
    /// Of each run.
    medians: Vec<f64>,
    late: usize,
    bytes: f64,
    frames: f64,
}

impl Sample {
    fn add(&mut self, times: &[FrameTimes], bytes: f64) {
        let times = times.get(WARM_UP..).unwrap_or_default();
        let mut run: Vec<f64> =
            times.iter().map(|frame| millis(frame.shown.since(frame.published))).collect();
        run.sort_by(f64::total_cmp);
        self.medians.push(at(&run, 0.5));
        self.latencies.extend(run);
        self.latencies.sort_by(f64::total_cmp);
        let gaps = times.windows(2).filter_map(|pair| {
            let [before, after] = pair else { return None };
            Some(millis(after.shown.since(before.shown)))
        });
        self.late += gaps.filter(|gap| *gap > 1e3 / 30.0).count();
        self.bytes += bytes;
    }

    /// How far the median may be off by chance: the standard error of the runs' medians.
    fn error(&self) -> f64 {
        let count = self.medians.len() as f64;
        let mean = self.medians.iter().sum::<f64>() / count;
        let squares: f64 = self.medians.iter().map(|median| (median - mean).powi(2)).sum();
        (squares / (count - 1.0) / count).sqrt()
    }

    fn late_percent(&self) -> f64 {
        100.0 * self.late as f64 / self.latencies.len().max(1) as f64
    }
}

/// The smallest of rising values that so many are not above.
fn at(rising: &[f64], share: f64) -> f64 {
    let rank = (share * rising.len() as f64).ceil() as usize;
    rising.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Compares what the arguments ask for.
pub(crate) fn run(words: impl Iterator<Item = String>) -> Result<(), Box<dyn Error>> {
    let plan = Plan::parse(words)?;
    if let Err(missing) = Emulation::possible() {
        println!("skipped: {missing}");
        return Ok(());
    }
    println!(
        "| network | link | p50 kernel | ± | model | ± | | p99 kernel | model | | bytes a frame kernel | model | | late at 30 kernel | model |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let mut lateness = (0.0_f64, 0.0_f64);
    for name in &plan.networks {
        let network = Profile::find(name)?;
        for &link in &plan.links {
            let (mut kernel, mut model) = (Sample::default(), Sample::default());
            for seed in 1..=plan.runs {
                let played =
                    play(&scenario(&network, link, plan.frames, seed)?).map_err(|e| e.to_string())?;
                kernel.add(&played.times, played.bytes as f64);
                lateness.0 = lateness.0.max(played.report.late.p99_us);
                lateness.1 = lateness.1.max(played.report.late.max_us);
                if plan.csv {
                    print_times("kernel", &played.times);
                }
            }
            for seed in 1..=plan.runs * SEEDS_A_RUN {
                let outcome = simulate(&scenario(&network, link, plan.frames, seed)?)?;
                model.add(&outcome.times, outcome.bytes.total * f64::from(plan.frames));
                if plan.csv {
                    print_times("model", &outcome.times);
                }
            }
            kernel.frames = f64::from(plan.frames) * plan.runs as f64;
            model.frames = kernel.frames * SEEDS_A_RUN as f64;
            print_row(name, link, &kernel, &model);
        }
    }
    println!(
        "\nmilliseconds, ±: standard error of the runs' medians; the network's packets were up to {:.0} us late at the 99th percentile of a run, {:.0} at most",
        lateness.0, lateness.1
    );
    Ok(())
}

fn scenario(network: &Profile, link: Transport, frames: u32, seed: u64) -> Result<Scenario, Box<dyn Error>> {
    let time = Duration::from_millis(5);
    let workload = Workload::steady(Load { nodes: 4000, or: time, hc: time, rvg: time });
    let (network, batch, knobs) = (network.clone(), BatchSize::new(1024)?, Knobs::default());
    Ok(Scenario { network, link, batch, frames, seed, workload, knobs })
}

fn print_row(network: &str, link: Transport, kernel: &Sample, model: &Sample) {
    let off = |real: f64, model: f64| 100.0 * (model / real - 1.0);
    let bytes = [kernel, model].map(|sample| sample.bytes / sample.frames);
    print!("| {network} | {} ", link.name());
    let [real, modelled] = [kernel, model].map(|sample| at(&sample.latencies, 0.5));
    let [chance, modelled_chance] = [kernel, model].map(Sample::error);
    print!(
        "| {real:.2} | {chance:.2} | {modelled:.2} | {modelled_chance:.2} | {:+.1} % ",
        off(real, modelled)
    );
    let [real, modelled] = [kernel, model].map(|sample| at(&sample.latencies, 0.99));
    print!("| {real:.2} | {modelled:.2} | {:+.1} % ", off(real, modelled));
    let [real, modelled] = bytes;
    print!("| {real:.0} | {modelled:.0} | {:+.1} % ", off(real, modelled));
    println!("| {:.1} % | {:.1} % |", kernel.late_percent(), model.late_percent());
}

/// When what happened to each frame, microseconds since its camera left.
fn print_times(what: &str, times: &[FrameTimes]) {
    for (frame, times) in times.iter().enumerate() {
        let since = |at: trimaran_transport::Instant| at.since(times.published).as_micros();
        println!(
            "{what},{frame},{},{},{},{},{},{}",
            since(times.taken),
            since(times.fed),
            since(times.occluded),
            since(times.culled),
            since(times.arrived),
            since(times.shown)
        );
    }
}
