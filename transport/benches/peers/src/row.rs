//! The measurements of a subject, as a row of the table.

use hdrhistogram::Histogram;
use serde_json::{Value, json};

/// The measurements of a subject, over all rounds.
pub(crate) struct Row {
    pub(crate) there_and_back: Histogram<u64>,
    pub(crate) frame: Histogram<u64>,
    pub(crate) rounds: Vec<Round>,
}

/// Of one round: nanoseconds, counts.
#[derive(Clone, Copy)]
pub(crate) struct Round {
    pub(crate) pose_p50: f64,
    pub(crate) frame_p50: f64,
    pub(crate) cpu_a_frame: f64,
    pub(crate) allocations_a_pose: f64,
    pub(crate) allocations_a_frame: f64,
    pub(crate) ids_a_second: f64,
}

impl Default for Row {
    fn default() -> Self {
        let histogram = || Histogram::new(3).unwrap_or_else(|_| unreachable!("three digits are allowed"));
        Self { there_and_back: histogram(), frame: histogram(), rounds: Vec::new() }
    }
}

impl Row {
    pub(crate) const HEADER: &str = "\
                          | pose there and back, us                  | frame of 4,000 points, us             | CPU us  | allocations     | M points
                          |    p50 (of rounds)       p99      p99.9     |     p50 (of rounds)         p99    | a frame | pose    frame | a second";

    pub(crate) fn line(&self, name: &str) -> String {
        let us = |nanoseconds: f64| nanoseconds / 1e3;
        let (pose, frame) = (self.of(|r| us(r.pose_p50)), self.of(|r| us(r.frame_p50)));
        let quantile = |h: &Histogram<u64>, q: f64| us(h.value_at_quantile(q) as f64);
        format!(
            "{name:<26}| {:>6.2} ({:>6.2}-{:>6.2}) {:>8.1} {:>10.1}   | {:>7.1} ({:>6.1}-{:>6.1}) {:>8.1} | {:>7.1} | {:>6.2} {:>8.2} | {:>6.1}",
            pose.median,
            pose.least,
            pose.most,
            quantile(&self.there_and_back, 0.99),
            quantile(&self.there_and_back, 0.999),
            frame.median,
            frame.least,
            frame.most,
            quantile(&self.frame, 0.99),
            self.of(|r| us(r.cpu_a_frame)).median,
            self.of(|r| r.allocations_a_pose).median,
            self.of(|r| r.allocations_a_frame).median,
            self.of(|r| r.ids_a_second / 1e6).median,
        )
    }

    /// Times in nanoseconds.
    pub(crate) fn json(&self, name: &str) -> Value {
        json!({
            "name": name,
            "rounds": self.rounds.len(),
            "pose_p50_ns": self.of(|r| r.pose_p50).median,
            "pose_p99_ns": self.there_and_back.value_at_quantile(0.99),
            "pose_p999_ns": self.there_and_back.value_at_quantile(0.999),
            "frame_p50_ns": self.of(|r| r.frame_p50).median,
            "frame_p99_ns": self.frame.value_at_quantile(0.99),
            "cpu_a_frame_ns": self.of(|r| r.cpu_a_frame).median,
            "allocations_a_pose": self.of(|r| r.allocations_a_pose).median,
            "allocations_a_frame": self.of(|r| r.allocations_a_frame).median,
            "ids_a_second": self.of(|r| r.ids_a_second).median,
        })
    }

    fn of(&self, what: impl Fn(&Round) -> f64) -> Spread {
        let mut values: Vec<f64> = self.rounds.iter().map(what).collect();
        values.sort_by(f64::total_cmp);
        let at = |i: usize| values.get(i).copied().unwrap_or(f64::NAN);
        Spread { least: at(0), median: at(values.len() / 2), most: at(values.len().saturating_sub(1)) }
    }
}

struct Spread {
    least: f64,
    median: f64,
    most: f64,
}
