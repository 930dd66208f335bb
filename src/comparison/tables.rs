//! The tables of a comparison, for its page, for a terminal and for a document.

use super::{
    paths::Coherence,
    schema::{
        Comparison, ComparisonTable, CurvePoint, DrawnFigures, ExactFrame, LagPoint, PAPER, PaperModel,
        Popping, SystemFigures,
    },
    system::System,
};
use crate::report::{
    format::{figure, grouped, plural, with_unit},
    interval::Interval,
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
    let others = [
        paper(),
        curve(&comparison.curve),
        popping(&comparison.popping),
        coherence(comparison),
        lag(&comparison.lag),
    ];
    of_bounds.chain(others).filter(|table| !table.rows.is_empty()).collect()
}

/// The tables of a comparison that fit a terminal: speed, and the drawn nodes, at each error bound. The first
/// column is aligned left, the others right.
#[must_use]
pub fn summary(found: &Comparison) -> String {
    let shown = ["speed-", "drawn-", "paper", "popping"];
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
            mean(&alone.or_ms),
            mean(&alone.hc_ms),
            mean(&alone.rvg_ms),
            mean(&alone.model_fps),
            over(|figures| &figures.alone.model_fps),
            mean(&alone.model_latency_ms),
            mean(&measured.fps),
            over(|figures| &figures.measured.fps),
            mean(&measured.latency_ms),
            measured.processes.to_string(),
            of_drawn(figures, |drawn| Some(drawn.bytes)),
        ]
    };
    Table {
        name: format!("speed-{}", figure(table.epsilon_px)),
        caption: format!(
            "Frame rate at {} px. OR, HC, RVG: taken alone, median ms of a path. MODEL: a machine for each role, \
             made of them. MEASURED: as so many processes that share {} cores, over {}. Means of {} (95 % \
             interval, bootstrap); ratios over {} on the same path.",
            figure(table.epsilon_px),
            comparison.cores,
            comparison.link,
            walks(comparison, table.paths()),
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
            "processes",
            "bytes a frame",
        ],
        rows: table.systems.iter().map(row).collect(),
    }
}

/// The walks that the means are of.
pub(super) fn walks(comparison: &Comparison, paths: u32) -> String {
    if comparison.seed.is_some() {
        plural(paths.into(), "path", "paths")
    } else {
        format!("{} of one path", plural(paths.into(), "walk", "walks"))
    }
}

/// The reference system: Distributed GigaWalk, or the one nearest to it.
fn base(table: &ComparisonTable) -> Option<&SystemFigures> {
    let named = |name: System| table.systems.iter().find(|figures| figures.system == name);
    named(System::DistributedGigaWalk).or_else(|| named(System::GigaWalk)).or_else(|| table.systems.first())
}

/// How many of the wrong pixels culling has right.
pub(super) fn right(figures: &SystemFigures) -> String {
    match (figures.right_pixels(), figures.wrong_pixels()) {
        (0, _) => String::new(),
        (right, wrong) if right >= wrong => ", all right in f64".to_owned(),
        (right, _) => format!(", {} right in f64", grouped(right as f64)),
    }
}

