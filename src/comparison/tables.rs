//! The tables of a comparison, for its page, for a terminal and for a document.

use super::{
    paths::Coherence,
    schema::{
        Comparison, ComparisonTable, CurvePoint, ExactFrame, LagPoint, PAPER, PaperModel, SystemFigures,
    },
    system::System,
};
use crate::report::{
    format::{figure, grouped, with_unit},
    schema::Stat,
    text,
};

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    /// Its name for scripts.
    pub(super) name: String,
    /// Its content, and how its figures were measured.
    pub(super) caption: String,
    pub(super) head: Vec<&'static str>,
    pub(super) rows: Vec<Vec<String>>,
}

const NONE: &str = "–";

/// All tables of a comparison that have rows.
pub(super) fn tables(comparison: &Comparison) -> Vec<Table> {
    let of_bounds = comparison.tables.iter().flat_map(|table| [speed(comparison, table), drawn(table)]);
    let others = [paper(), curve(&comparison.curve), coherence(comparison), lag(&comparison.lag)];
    of_bounds.chain(others).filter(|table| !table.rows.is_empty()).collect()
}

/// The tables of a comparison that fit a terminal: speed, and the drawn nodes, at each error bound. The first
/// column is aligned left, the others right.
#[must_use]
pub fn summary(found: &Comparison) -> String {
    let shown = ["speed-", "drawn-", "paper"];
    let tables = tables(found).into_iter();
    let tables = tables.filter(|table| shown.iter().any(|prefix| table.name.starts_with(prefix)));
    tables.map(|of| format!("{}\n\n{}\n", of.caption, text::table(&of.head, &of.rows))).collect()
}

/// The paper's table 1.
fn speed(comparison: &Comparison, table: &ComparisonTable) -> Table {
    let base = base(table);
    let row = |figures: &SystemFigures| {
        let (alone, measured) = (&figures.alone, &figures.measured);
        let over = |of: fn(&SystemFigures) -> &[f64]| {
            base.map_or_else(|| NONE.to_owned(), |base| ratio(of(figures), of(base)))
        };
        vec![
            figures.system.to_string(),
            value(alone.or_ms),
            value(alone.hc_ms),
            value(alone.rvg_ms),
            range(&alone.model_fps),
            over(|figures| &figures.alone.model_fps),
            range(&alone.model_latency_ms),
            format!("{} ({})", range(&measured.fps), processes(measured.processes)),
            over(|figures| &figures.measured.fps),
            range(&measured.latency_ms),
            grouped(figures.drawn.bytes),
        ]
    };
    Table {
        name: format!("speed-{}", figure(table.epsilon_px)),
        caption: format!(
            "Frame rate at {} px. OR, HC, RVG: taken alone, median ms. MODEL: a machine for each role, made of \
             them. MEASURED: as so many processes that share {} cores, over {}. Medians of {} rounds (lowest to \
             highest); ratios over {} in the same round.",
            figure(table.epsilon_px),
            comparison.cores,
            comparison.link,
            comparison.rounds,
            base.map_or(NONE, |base| base.system.name()),
        ),
        head: vec![
            "system",
            "OR",
            "HC",
            "RVG",
            "MODEL frames/s",
            "ratio",
            "MODEL latency ms",
            "MEASURED frames/s",
            "ratio",
            "MEASURED latency ms",
            "bytes a frame",
        ],
        rows: table.systems.iter().map(row).collect(),
    }
}

/// The reference system: Distributed GigaWalk, or the one nearest to it.
fn base(table: &ComparisonTable) -> Option<&SystemFigures> {
    let named = |name: System| table.systems.iter().find(|figures| figures.system == name);
    named(System::DistributedGigaWalk).or_else(|| named(System::GigaWalk)).or_else(|| table.systems.first())
}

/// The paper's tables 2 and 3.
fn drawn(table: &ComparisonTable) -> Table {
    let row = |figures: &SystemFigures| {
        let drawn = &figures.drawn;
        vec![
            figures.system.to_string(),
            grouped(drawn.objects),
            value(drawn.objects_over_exact),
            value(drawn.objects_over_exact_median),
            grouped(drawn.triangles),
            value(drawn.triangles_over_exact),
            value(drawn.triangles_over_exact_median),
            grouped(drawn.nodes),
            grouped(drawn.wrong_pixels as f64),
            grouped(drawn.lost_nodes as f64),
        ]
    };
    let exact = |of: fn(&ExactFrame) -> Option<u64>| {
        let values: Vec<u64> = table.exact.iter().filter_map(of).collect();
        let mean = values.iter().sum::<u64>() as f64 / values.len().max(1) as f64;
        if values.is_empty() { NONE.to_owned() } else { grouped(mean) }
    };
    let none = || NONE.to_owned();
    let visible = vec![
        "exactly visible".to_owned(),
        exact(|frame| Some(frame.objects)),
        "1".to_owned(),
        "1".to_owned(),
        exact(|frame| frame.triangles),
        "1".to_owned(),
        "1".to_owned(),
        exact(|frame| Some(frame.nodes)),
        none(),
        none(),
    ];
    Table {
        name: format!("drawn-{}", figure(table.epsilon_px)),
        caption: format!(
            "Drawn at {} px, means of {} frames, over exactly visible at the same level of detail (sums, and the \
             median frame), and pixels unlike the picture without culling",
            figure(table.epsilon_px),
            table.exact.len()
        ),
        head: vec![
            "system",
            "objects",
            "over exact",
            "median",
            "triangles",
            "over exact",
            "median",
            "nodes",
            "wrong pixels",
            "lost nodes",
        ],
        rows: table.systems.iter().map(row).chain([visible]).collect(),
    }
}

