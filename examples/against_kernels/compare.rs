//! The table.

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use trimaran::netem::Emulation;
use trimaran::simulate::{FrameTimes, Knobs, Load, Scenario, Transport, Workload, simulate};
use trimaran_actors::Schedule;
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

use crate::real::play;

/// The default networks.
const NETWORKS: [&str; 3] = ["fast-ethernet", "wifi", "wan-20ms"];
const LINKS: [Transport; 3] = [Transport::Tcp, Transport::Quic, Transport::Udp];
const FRAMES: u32 = 500;
/// With packet loss the medians of runs have a standard deviation of a millisecond: a few runs say little.
const RUNS: u64 = 6;
/// How many seeds the simulator takes for each real run.
const SEEDS_A_RUN: u64 = 5;
/// The allowed errors of the simulator, percent: at the median, at the 99th percentile, in bytes, and in
/// frames a second.
const AIMS: [f64; 4] = [5.0, 15.0, 2.0, 5.0];
/// The first frames are left out: connections begin slowly.
const WARM_UP: usize = 20;

/// The parameters of a comparison.
struct Plan {
    networks: Vec<String>,
    links: Vec<Transport>,
    frames: u32,
    runs: u64,
    csv: bool,
    /// A recorded walk, with the roles' computing times.
    trace: Option<PathBuf>,
    cullers: usize,
    schedule: Schedule,
}

impl Plan {
    fn parse(words: impl Iterator<Item = String>) -> Result<Self, Box<dyn Error>> {
        let mut plan = Self {
            networks: Vec::new(),
            links: Vec::new(),
            frames: FRAMES,
            runs: RUNS,
            csv: false,
            trace: None,
            cullers: 2,
            schedule: Schedule::Independent,
        };
        let mut words = words;
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
            match word.as_str() {
                "--frames" => plan.frames = value()?.parse()?,
                "--runs" => plan.runs = value()?.parse()?,
                "--csv" => plan.csv = true,
                "--trace" => plan.trace = Some(value()?.into()),
                "--cullers" => plan.cullers = value()?.parse()?,
                "--schedule" => plan.schedule = value()?.parse()?,
                name => match LINKS.into_iter().find(|link| link.name() == name) {
                    Some(link) => plan.links.push(link),
                    None => plan.networks.push(name.to_owned()),
                },
            }
        }
        if plan.runs < 2 {
            return Err("--runs needs two at least: one says nothing of chance".into());
        }
        if plan.networks.is_empty() {
            plan.networks = NETWORKS.map(str::to_owned).to_vec();
        }
        if plan.links.is_empty() {
            plan.links = LINKS.to_vec();
        }
        Ok(plan)
    }

    fn scenario(&self, network: &Profile, link: Transport, seed: u64) -> Result<Scenario, Box<dyn Error>> {
        let time = Duration::from_millis(5);
        let workload = match &self.trace {
            Some(trace) => Workload::recorded(trace)?,
            None => Workload::steady(Load { nodes: 4000, or: time, hc: time, rvg: time }),
        };
        let (network, batch, knobs) = (network.clone(), BatchSize::new(1024)?, Knobs::default());
        let &Self { cullers, schedule, frames, .. } = self;
        let geometry = None;
        Ok(Scenario { network, link, cullers, schedule, batch, frames, seed, workload, geometry, knobs })
    }
}

/// The results of some runs of the same scenario.
#[derive(Default)]
struct Sample {
    /// Milliseconds, ascending.
    latencies: Vec<f64>,
    /// For each run: the median, the 99th percentile, bytes a frame, and frames a second.
    medians: Vec<f64>,
    tails: Vec<f64>,
    bytes: Vec<f64>,
    /// Frames a second.
    rates: Vec<f64>,
    late: usize,
}

impl Sample {
    fn add(&mut self, times: &[FrameTimes], bytes_a_frame: f64) {
        let times = times.get(WARM_UP..).unwrap_or_default();
        let mut run: Vec<f64> =
            times.iter().map(|frame| millis(frame.shown.since(frame.published))).collect();
        run.sort_by(f64::total_cmp);
        self.medians.push(at(&run, 0.5));
        self.tails.push(at(&run, 0.99));
        self.latencies.extend(run);
        self.latencies.sort_by(f64::total_cmp);
        let gaps = times.windows(2).filter_map(|pair| {
            let [before, after] = pair else { return None };
            Some(millis(after.shown.since(before.shown)))
        });
        self.late += gaps.filter(|gap| *gap > 1e3 / 30.0).count();
        self.bytes.push(bytes_a_frame);
        if let [first, .., last] = times {
            self.rates.push(1e3 * (times.len() - 1) as f64 / millis(last.shown.since(first.shown)));
        }
    }

