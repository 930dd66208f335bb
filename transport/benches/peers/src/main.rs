//! The cost of links beside other ways to send the same data: a pose there and back, a frame of 4,000 points
//! until the last one has arrived, frames without a pause. Measures time, CPU time and heap allocations of
//! both ends together.
//!
//! ```sh
//! cargo run --release --manifest-path transport/benches/peers/Cargo.toml -- [--rounds N] [--as-roles | --block-on] [--json] [NAME..]
//! ```
//!
//! Both ends are in this process, each a task of a single-threaded runtime on a core of its own; `--as-roles`
//! gives each a runtime with a thread of its own instead. Rounds go through all subjects in turn, so that
//! other load on the machine affects all of them.

mod measure;
mod row;
mod subject;

use std::alloc::System;

use anyhow::Result;
use clap::Parser;
use measure::{Plan, measure, measure_blocking};
use row::Row;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use subject::{channel, iceoryx, link, quic, tcp, threads, udp, zenoh};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Measures links beside other ways to send the same data.
#[derive(Debug, Parser)]
struct Args {
    /// How often each subject is measured.
    #[arg(long, default_value_t = 7)]
    rounds: usize,
    /// Poses a round.
    #[arg(long, default_value_t = 3000)]
    poses: u32,
    /// Frames a round, one at a time and again without a pause.
    #[arg(long, default_value_t = 300)]
    frames: u32,
    /// Each end is a thread beside a worker of its runtime, as in a role, and is not pinned.
    #[arg(long)]
    as_roles: bool,
    /// Each end is given to `block_on`, not to a task.
    #[arg(long, conflicts_with = "as_roles")]
    block_on: bool,
    /// One JSON object for each subject, on a line of its own.
    #[arg(long)]
    json: bool,
    /// Only subjects whose names contain one of these.
    names: Vec<String>,
}

/// A subject's name, and the function that measures it once into its row.
type Entry = (&'static str, fn(&Plan, &mut Row) -> Result<()>);

/// Each baseline stands before its subject.
const SUBJECTS: &[Entry] = &[
    ("threads, park and unpark", |plan, row| measure_blocking(threads::Parking, plan, row)),
    ("tokio channels", |plan, row| measure(channel::Channels, plan, row)),
    ("inproc", |plan, row| measure(link::Linked::inproc()?, plan, row)),
    ("inproc, polled", |plan, row| measure(link::Polled::new()?, plan, row)),
    ("iceoryx2, polled", |plan, row| measure_blocking(iceoryx::SharedMemory::polled(), plan, row)),
    ("iceoryx2, events", |plan, row| measure_blocking(iceoryx::SharedMemory::events(), plan, row)),
    ("unix", |plan, row| measure(link::Linked::unix()?, plan, row)),
    ("bare tokio TCP", |plan, row| measure(tcp::Bare, plan, row)),
    ("tcp", |plan, row| measure(link::Linked::tcp()?, plan, row)),
    ("zenoh over TCP", |plan, row| measure(zenoh::Zenoh, plan, row)),
    ("bare tokio UDP", |plan, row| measure(udp::Bare, plan, row)),
    ("udp", |plan, row| measure(link::Linked::udp()?, plan, row)),
    ("bare quinn", |plan, row| measure(quic::Bare::new()?, plan, row)),
    ("quic", |plan, row| measure(link::Linked::quic()?, plan, row)),
];

fn main() -> Result<()> {
    let args = Args::parse();
    let Args { poses, frames, as_roles, block_on, .. } = args;
    let plan = Plan { poses, frames, as_roles, block_on };
    let chosen =
        |name: &str| args.names.is_empty() || args.names.iter().any(|part| name.contains(part.as_str()));
    let mut rows: Vec<(&Entry, Row)> =
        SUBJECTS.iter().filter(|(name, _)| chosen(name)).map(|entry| (entry, Row::default())).collect();
    for round in 1..=args.rounds {
        eprintln!("round {round} of {}", args.rounds);
        for ((name, run), row) in &mut rows {
            run(&plan, row).map_err(|e| e.context(*name))?;
        }
    }
    if !args.json {
        println!("{}", Row::HEADER);
    }
    for ((name, _), row) in &rows {
        if args.json {
            println!("{}", row.json(name));
        } else {
            println!("{}", row.line(name));
        }
    }
    Ok(())
}
