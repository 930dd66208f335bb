//! A link's conditions over time from a file of columns, to replay measurements of a network.

use std::fs;
use std::io;
use std::path::Path;
use std::time::Duration;

use serde::Deserialize;
use thiserror::Error;
use toml::{Table, Value};

use crate::link::{Conditions, Jitter, Loss, Phase, Probability, Rate, Reorder};

/// The changes at one time; missing values stay as at first.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(PartialEq))]
#[serde(deny_unknown_fields, expecting = "a table of a phase's keys, such as `at` and `rate`")]
pub(super) struct WrittenPhase {
    #[serde(deserialize_with = "crate::text::duration")]
    pub(super) at: Duration,
    rate: Option<Rate>,
    delay: Option<WrittenDuration>,
    jitter: Option<Jitter>,
    loss: Option<Loss>,
    corrupt: Option<Probability>,
    duplicate: Option<Probability>,
    reorder: Option<Reorder>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(PartialEq))]
#[serde(transparent)]
pub(super) struct WrittenDuration(#[serde(deserialize_with = "crate::text::duration")] pub(super) Duration);

/// Why a file of phases cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ScheduleFault {
    /// It cannot be read.
    #[error("cannot be read: {0}")]
    Read(#[from] io::Error),
    /// It has no header line.
    #[error("has no line: begin with the names of the columns, such as `at,rate,delay,loss`")]
    Empty,
    /// A line is not a valid phase.
    #[error("line {line}: {problem}")]
    Line {
        /// The line, from 1.
        line: usize,
        /// The problem.
        problem: String,
    },
}

impl WrittenPhase {
    /// The conditions from then on, where `first` are those at first.
    pub(super) fn over(self, first: &Conditions) -> Phase {
        let conditions = Conditions {
            rate: self.rate.or(first.rate),
            delay: self.delay.map_or(first.delay, |WrittenDuration(delay)| delay),
            jitter: self.jitter.or(first.jitter),
            loss: self.loss.unwrap_or(first.loss),
            corrupt: self.corrupt.unwrap_or(first.corrupt),
            duplicate: self.duplicate.unwrap_or(first.duplicate),
            reorder: self.reorder.or(first.reorder),
        };
        Phase { at: self.at, conditions }
    }
}

/// Reads a file of comma-separated values, one phase per line. The header line names the columns by the keys
/// of a phase. Values are written as in a profile, without quotes. `loss` is independent for each packet. A
/// missing value is the link's own. Lines that begin with `#` are comments.
pub(super) fn read(path: &Path) -> Result<Vec<WrittenPhase>, ScheduleFault> {
    parse(&fs::read_to_string(path)?)
}

fn parse(text: &str) -> Result<Vec<WrittenPhase>, ScheduleFault> {
    let lines = text.lines().zip(1..).map(|(text, line)| (line, text.trim()));
    let mut lines = lines.filter(|(_, text)| !text.is_empty() && !text.starts_with('#'));
    let (_, head) = lines.next().ok_or(ScheduleFault::Empty)?;
    let columns: Vec<&str> = head.split(',').map(str::trim).collect();
    lines
        .map(|(line, text)| phase(&columns, text).map_err(|problem| ScheduleFault::Line { line, problem }))
        .collect()
}

fn phase(columns: &[&str], text: &str) -> Result<WrittenPhase, String> {
    let cells: Vec<&str> = text.split(',').map(str::trim).collect();
    if cells.len() != columns.len() {
        return Err(format!("has {} values for {} columns", cells.len(), columns.len()));
    }
    let there = columns.iter().zip(cells).filter(|(_, cell)| !cell.is_empty());
    let table: Table = there.map(|(column, cell)| ((*column).to_owned(), value(column, cell))).collect();
    Value::Table(table).try_into().map_err(|e: toml::de::Error| e.message().to_owned())
}

/// A cell as a profile would have it; an invalid one is refused when it is read.
fn value(column: &str, cell: &str) -> Value {
    let number = cell.parse().map_or_else(|_| Value::String(cell.to_owned()), Value::Float);
    match column {
        "corrupt" | "duplicate" => number,
        "loss" => Value::Table(Table::from_iter([("independent".to_owned(), number)])),
        _ => Value::String(cell.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_phase_as_a_profile_writes_it() {
        let read =
            parse("# measured on a train\nat, rate,delay ,loss\n\n0s,12 Mbit/s,20ms,0.01\n1500ms,,35ms,\n")
                .unwrap();
        let written = |text: &str| toml::from_str::<WrittenPhase>(text).unwrap();
        let first =
            written("at = \"0s\"\nrate = \"12 Mbit/s\"\ndelay = \"20ms\"\nloss = { independent = 0.01 }\n");
        assert_eq!(read, [first, written("at = \"1500ms\"\ndelay = \"35ms\"\n")]);
    }

    #[test]
    fn what_is_wrong_is_named_by_its_line() {
        for (text, expected) in [
            ("", "has no line: begin with the names"),
            ("at,rate\n1s\n", "line 2: has 1 values for 2 columns"),
            ("at,speed\n\n1s,3\n", "line 3: unknown field `speed`"),
            ("rate\n1 Mbit/s\n", "line 2: missing field `at`"),
            ("at,loss\n1s,much\n", "line 2: invalid type: string \"much\""),
            ("at,loss\n1s,1.5\n", "1.5 is no probability"),
            ("at\nsoon\n", "line 2: invalid value: string \"soon\""),
        ] {
            let fault = parse(text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{text:?}: {fault}");
        }
    }
}
