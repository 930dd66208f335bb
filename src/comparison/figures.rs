//! The figures of a comparison: the paper's figures 4 and 5, and speed against error, coherence and lag.

use maud::Render;

use super::{
    schema::{
        CoherencePoint, Comparison, ComparisonTable, CurvePoint, ExactFrame, LagPoint, Popping,
        SystemFigures, SystemFrame,
    },
    system::System,
};
use crate::report::{
    format,
    html::chart::{Chart, Mark, Series},
    interval::Interval,
};

/// A figure.
#[derive(Debug, Clone)]
pub(super) struct Figure {
    /// The name of its file.
    pub(super) name: String,
    /// Its title.
    pub(super) title: String,
    /// How it was measured.
    pub(super) caption: &'static str,
    pub(super) chart: Chart,
}

impl Figure {
    /// As a file of its own.
    pub(super) fn file(&self) -> String {
        self.chart.file(&self.title).render().into_string()
    }
}

/// All figures of a comparison that are not empty.
pub(super) fn figures(comparison: &Comparison) -> Vec<Figure> {
    let over_frames = comparison.tables.iter().flat_map(over_frames);
    let others =
        curves(comparison).into_iter().chain(coherence(&comparison.coherence)).chain(lag(&comparison.lag));
    over_frames.chain(others).filter(|figure| !figure.chart.is_empty()).collect()
}

fn figure(caption: &'static str, name: &str, title: &str, chart: Chart) -> Figure {
    Figure { name: name.to_owned(), title: title.to_owned(), caption, chart }
}

/// The colour of a system, the same in every figure.
fn class(system: System) -> &'static str {
    const CLASSES: [&str; System::ALL.len()] =
        ["s0", "s1", "s10", "s2", "s3", "s4", "s5", "s6", "s11", "s7", "s12", "s8", "s9"];
    let place = System::ALL.iter().position(|other| *other == system);
    place.and_then(|place| CLASSES.get(place)).copied().unwrap_or("exact")
}

/// The paper's figures 4 and 5 at one error bound.
fn over_frames(table: &ComparisonTable) -> Vec<Figure> {
    let epsilon = format::figure(table.epsilon_px);
    let lines = |of: fn(&SystemFrame) -> Option<f64>| -> Vec<Series> {
        let line = |figures: &SystemFigures| Series {
            name: figures.system.to_string(),
            class: class(figures.system),
            mark: Mark::Line,
            points: figures.frames.iter().filter_map(|f| Some((f64::from(f.frame), of(f)?))).collect(),
        };
        // Systems that differ only in their links draw the same.
        let first = |place: usize, figures: &SystemFigures| {
            table.systems.iter().position(|other| other.system.same_work(figures.system)) == Some(place)
        };
        let different = table.systems.iter().enumerate().filter(|(place, figures)| first(*place, figures));
        different.map(|(_, figures)| line(figures)).collect()
    };
    let exact = |of: fn(&ExactFrame) -> Option<u64>| Series {
        name: "exactly visible".to_owned(),
        class: "exact",
        mark: Mark::Dashed,
        points: table
            .exact
            .iter()
            .filter(|frame| frame.path == 0)
            .filter_map(|frame| Some((f64::from(frame.frame), of(frame)? as f64)))
            .collect(),
    };
    let chart = |y, series| Chart { x: "frame", y, series, ..Chart::default() };
    let rate =
        chart("frames/s, modelled", lines(|f| f.modelled_ms.filter(|ms| *ms > 0.0).map(|ms| 1e3 / ms)));
    let mut objects = lines(|f| Some(f.objects as f64));
    objects.push(exact(|frame| Some(frame.objects)));
    let mut triangles = lines(|f| Some(f.triangles as f64));
    triangles.push(exact(|frame| frame.triangles));
    vec![
        Figure {
            name: format!("path-rate-{epsilon}"),
            title: format!("Frame rate along the path, {epsilon} px"),
            caption: "The paper's figure 4, first path. A machine for each role: a model of the times that roles took \
                      alone.",
            chart: rate,
        },
        Figure {
            name: format!("path-triangles-{epsilon}"),
            title: format!("Triangles drawn along the path, {epsilon} px"),
            caption: "The paper's figure 5(a), first path. Exactly visible: owns a pixel of the item buffer.",
            chart: chart("triangles", triangles),
        },
        Figure {
            name: format!("path-objects-{epsilon}"),
            title: format!("Objects drawn along the path, {epsilon} px"),
            caption: "The paper's figure 5(b), first path.",
            chart: chart("objects", objects),
        },
    ]
}

/// One line per system; `of` returns a point if both figures are known.
fn by_system<P>(
    points: &[P],
    system: fn(&P) -> System,
    of: impl Fn(&P) -> Option<(f64, f64)>,
) -> Vec<Series> {
    let line = |which: System| {
        let mut line: Vec<_> = points.iter().filter(|p| system(p) == which).filter_map(&of).collect();
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        Series { name: which.to_string(), class: class(which), mark: Mark::Line, points: line }
    };
    System::ALL.into_iter().map(line).filter(|series| !series.points.is_empty()).collect()
}