/// The paper's figures.
fn paper() -> Table {
    let rows = PAPER.iter().flat_map(|model: &PaperModel| {
        let base = model.systems.iter().find(|of| of.system == System::DistributedGigaWalk);
        model.systems.iter().map(move |of| {
            vec![
                model.name.to_owned(),
                of.system.to_string(),
                figure(of.fps),
                value(base.map(|base| of.fps / base.fps)),
                grouped(of.objects),
                figure(of.objects / model.objects_exact),
                grouped(of.triangles),
                figure(of.triangles / model.triangles_exact),
            ]
        })
    });
    Table {
        name: "paper".to_owned(),
        caption:
            "The paper's tables 1 to 3: three PCs with a GeForce4 each, 2002; the first model at 10 px, the \
                  second at 20"
                .to_owned(),
        head: vec![
            "model",
            "system",
            "frames/s",
            "ratio",
            "objects",
            "over exact",
            "triangles",
            "over exact",
        ],
        rows: rows.collect(),
    }
}

/// Speed against error.
fn curve(points: &[CurvePoint]) -> Table {
    let mut points: Vec<&CurvePoint> = points.iter().collect();
    points.sort_by(|a, b| place(a.system).cmp(&place(b.system)).then(a.epsilon_px.total_cmp(&b.epsilon_px)));
    let row = |point: &CurvePoint| {
        vec![
            point.system.to_string(),
            figure(point.epsilon_px),
            value(point.cost.modelled_ms),
            value(point.cost.or_ms),
            value(point.cost.hc_ms),
            value(point.cost.rvg_ms),
            value(point.cost.triangles),
            value(point.flip_mean),
            value(point.silhouette_max_px),
            value(point.surface_max_px),
            grouped(point.wrong_pixels as f64),
        ]
    };
    Table {
        name: "curve".to_owned(),
        caption:
            "Speed against error. MODEL: between two pictures, a machine for each role. Times and triangles \
                  are medians, FLIP against full detail the median frame's mean, deviations the largest"
                .to_owned(),
        head: vec![
            "system",
            "ε px",
            "MODEL ms",
            "OR",
            "HC",
            "RVG",
            "triangles",
            "FLIP",
            "silhouette px",
            "surface px",
            "wrong pixels",
        ],
        rows: points.into_iter().map(row).collect(),
    }
}

/// Speed against coherence: one row per system.
fn coherence(comparison: &Comparison) -> Table {
    let points = &comparison.coherence;
    let mut systems: Vec<System> = points.iter().map(|point| point.system).collect();
    systems.sort_by_key(|system| place(*system));
    systems.dedup();
    let row = |system: &System| {
        let at = |coherence: Coherence| {
            points.iter().find(|point| (point.system, point.coherence) == (*system, coherence))
        };
        let cost = |coherence| value(at(coherence).and_then(|point| point.cost.modelled_ms));
        let drawn = |coherence| value(at(coherence).and_then(|point| point.cost.triangles));
        let nodes = |coherence| value(at(coherence).and_then(|point| point.nodes_over_exact));
        let all = Coherence::ALL;
        std::iter::once(system.to_string())
            .chain(all.map(cost))
            .chain(all.map(drawn))
            .chain(all.map(nodes))
            .collect()
    };
    let motion = Coherence::ALL.iter().filter_map(|coherence| {
        let point = points.iter().find(|point| point.coherence == *coherence)?;
        let (step, turn) = (figure(point.step_m), figure(point.turn_deg));
        Some(format!("{} {step} m and {turn}°", coherence.name()))
    });
    Table {
        name: "coherence".to_owned(),
        caption: format!(
            "Speed against coherence at {} px: what two frames that follow each other are apart (medians: {}). \
             MODEL: a machine for each role; medians",
            points.first().map_or(NONE.to_owned(), |point| figure(point.epsilon_px)),
            motion.collect::<Vec<_>>().join(", ")
        ),
        head: vec![
            "system",
            "MODEL ms: slow",
            "walk",
            "turn",
            "teleport",
            "triangles: slow",
            "walk",
            "turn",
            "teleport",
            "nodes over exact: slow",
            "walk",
            "turn",
            "teleport",
        ],
        rows: systems.iter().map(row).collect(),
    }
}