    /// The median and the 99th percentile of all frames, the mean bytes of a frame, and frames a second; each
    /// with its standard error.
    fn figures(&self) -> [(f64, f64); 4] {
        [
            (at(&self.latencies, 0.5), error(&self.medians)),
            (at(&self.latencies, 0.99), error(&self.tails)),
            (mean(&self.bytes), error(&self.bytes)),
            (mean(&self.rates), error(&self.rates)),
        ]
    }

    fn late_percent(&self) -> f64 {
        100.0 * self.late as f64 / self.latencies.len().max(1) as f64
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The standard error of the runs' values.
fn error(values: &[f64]) -> f64 {
    let (count, mean) = (values.len() as f64, mean(values));
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (count - 1.0) / count).sqrt()
}

/// The smallest of ascending values that this share does not exceed.
fn at(rising: &[f64], share: f64) -> f64 {
    let rank = (share * rising.len() as f64).ceil() as usize;
    rising.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Runs the comparison given by the arguments.
pub(crate) fn run(words: impl Iterator<Item = String>) -> Result<(), Box<dyn Error>> {
    let plan = Plan::parse(words)?;
    if let Err(missing) = Emulation::possible() {
        println!("skipped: {missing}");
        return Ok(());
    }
    println!(
        "| network | link | p50 kernel | model | | p99 kernel | model | | bytes a frame kernel | model | | frames/s kernel | model | | late kernel | model |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let mut lateness = (0.0_f64, 0.0_f64);
    for name in &plan.networks {
        let network = Profile::find(name)?;
        for &link in &plan.links {
            let (mut kernel, mut model) = (Sample::default(), Sample::default());
            for seed in 1..=plan.runs {
                let played = play(&plan.scenario(&network, link, seed)?).map_err(|e| e.to_string())?;
                kernel.add(&played.times, played.bytes as f64 / f64::from(plan.frames));
                lateness.0 = lateness.0.max(played.report.late.p99_us);
                lateness.1 = lateness.1.max(played.report.late.max_us);
                if plan.csv {
                    print_times("kernel", &played.times);
                }
            }
            for seed in 1..=plan.runs * SEEDS_A_RUN {
                let outcome = simulate(&plan.scenario(&network, link, seed)?)?;
                model.add(&outcome.times, outcome.bytes.total);
                if plan.csv {
                    print_times("model", &outcome.times);
                }
            }
            print_row(name, link, &kernel, &model);
        }
    }
    println!(
        "\n{} runs of {} frames over kernels, {} in the simulator; milliseconds; ±: standard error of the runs' values; bold: more than {} % at p50, {} % at p99, {} % in \
         bytes or {} % in frames a second apart; late: more than a 30th of a second after the picture before. The network's packets were up to {:.0} us late at the 99th percentile of a run, {:.0} at most.",
        plan.runs,
        plan.frames,
        plan.runs * SEEDS_A_RUN,
        AIMS[0],
        AIMS[1],
        AIMS[2],
        AIMS[3],
        lateness.0,
        lateness.1
    );
    Ok(())
}

fn print_row(network: &str, link: Transport, kernel: &Sample, model: &Sample) {
    print!("| {network} | {} ", link.name());
    let pairs = kernel.figures().into_iter().zip(model.figures());
    for (place, (((real, chance), (modelled, modelled_chance)), aim)) in pairs.zip(AIMS).enumerate() {
        let digits = if place == 2 { 0 } else { 2 };
        let off = 100.0 * (modelled / real - 1.0);
        let bold = if off.abs() > aim { "**" } else { "" };
        print!(
            "| {real:.digits$} ± {chance:.digits$} | {modelled:.digits$} ± {modelled_chance:.digits$} | {bold}{off:+.1} %{bold} "
        );
    }
    println!("| {:.1} % | {:.1} % |", kernel.late_percent(), model.late_percent());
}

/// The times of each frame's events, microseconds since its camera left.
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