/// A quantity of a curve's points.
#[derive(Clone, Copy)]
struct Quantity {
    /// In the name of a file.
    name: &'static str,
    /// In a title.
    title: &'static str,
    /// On an axis.
    axis: &'static str,
    of: fn(&CurvePoint, &[Popping]) -> Option<f64>,
}

const COSTS: [Quantity; 2] = [
    Quantity {
        name: "ms",
        title: "Time a frame",
        axis: "ms a frame, modelled",
        of: |point, _| point.cost.modelled_ms,
    },
    Quantity {
        name: "triangles",
        title: "Triangles",
        axis: "triangles drawn",
        of: |point, _| point.cost.triangles,
    },
];
const ERRORS: [Quantity; 3] = [
    Quantity {
        name: "flip",
        title: "FLIP",
        axis: "FLIP against full detail",
        of: |point, _| point.flip_mean,
    },
    Quantity {
        name: "deviation",
        title: "the largest deviation",
        axis: "largest deviation, px",
        of: |point, _| Some(point.silhouette_max_px?.max(point.surface_max_px?)),
    },
    Quantity {
        name: "popping",
        title: "popping",
        axis: "pixels that change by levels alone, 95th percentile, %",
        of: |point, popping| {
            let same = |of: &&Popping| (of.epsilon_px, of.path) == (point.epsilon_px, point.path);
            popping.iter().find(same).map(|of| 100.0 * of.changed_p95)
        },
    },
];

/// Speed against error, one line per system, one point an error bound: the mean of the paths.
fn curves(comparison: &Comparison) -> Vec<Figure> {
    let figure = |(cost, error): (Quantity, Quantity)| {
        let of = |points: &[&CurvePoint], quantity: Quantity| {
            let figures = points.iter().filter_map(|point| (quantity.of)(point, &comparison.popping));
            Some(Interval::of_mean(figures)?.value)
        };
        let line = |system: System| {
            let mut bounds: Vec<f64> = comparison.curve.iter().map(|point| point.epsilon_px).collect();
            bounds.sort_by(f64::total_cmp);
            bounds.dedup();
            let point = |epsilon: f64| {
                let here = |point: &&CurvePoint| (point.system, point.epsilon_px) == (system, epsilon);
                let points: Vec<_> = comparison.curve.iter().filter(here).collect();
                Some((of(&points, error)?, of(&points, cost)?))
            };
            let points = bounds.into_iter().filter_map(point).collect();
            Series { name: system.to_string(), class: class(system), mark: Mark::Line, points }
        };
        let lines = System::ALL.into_iter().map(line).filter(|series| !series.points.is_empty());
        let series = lines.collect();
        Figure {
            name: format!("{}-{}", cost.name, error.name),
            title: format!("{} against {}", cost.title, error.title),
            caption: "One point an error bound: means of the paths. Fewer errors lie to the left, less cost \
                      below.",
            chart: Chart { x: error.axis, y: cost.axis, series, ..Chart::default() },
        }
    };
    COSTS.into_iter().flat_map(|cost| ERRORS.map(|error| (cost, error))).map(figure).collect()
}

/// Speed against coherence.
fn coherence(points: &[CoherencePoint]) -> Vec<Figure> {
    let chart = |y, of: fn(&CoherencePoint) -> Option<f64>| Chart {
        x: "degrees between two frames, median",
        y,
        series: by_system(points, |point| point.system, |point| Some((point.turn_deg, of(point)?))),
        ..Chart::default()
    };
    let caption = "From left to right: the walk at a quarter of its pace, the walk, turns on the spot, and its \
                   places in an order without coherence.";
    vec![
        figure(
            caption,
            "ms-coherence",
            "Time a frame against coherence",
            chart("ms a frame, modelled", |point| point.cost.modelled_ms),
        ),
        figure(
            caption,
            "triangles-coherence",
            "Triangles against coherence",
            chart("triangles drawn", |point| point.cost.triangles),
        ),
    ]
}

/// Speed against the camera's age.
fn lag(points: &[LagPoint]) -> Vec<Figure> {
    let chart = |y, of: fn(&LagPoint) -> Option<f64>| Chart {
        x: "age of the camera when its picture is shown, ms",
        y,
        series: by_system(points, |point| point.system, |point| Some((point.lag_ms?, of(point)?))),
        ..Chart::default()
    };
    let caption = "Walked by the clock, as processes that share this machine's cores; one point a pace.";
    vec![
        figure(
            caption,
            "flip-lag",
            "FLIP against the picture due, by lag",
            chart("FLIP against the picture due", |point| point.flip_mean),
        ),
        figure(
            caption,
            "ms-lag",
            "Time a frame against lag",
            chart("ms a frame, measured", |point| point.fps.filter(|fps| *fps > 0.0).map(|fps| 1e3 / fps)),
        ),
        figure(
            caption,
            "triangles-lag",
            "Triangles against lag",
            chart("triangles drawn", |point| point.triangles),
        ),
    ]
}