/// Speed against the camera's age.
fn lag(points: &[LagPoint]) -> Table {
    let mut points: Vec<&LagPoint> = points.iter().collect();
    points.sort_by(|a, b| {
        place(a.system).cmp(&place(b.system)).then(a.poses_per_second.total_cmp(&b.poses_per_second))
    });
    let row = |point: &LagPoint| {
        vec![
            point.system.to_string(),
            figure(point.poses_per_second),
            value(point.fps),
            value(point.lag_ms),
            value(point.lag_poses),
            value(point.triangles),
            value(point.flip_mean),
        ]
    };
    Table {
        name: "lag".to_owned(),
        caption: format!(
            "Walked by the clock at {} px, MEASURED as processes: how old a picture's camera is when it is shown, \
             and FLIP of the picture against the one due then (medians)",
            points.first().map_or(NONE.to_owned(), |point| figure(point.epsilon_px))
        ),
        head: vec!["system", "poses/s", "frames/s", "lag ms", "lag poses", "triangles", "FLIP"],
        rows: points.into_iter().map(row).collect(),
    }
}

fn place(system: System) -> usize {
    System::ALL.iter().position(|other| *other == system).unwrap_or(usize::MAX)
}

fn value(value: Option<f64>) -> String {
    with_unit(value, "", NONE)
}

fn processes(count: u8) -> String {
    if count == 1 { "1 process".to_owned() } else { format!("{count} processes") }
}

/// The median of rounds, with the lowest and the highest where they differ.
pub(super) fn range(rounds: &[f64]) -> String {
    let Some(stat) = Stat::of(rounds.iter().copied()) else { return NONE.to_owned() };
    let low = rounds.iter().copied().fold(f64::INFINITY, f64::min);
    let [median, low, high] = [stat.median, low, stat.max].map(figure);
    if low == high { median } else { format!("{median} ({low} to {high})") }
}

/// The ratios of figures of the same round.
pub(super) fn ratio(of: &[f64], over: &[f64]) -> String {
    range(&of.iter().zip(over).map(|(of, over)| of / over).collect::<Vec<_>>())
}

impl Table {
    /// As Markdown, for a document.
    pub(super) fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | ")).replace('\u{202f}', ",");
        let head = line(self.head.iter().map(|title| (*title).to_owned()).collect());
        let rule = format!("|{}\n", "---|".repeat(self.head.len()));
        let rows: String = self.rows.iter().cloned().map(line).collect();
        format!("<!-- {}: {} -->\n{head}{rule}{rows}", self.name, self.caption)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::sample;

    #[test]
    fn ratios_are_of_the_same_round() {
        // The machine was twice as slow in the second round; the ratio is 3 in each.
        assert_eq!(ratio(&[30.0, 15.0], &[10.0, 5.0]), "3");
        assert_eq!(range(&[10.0, 12.0, 11.0]), "11 (10 to 12)");
        assert_eq!((range(&[]), range(&[7.5])), ("–".to_owned(), "7.5".to_owned()));
    }

    #[test]
    fn a_table_says_which_figures_are_a_model_and_which_were_measured() {
        let tables = tables(&sample::comparison());
        let names: Vec<_> = tables.iter().map(|table| table.name.as_str()).collect();
        assert_eq!(names, ["speed-10", "drawn-10", "paper", "curve", "coherence", "lag"]);
        let speed = &tables[0];
        let times = speed.head.iter().filter(|title| title.contains("frames/s") || title.contains("latency"));
        assert!(times.clone().all(|title| title.starts_with("MODEL") || title.starts_with("MEASURED")));
        assert_eq!(times.count(), 4);
        for table in &tables {
            assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{}", table.name);
        }
    }

    #[test]
    fn the_papers_own_ratios_come_out() {
        let rows = paper().rows;
        let of = |row: usize, column: usize| rows[row][column].as_str();
        assert_eq!((of(0, 3), of(0, 5), of(0, 7)), ("1.61", "1.83", "12.2"));
        assert_eq!((of(3, 3), of(3, 5), of(3, 7)), ("2.37", "1.81", "13"));
    }

    #[test]
    fn nothing_is_made_of_what_was_not_measured() {
        let names = |comparison| -> Vec<String> { tables(comparison).into_iter().map(|t| t.name).collect() };
        assert_eq!(names(&Comparison::default()), ["paper"]);
        let mut bare = sample::comparison();
        for figures in &mut bare.tables[0].systems {
            figures.measured = Default::default();
            figures.drawn.objects_over_exact = None;
        }
        bare.tables[0].exact.clear();
        let text: String = tables(&bare).iter().map(Table::markdown).collect();
        assert!(text.contains('–') && !text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}
