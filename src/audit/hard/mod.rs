//! The 23 numerical difficulties of culling, on the f64 oracle and on devices.

mod gaps;
mod inputs;
mod measures;
mod rows;
mod target;

use std::{collections::BTreeSet, sync::Arc, thread};

use serde::Serialize;
use tokio::runtime::Handle;
use trimaran_audit::cases::{Case, CaseError, hard_cases};
use trimaran_cull::LodRule;
use trimaran_gpu::Gpu;

use self::{
    measures::{Bench, Measure, Measured},
    rows::{DIFFICULTIES, Difficulty},
    target::Walked,
};
use super::{Figures, Way};

pub(super) use gaps::depth_at;
pub(super) use measures::deviation_px;
pub use target::MeasureError;
pub(super) use target::Target;

/// One figure on one driver.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cell {
    /// The figure with its unit, or why there is none.
    pub text: String,
    /// Whether it is as it should be.
    pub holds: bool,
    /// The figures of a walk: the worst of all systems and occlusion tests.
    pub figures: Option<Figures>,
}

/// One difficulty, and one figure of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The number of the difficulty.
    pub number: u8,
    /// The difficulty.
    pub difficulty: &'static str,
    /// The case, or what was measured.
    pub figure: String,
    /// The f64 oracle's figure, and that of each device. `None` where nothing is to be measured.
    pub cells: Vec<Option<Cell>>,
    /// Tests that show the same, or what this command cannot run.
    pub tests: &'static [&'static str],
}

/// A column of the table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Driver {
    /// Its short name.
    pub name: String,
    /// Its full name, and the driver's version.
    pub about: String,
}

impl Driver {
    fn oracle() -> Self {
        let about = "a rasterizer in f64, by the rules of the Vulkan specification".to_owned();
        Self { name: "f64 oracle".to_owned(), about }
    }
}

/// The figures of all hard cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HardCases {
    /// The f64 oracle, and the devices.
    pub drivers: Vec<Driver>,
    /// The error bound of the levels of detail, pixels.
    pub epsilon_px: f64,
    /// The systems with their occlusion tests that were walked on each device.
    pub ways: Vec<String>,
    /// All figures.
    pub rows: Vec<Row>,
}

impl HardCases {
    /// Whether all figures are as they should be.
    #[must_use]
    pub fn hold(&self) -> bool {
        self.rows.iter().flat_map(|row| &row.cells).flatten().all(|cell| cell.holds)
    }
}

/// Walks the hard cases of the difficulties with these numbers, of all without any, in every system with
/// every occlusion test on each device and on the f64 oracle, and measures what is not a walk. Calls `done`
/// after each case of each.
///
/// # Errors
/// If a case cannot be made: a bug.
pub fn hard(
    only: &[u8],
    devices: &[Arc<Gpu>],
    rule: LodRule,
    runtime: &Handle,
    done: &(dyn Fn() + Sync),
) -> Result<HardCases, CaseError> {
    let cases = hard_cases()?;
    let ways = Way::all(rule);
    let targets: Vec<Target<'_>> = std::iter::once(Target::Oracle)
        .chain(devices.iter().map(|gpu| Target::Device(gpu, runtime)))
        .collect();
    let columns: Vec<Vec<Option<Cell>>> = thread::scope(|scope| {
        let column = |target| {
            let (cases, ways) = (&cases, &ways);
            scope.spawn(move || column(target, only, cases, ways, rule, done))
        };
        let columns: Vec<_> = targets.iter().map(column).collect();
        let finished = |column: thread::ScopedJoinHandle<'_, _>| {
            column.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        columns.into_iter().map(finished).collect()
    });
    let of_row = |row: usize| columns.iter().map(|column| column.get(row).cloned().flatten()).collect();
    let rows = figures(only).enumerate().map(|(row, (difficulty, figure))| Row {
        number: difficulty.number,
        difficulty: difficulty.name,
        figure: match figure {
            Figure::Walk(case) => case.to_owned(),
            Figure::Measure(measure) => match measure.case() {
                Some(case) => format!("{case}: {}", measure.name()),
                None => measure.name().to_owned(),
            },
        },
        cells: of_row(row),
        tests: difficulty.tests,
    });
    let driver = |gpu: &Arc<Gpu>| {
        let about = format!("{}, {}", gpu.info().name, gpu.info().driver.trim());
        Driver { name: short_name(gpu), about }
    };
    Ok(HardCases {
        drivers: std::iter::once(Driver::oracle()).chain(devices.iter().map(driver)).collect(),
        epsilon_px: rule.epsilon_px(),
        ways: ways.iter().map(ToString::to_string).collect(),
        rows: rows.collect(),
    })
}

/// A device's name without its version.
pub(super) fn short_name(gpu: &Arc<Gpu>) -> String {
    gpu.info().name.split('(').next().unwrap_or_default().trim().to_owned()
}

