//! The processor time of a frame over the kernel's loopback sockets, at rest: nothing is lost.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use cpu_time::ProcessTime;
use trimaran_net::{Net, TokioNet};

use crate::meter::{Ends, Meter};
use crate::outcome::milliseconds;
use crate::rival::Rival;

/// Runs all rivals in turn, so many times, and prints medians.
pub(crate) fn table(rivals: &[Box<dyn Rival>], times: usize, frames: u32) -> Result<()> {
    let mut rows = vec![Vec::new(); rivals.len()];
    for _ in 0..times {
        for (rival, rows) in rivals.iter().zip(&mut rows) {
            let row = once(&**rival, frames).with_context(|| rival.name())?;
            eprintln!("{}: {:.0} us, p50 {:.2} ms", rival.name(), row[0], row[1]);
            rows.push(row);
        }
    }
    println!("| rival | µs of processor time a frame, both ends | p50 ms | p99 ms |");
    println!("|---|---|---|---|");
    for (rival, rows) in rivals.iter().zip(&rows) {
        let median = |index: usize| {
            let mut all: Vec<f64> = rows.iter().filter_map(|row| row.get(index).copied()).collect();
            all.sort_by(f64::total_cmp);
            all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
        };
        println!("| {} | {:.0} | {:.2} | {:.2} |", rival.name(), median(0), median(1), median(2));
    }
    Ok(())
}

/// Microseconds of processor time a frame, and p50 and p99 in milliseconds.
fn once(rival: &dyn Rival, frames: u32) -> Result<[f64; 3]> {
    // zenoh refuses a runtime that is the caller's thread alone.
    let runtime = if rival.has_own_sockets() {
        tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?
    } else {
        tokio::runtime::Builder::new_current_thread().enable_all().build()?
    };
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let meter = Arc::<Meter>::default();
    let (sender, receiver) = (Arc::clone(&net), net);
    let ends = Ends { sender, receiver, host: "127.0.0.1", frames, meter: Arc::clone(&meter) };
    let before = ProcessTime::try_now()?;
    runtime.block_on(rival.run(ends))?;
    let took = before.try_elapsed()?;
    runtime.shutdown_timeout(Duration::from_millis(100));
    let all = meter.latencies().all;
    let each = took.as_secs_f64() * 1e6 / f64::from(frames.max(1));
    Ok([each, milliseconds(&all, 0.5), milliseconds(&all, 0.99)])
}
