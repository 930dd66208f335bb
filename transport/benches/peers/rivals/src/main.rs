//! Frames over networks that lose packets: the links of this project beside other protocols, in virtual time.
//!
//! ```sh
//! cd transport/benches/peers
//! cargo run --release -p trimaran-rivals                        # the table: ten seeds of 60 s a cell
//! cargo run --release -p trimaran-rivals -- --path random --rival udp,quinn --seeds 2
//! cargo run --release -p trimaran-rivals -- --loopback 5        # processor time over the kernel's sockets
//! ```
//!
//! A sender sends sixty frames of 4,000 ids a second. All rivals have the same networks, seeds and workload.
//! Virtual time depends on nothing else that the machine does.

mod loopback;
mod meter;
mod outcome;
mod paths;
mod rival;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Result;
use clap::{Parser, ValueEnum};

use outcome::{Cell, HEADER};
use paths::Path;

/// Frames over networks that lose packets, in virtual time.
#[derive(Debug, Parser)]
struct Options {
    /// Networks; all, if none is named.
    #[arg(long, value_delimiter = ',')]
    path: Vec<Path>,
    /// Rivals whose names contain one of these words; all, if none is named.
    #[arg(long, value_delimiter = ',')]
    rival: Vec<String>,
    /// Seeds from 1 to this one, each with a run of its own.
    #[arg(long, default_value_t = 10)]
    seeds: u64,
    /// Frames of a run.
    #[arg(long, default_value_t = 3600)]
    frames: u32,
    /// Measure the processor time over loopback sockets instead, so many times.
    #[arg(long)]
    loopback: Option<usize>,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let named = |name: &str| options.rival.is_empty() || options.rival.iter().any(|word| name.contains(word));
    let mut rivals: Vec<_> = rival::all().into_iter().filter(|rival| named(rival.name())).collect();
    if let Some(times) = options.loopback {
        return loopback::table(&rivals, times, options.frames);
    }
    rivals.retain(|rival| !rival.has_own_sockets());
    anyhow::ensure!(!rivals.is_empty(), "no such rival runs in virtual time: try --loopback 1");
    let paths = if options.path.is_empty() { Path::value_variants() } else { &options.path };
    let jobs: Vec<_> = paths.iter().flat_map(|path| rivals.iter().map(move |rival| (*path, rival))).collect();
    let (next, cells) = (AtomicUsize::new(0), Mutex::new(vec![None; jobs.len()]));
    let work = || -> Result<()> {
        while let Some((path, rival)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let cell = Cell::measure(*path, &***rival, options.seeds, options.frames)?;
            eprintln!("{} {}", path.name(), cell.row(None));
            let at = jobs.iter().position(|job| job.0 == *path && job.1.name() == rival.name());
            let mut cells = cells.lock().map_err(|_| anyhow::anyhow!("a run panicked"))?;
            if let Some(place) = at.and_then(|at| cells.get_mut(at)) {
                *place = Some(cell);
            }
        }
        Ok(())
    };
    std::thread::scope(|scope| -> Result<()> {
        let threads: Vec<_> = (0..2).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|it| it.join().map_err(|_| anyhow::anyhow!("a run panicked"))?)
    })?;
    println!("{HEADER}");
    let cells = cells.into_inner().map_err(|_| anyhow::anyhow!("a run panicked"))?;
    for ((path, rival), cell) in jobs.iter().zip(&cells) {
        let clean = jobs
            .iter()
            .zip(&cells)
            .find(|((path, other), _)| *path == Path::None && other.name() == rival.name());
        let clean = clean.and_then(|(_, cell)| cell.as_ref()).filter(|_| *path != Path::None);
        if let Some(cell) = cell {
            println!("| {} {}", path.name(), cell.row(clean));
        }
    }
    Ok(())
}