/// How many cases are walked on each target.
#[must_use]
pub fn hard_count(only: &[u8]) -> usize {
    cases_of(only).len()
}

/// The names of the cases of these difficulties, each once.
fn cases_of(only: &[u8]) -> BTreeSet<&'static str> {
    let case = |(_, figure)| if let Figure::Walk(case) = figure { Some(case) } else { None };
    figures(only).filter_map(case).collect()
}

/// The content of a row.
#[derive(Debug, Clone, Copy)]
enum Figure {
    Walk(&'static str),
    Measure(Measure),
}

/// The rows of the table, in their order.
fn figures(only: &[u8]) -> impl Iterator<Item = (&'static Difficulty, Figure)> {
    let due = |difficulty: &&Difficulty| only.is_empty() || only.contains(&difficulty.number);
    DIFFICULTIES.iter().filter(due).flat_map(|difficulty| {
        let walks = difficulty.cases.iter().map(|case| Figure::Walk(case));
        let measures = difficulty.measures.iter().map(|measure| Figure::Measure(*measure));
        walks.chain(measures).map(move |figure| (difficulty, figure))
    })
}

/// The figures of one target, in the order of the rows.
fn column(
    target: &Target<'_>,
    only: &[u8],
    cases: &[Case],
    ways: &[Way],
    rule: LodRule,
    done: &(dyn Fn() + Sync),
) -> Vec<Option<Cell>> {
    let due = cases_of(only);
    let walk = |case: &Case| {
        let walked = target.walk(case, ways, rule);
        done();
        (case.name, walked)
    };
    let walked = cases.iter().filter(|case| due.contains(case.name)).map(walk).collect();
    let bench = Bench { target, rule, cases, walked: &walked };
    let cell = |(_, figure)| match figure {
        Figure::Walk(name) => walked.get(name).map(walked_cell),
        Figure::Measure(measure) => measured_cell(measure.of(&bench)),
    };
    figures(only).map(cell).collect()
}

fn failed(error: &MeasureError) -> Cell {
    Cell { text: trimaran_transport::causes(error), holds: false, figures: None }
}

fn measured_cell(measured: Result<Measured, MeasureError>) -> Option<Cell> {
    match measured {
        Ok(measured) => measured.map(|(text, holds)| Cell { text, holds, figures: None }),
        Err(error) => Some(failed(&error)),
    }
}

fn walked_cell(walked: &Result<Walked, MeasureError>) -> Cell {
    let walked = match walked {
        Ok(walked) => walked,
        Err(error) => return failed(error),
    };
    let figures = walked.worst();
    let mut text = format!("{} px, {} nodes", figures.wrong_pixels, figures.lost_nodes);
    if let Some(toggles) = figures.toggles.filter(|toggles| *toggles > 0) {
        text += &format!(", {toggles} toggles");
    }
    if let Some((way, wrong)) = walked.wrong() {
        let frame = wrong.first_wrong.map(|frame| format!(", frame {frame}")).unwrap_or_default();
        text += &format!(" ({way}{frame})");
    }
    Cell { text, holds: figures.holds(), figures: Some(figures) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_figure_is_enough() {
        let cell = |holds| Some(Cell { text: "7 px".to_owned(), holds, figures: None });
        let row = |cells| Row { number: 1, difficulty: "", figure: "eye".to_owned(), cells, tests: &[] };
        let drivers = vec![Driver::oracle(), Driver::oracle()];
        let rows = vec![row(vec![None, cell(true)]), row(vec![cell(true), cell(true)])];
        let mut found = HardCases { drivers, epsilon_px: 2.0, ways: Vec::new(), rows };
        assert!(found.hold());
        assert!(!super::super::table(&found).contains("WRONG"));
        found.rows.push(row(vec![cell(true), cell(false)]));
        assert!(!found.hold());
        assert_eq!(super::super::table(&found).matches("WRONG: 7 px").count(), 1);
    }

    #[test]
    fn every_hard_case_is_a_row_and_every_difficulty_is_shown_by_something() {
        let cases: Vec<_> = hard_cases().unwrap().iter().map(|case| case.name).collect();
        let named = |name: &str| DIFFICULTIES.iter().any(|difficulty| difficulty.cases.contains(&name));
        assert!(cases.iter().all(|name| named(name)), "{cases:?}");
        for (number, difficulty) in (1..).zip(&DIFFICULTIES) {
            assert_eq!(difficulty.number, number);
            assert!(difficulty.cases.iter().all(|name| cases.contains(name)), "{number}");
            assert!(!difficulty.cases.is_empty() || !difficulty.measures.is_empty(), "{number}");
            for test in difficulty.tests {
                let (path, name) = test.split_once(' ').unwrap_or((test, ""));
                let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
                assert!(path.exists(), "{}", path.display());
                assert!(name.is_empty() || std::fs::read_to_string(path).unwrap().contains(name), "{test}");
            }
        }
    }
}
