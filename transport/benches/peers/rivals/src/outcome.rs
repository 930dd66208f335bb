//! One rival over one network: several runs, and a row of the table.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::meter::{Ends, Latencies, Meter};
use crate::paths::Path;
use crate::rival::Rival;

pub(crate) const HEADER: &str = "\
| loss | rival | p50 ms | p99 | p99.9 | ± | slowest | first | bytes a frame | more | late or incomplete |
|---|---|---|---|---|---|---|---|---|---|---|";

/// All runs of a rival over a network.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    name: &'static str,
    runs: Vec<Latencies>,
    bytes: u64,
    frames: u64,
}

impl Cell {
    /// Runs the rival once for each seed.
    pub(crate) fn measure(path: Path, rival: &dyn Rival, seeds: u64, frames: u32) -> Result<Self> {
        let mut cell = Self { name: rival.name(), runs: Vec::new(), bytes: 0, frames: 0 };
        for seed in 1..=seeds {
            let laid = path.lay(seed)?;
            let [sender, receiver] = laid.nets.clone();
            let meter = Arc::<Meter>::default();
            let ends = Ends { sender, receiver, host: "sender", frames, meter: Arc::clone(&meter) };
            let ran = laid.simulation.run(rival.run(ends)).map_err(anyhow::Error::from).flatten();
            ran.with_context(|| format!("{} over {}, seed {seed}", rival.name(), path.name()))?;
            cell.runs.push(meter.latencies());
            cell.bytes += laid.bytes();
            cell.frames += u64::from(frames);
        }
        Ok(cell)
    }

    fn bytes_a_frame(&self) -> f64 {
        self.bytes as f64 / self.frames.max(1) as f64
    }

    /// The standard deviation of the runs' p99.9, milliseconds.
    fn spread(&self) -> f64 {
        let each: Vec<f64> = self.runs.iter().map(|run| milliseconds(&run.all, 0.999)).collect();
        let mean = each.iter().sum::<f64>() / each.len().max(1) as f64;
        let squares: f64 = each.iter().map(|one| (one - mean).powi(2)).sum();
        (squares / (each.len() as f64 - 1.0).max(1.0)).sqrt()
    }

    /// The row, without the network's name; `clean` is the same rival where nothing is lost.
    pub(crate) fn row(&self, clean: Option<&Self>) -> String {
        let all: Vec<Duration> = self.runs.iter().flat_map(|run| run.all.iter().copied()).collect();
        let [p50, p99, p999, slowest] = [0.5, 0.99, 0.999, 1.0].map(|share| milliseconds(&all, share));
        let firsts: Vec<Duration> = self.runs.iter().filter_map(|run| run.all.first().copied()).collect();
        let first = milliseconds(&firsts, 0.5);
        let (bytes, spread) = (self.bytes_a_frame(), self.spread());
        let more = clean.map(|clean| format!("{:+.1} %", (bytes / clean.bytes_a_frame() - 1.0) * 100.0));
        let late: usize = self.runs.iter().map(|run| run.late).sum();
        format!(
            "| {} | {p50:.1} | {p99:.1} | {p999:.1} | {spread:.1} | {slowest:.1} | {first:.1} | {bytes:.0} \
             | {} | {late} |",
            self.name,
            more.unwrap_or_default()
        )
    }
}

/// The latency that this share of the frames has at most.
pub(crate) fn milliseconds(latencies: &[Duration], share: f64) -> f64 {
    let mut sorted = latencies.to_vec();
    sorted.sort_unstable();
    let index = (share * sorted.len().saturating_sub(1) as f64).ceil() as usize;
    sorted.get(index).map_or(f64::NAN, |latency| latency.as_secs_f64() * 1e3)
}
