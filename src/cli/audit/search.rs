//! `trimaran audit search`: walks at random, until some number of frames was compared.

use std::{fs, io::Write, path::Path};

use serde::Serialize;
use trimaran::audit::{Judgement, KeptTrial, Search, SearchCounts, Wrong};
use trimaran_actors::{Stop, Stopwatch};
use trimaran_gpu::GpuOptions;

use super::super::{
    Failure,
    args::SearchArgs,
    number, plural, print_json, printed, progress, terminal,
    walking::{gpu_options, runtime, stop_on_signal},
};

/// How many walks are shrunk on which only the driver was wrong: there may be many, all alike.
const OF_DRIVER: usize = 3;

/// A search, as it is printed.
#[derive(Serialize)]
struct Report {
    /// The device and its driver.
    driver: String,
    /// The first seed, and the one after the last.
    seeds: [u64; 2],
    seconds: f64,
    #[serde(flatten)]
    counts: SearchCounts,
    /// The wrong pixels, by what a rasterizer in f64 shows.
    judgement: Judgement,
    failures: Vec<FailedTrial>,
}

/// A walk that fails.
#[derive(Serialize)]
struct FailedTrial {
    seed: u64,
    wrong: String,
    /// Where a smallest one was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<String>,
}

pub(super) fn run(args: &SearchArgs) -> Result<(), Failure> {
    let runtime = runtime()?;
    let options = gpu_options(args.device.as_deref(), None, GpuOptions::TIMEOUT.as_secs_f64(), false);
    let mut search = Search::open(options, runtime.handle()).map_err(Failure::broken)?;
    if let Some(file) = &args.replay {
        return replay(&mut search, file);
    }
    let stop = stop_on_signal(&runtime);
    let report = run_trials(args, &mut search, &stop)?;
    if args.json {
        print_json(&report)?;
    } else {
        printed(print(&report))?;
    }
    match report.failures.len() {
        0 if report.counts.frames < args.frames => {
            Err(Failure::incomplete("the search was stopped; it had found nothing"))
        }
        0 => Ok(()),
        failures => {
            let walks = plural(failures as u64, "walk", "walks");
            Err(Failure::broken(format!("culling has changed pixels on {walks}; see above")))
        }
    }
}

fn run_trials(args: &SearchArgs, search: &mut Search, stop: &Stop) -> Result<Report, Failure> {
    let driver = search.driver().map_err(Failure::broken)?;
    let bar = progress::bar("searching", args.frames);
    let clock = Stopwatch::start();
    let (mut failures, mut judgement) = (Vec::new(), Judgement::default());
    let (mut seed, mut of_driver) = (args.seed, 0);
    while search.counts().frames < args.frames && !stop.requested() {
        for (kept, wrong) in search.trial(seed, stop).map_err(Failure::broken)? {
            let is_driver = matches!(&wrong, Wrong::Pixels(_, judged) if judged.is_of_driver());
            if let Wrong::Pixels(_, judged) = &wrong {
                judgement += *judged;
            }
            let mut failed = FailedTrial { seed, wrong: wrong.to_string(), file: None };
            bar.suspend(|| eprintln!("seed {seed}, {}: {wrong}", kept.culling));
            // One walk mostly fails in all systems for one reason.
            let is_first = failures.last().is_none_or(|last: &FailedTrial| last.seed != seed);
            if is_first && (!is_driver || of_driver < OF_DRIVER) {
                of_driver += usize::from(is_driver);
                let (least, wrong) = search.shrink(kept, wrong, stop, || bar.tick());
                let file = args.keep.join(format!("seed-{seed}-{}.json", least.culling));
                write(&file, &least)?;
                bar.suspend(|| {
                    eprintln!(
                        "its smallest walk: {wrong}; trimaran audit search --replay {}",
                        file.display()
                    );
                });
                failed.file = Some(file.display().to_string());
            }
            failures.push(failed);
        }
        seed = seed.wrapping_add(1);
        bar.set_position(search.counts().frames.min(args.frames));
    }
    bar.finish_and_clear();
    let (seeds, seconds) = ([args.seed, seed], clock.elapsed().as_secs_f64());
    Ok(Report { driver, seeds, seconds, counts: search.counts().clone(), judgement, failures })
}

fn replay(search: &mut Search, file: &Path) -> Result<(), Failure> {
    let unread = |cause: &dyn std::fmt::Display| Failure::bad_input(format!("{}: {cause}", file.display()));
    let text = fs::read_to_string(file).map_err(|cause| unread(&cause))?;
    let kept: KeptTrial = serde_json::from_str(&text).map_err(|cause| unread(&cause))?;
    let driver = search.driver().map_err(Failure::broken)?;
    let frames = kept.trial.frames.len();
    match search.replay(&kept).map_err(Failure::broken)? {
        None => {
            let mut out = terminal::stdout();
            printed(writeln!(
                out,
                "{frames} frames by {}, {driver}: no wrong pixel, nothing lost",
                kept.culling
            ))
        }
        Some(wrong) => {
            Err(Failure::broken(format!("{frames} frames by {}, {driver}: {wrong}", kept.culling)))
        }
    }
}

fn write(file: &Path, kept: &KeptTrial) -> Result<(), Failure> {
    let unwritten = |cause: std::io::Error| Failure::broken(format!("writing {}: {cause}", file.display()));
    let text = serde_json::to_string(kept).map_err(Failure::broken)?;
    file.parent().map_or(Ok(()), fs::create_dir_all).map_err(unwritten)?;
    fs::write(file, text + "\n").map_err(unwritten)
}

fn print(report: &Report) -> std::io::Result<()> {
    let Report { driver, seeds: [first, end], seconds, counts, judgement, failures } = report;
    let SearchCounts { trials, frames, wrong_pixels, lost_nodes, drawn, whole } = counts;
    let mut out = terminal::stdout();
    writeln!(out, "{driver}")?;
    writeln!(
        out,
        "{} frames of {} walks, seeds {first} to {}, {:.0} frames/s",
        number(*frames),
        number(*trials),
        end.saturating_sub(1),
        *frames as f64 / seconds.max(f64::EPSILON)
    )?;
    let share = *drawn as f64 / (*whole).max(1) as f64;
    writeln!(out, "{:.0} % of what is in sight was drawn", share * 100.0)?;
    writeln!(out, "{wrong_pixels} wrong pixels, {lost_nodes} lost nodes")?;
    if *wrong_pixels > 0 {
        writeln!(out, "{judgement}")?;
    }
    for failed in failures {
        writeln!(out, "seed {}: {}", failed.seed, failed.wrong)?;
        if let Some(file) = &failed.file {
            writeln!(out, "  trimaran audit search --replay {file}")?;
        }
    }
    Ok(())
}