/// The paper's tables 2 and 3.
fn drawn(table: &ComparisonTable) -> Table {
    let row = |figures: &SystemFigures| {
        let checked = |count: u64| {
            if figures.audited_frames() > 0 { grouped(count as f64) } else { NONE.to_owned() }
        };
        vec![
            figures.system.to_string(),
            of_drawn(figures, |drawn| Some(drawn.objects)),
            of_drawn(figures, |drawn| drawn.objects_over_exact),
            of_drawn(figures, |drawn| drawn.objects_over_exact_median),
            of_drawn(figures, |drawn| Some(drawn.triangles)),
            of_drawn(figures, |drawn| drawn.triangles_over_exact),
            of_drawn(figures, |drawn| drawn.triangles_over_exact_median),
            of_drawn(figures, |drawn| Some(drawn.nodes)),
            checked(figures.wrong_pixels()) + &right(figures),
            checked(figures.lost_nodes()),
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
            "Drawn at {} px, over exactly visible at the same level of detail (sums of a path, and its median \
             frame): means of the paths (95 % interval, bootstrap). {} frames were held against the picture \
             without culling: pixels unlike it, and exactly visible nodes that were not drawn, all in all",
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
    let mut bounds: Vec<(usize, f64)> =
        points.iter().map(|point| (place(point.system), point.epsilon_px)).collect();
    bounds.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    bounds.dedup();
    let row = |(system, epsilon): (usize, f64)| {
        let of: Vec<&CurvePoint> =
            points.iter().filter(|p| place(p.system) == system && p.epsilon_px == epsilon).collect();
        let mean = |value: fn(&CurvePoint) -> Option<f64>| {
            mean(&of.iter().filter_map(|point| value(point)).collect::<Vec<_>>())
        };
        let largest = |of_point: fn(&CurvePoint) -> Option<f64>| {
            value(of.iter().filter_map(|point| of_point(point)).reduce(f64::max))
        };
        vec![
            of.first().map_or_else(String::new, |point| point.system.to_string()),
            figure(epsilon),
            mean(|point| point.cost.modelled_ms),
            mean(|point| point.cost.or_ms),
            mean(|point| point.cost.hc_ms),
            mean(|point| point.cost.rvg_ms),
            mean(|point| point.cost.triangles),
            mean(|point| point.flip_mean),
            largest(|point| point.silhouette_max_px),
            largest(|point| point.surface_max_px),
            grouped(of.iter().map(|point| point.wrong_pixels).sum::<u64>() as f64),
        ]
    };
    Table {
        name: "curve".to_owned(),
        caption: "Speed against error. MODEL: between two pictures, a machine for each role. Times and \
                  triangles are medians of a path, FLIP against full detail that of its median frame: means of \
                  the paths (95 % interval, bootstrap). Deviations are the largest of all"
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
        rows: bounds.into_iter().map(row).collect(),
    }
}

/// Pictures that change although nothing does but the levels.
fn popping(points: &[Popping]) -> Table {
    let mut bounds: Vec<f64> = points.iter().map(|point| point.epsilon_px).collect();
    bounds.sort_by(f64::total_cmp);
    bounds.dedup();
    let row = |epsilon: f64| {
        let of = |value: fn(&Popping) -> f64| {
            let of = points.iter().filter(|point| point.epsilon_px == epsilon);
            mean(&of.map(value).collect::<Vec<_>>())
        };
        vec![
            figure(epsilon),
            of(|point| 100.0 * point.changed),
            of(|point| 100.0 * point.changed_p95),
            of(|point| point.flip_mean),
            of(|point| 100.0 * point.frames_over_1_px),
        ]
    };
    Table {
        name: "popping".to_owned(),
        caption:
            "Popping: a frame with its own levels against the same frame with those of the frame before, \
                  the same for every system. Medians and 95th percentiles of a path's frames: means of the \
                  paths (95 % interval, bootstrap)"
                .to_owned(),
        head: vec![
            "ε px",
            "pixels that change, %",
            "95th percentile",
            "FLIP",
            "frames with a switch over 1 px, %",
        ],
        rows: bounds.into_iter().map(row).collect(),
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

/// The mean of one figure a path, with its interval where they differ.
pub(super) fn mean(figures: &[f64]) -> String {
    let Some(Interval { value: mean, low, high }) = Interval::of_mean(figures.iter().copied()) else {
        return NONE.to_owned();
    };
    let [mean, low, high] = [mean, low, high].map(figure);
    if low == high { mean } else { format!("{mean} ({low} to {high})") }
}

/// The same of a figure of what a system drew.
fn of_drawn(figures: &SystemFigures, of: fn(&DrawnFigures) -> Option<f64>) -> String {
    mean(&figures.drawn.iter().filter_map(of).collect::<Vec<_>>())
}

/// The ratios of figures of the same path.
pub(super) fn ratio(of: &[f64], over: &[f64]) -> String {
    mean(&of.iter().zip(over).map(|(of, over)| of / over).collect::<Vec<_>>())
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
    fn ratios_are_of_the_same_path() {
        // On the second path everything takes twice as long; the ratio is 3 on each.
        assert_eq!(ratio(&[30.0, 15.0], &[10.0, 5.0]), "3");
        assert_eq!(mean(&[10.0, 20.0]), "15 (10 to 20)");
        assert_eq!((mean(&[]), mean(&[7.5])), ("–".to_owned(), "7.5".to_owned()));
    }

    #[test]
    fn a_table_says_which_figures_are_a_model_and_which_were_measured() {
        let tables = tables(&sample::comparison());
        let names: Vec<_> = tables.iter().map(|table| table.name.as_str()).collect();
        assert_eq!(names, ["speed-10", "drawn-10", "paper", "curve", "popping", "coherence", "lag"]);
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
            figures.drawn.iter_mut().for_each(|drawn| drawn.objects_over_exact = None);
        }
        bare.tables[0].exact.clear();
        let text: String = tables(&bare).iter().map(Table::markdown).collect();
        assert!(text.contains('–') && !text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}
