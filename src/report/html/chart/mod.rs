//! Line charts, stacked areas, scatters and bars as inline SVG. Colours come from classes, so that light and
//! dark pages share them.

mod axis;
#[cfg(feature = "lab")]
mod file;
mod timeline;

use maud::{Markup, Render, html};

use crate::report::format::tick_figure;
use axis::Axis;
pub(crate) use timeline::Timeline;

/// The drawing's size and the plot's position in it, SVG units; `script.js` knows them too.
const WIDTH: f64 = 560.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = WIDTH - 14.0;
const HEIGHT: f64 = 240.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = HEIGHT - 40.0;
/// Above this many points a line shows no dots.
const DOTS_UP_TO: usize = 90;

/// A series of a chart, with one entry in its legend.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// Its name in the legend.
    pub(crate) name: String,
    /// The class that gives its colour: `or`, `hc`, `rvg`, `drawn`, `exact`, `paper`, `model`, `k0` to `k6`.
    pub(crate) class: &'static str,
    /// How it is drawn.
    pub(crate) mark: Mark,
    /// Its points, by ascending x; empty if nothing was measured.
    pub(crate) points: Vec<(f64, f64)>,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    /// A line through the points.
    Line,
    /// A dashed line: a bound, or a formula.
    Dashed,
    /// An area from the areas before it; all areas of a chart have the same x.
    Area,
    /// Single points, joined by a thin line.
    Points,
}

/// A chart; only a remark if nothing was measured.
#[derive(Debug, Clone, Default)]
pub(crate) struct Chart {
    /// The name of the x axis, with its unit.
    pub(crate) x: &'static str,
    /// The name of the y axis, with its unit.
    pub(crate) y: &'static str,
    /// Its series.
    pub(crate) series: Vec<Series>,
    /// A horizontal line to compare the values with.
    pub(crate) bound: Option<(f64, String)>,
    /// Labels beside single points.
    pub(crate) labels: Vec<(f64, f64, String)>,
    /// The keys of the frames' records to show under the pointer; empty if x is not a frame.
    pub(crate) keys: &'static [&'static str],
}

impl Render for Chart {
    fn render(&self) -> Markup {
        if self.is_empty() {
            return html! { p.none { "Not measured in this run." } };
        }
        let names: Vec<&str> = self.series.iter().map(|s| s.name.as_str()).collect();
        let hover = |value: String| (!self.keys.is_empty()).then_some(value);
        let x = self.x_axis();
        html! {
            (self.legend())
            svg viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img"
                aria-label={ (self.y) " over " (self.x) ": " (names.join(", ")) }
                data-keys=[hover(self.keys.join(" "))] data-low=[hover(x.low.to_string())]
                data-high=[hover(x.high.to_string())]
            { (self.drawing()) }
        }
    }
}

impl Chart {
    /// Whether there is nothing to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.series.iter().all(|s| s.points.is_empty())
    }

    fn drawing(&self) -> Markup {
        let areas = self.stacked();
        let points = || self.series.iter().flat_map(|s| &s.points);
        let mut ys: Vec<f64> = points().map(|p| p.1).chain(areas.iter().flatten().map(|a| a.2)).collect();
        ys.extend(self.bound.iter().map(|b| b.0));
        let y = Axis::of_values(&mut ys, !areas.is_empty(), (BOTTOM, TOP));
        let x = self.x_axis();
        html! {
                (grid(&x, &y))
                @for (series, area) in self.series.iter().filter(|s| s.mark == Mark::Area).zip(&areas) {
                    (polygon(series.class, area, &x, &y))
                }
                @for series in self.series.iter().filter(|s| s.mark != Mark::Area) { (line(series, &x, &y)) }
                @if let Some((value, name)) = &self.bound {
                    @let at = y.at(*value);
                    line.bound x1=(LEFT) x2=(RIGHT) y1=(unit(at)) y2=(unit(at)) {}
                    text.boundname x=(unit(RIGHT - 4.0)) y=(unit(at - 5.0)) text-anchor="end" { (name) }
                }
                (self.point_labels(&x, &y))
                @if y.high < y.largest {
                    text.boundname x=(unit(LEFT + 12.0)) y=(unit(TOP + 4.0)) {
                        "up to " (tick_figure(y.largest)) ", cut off here"
                    }
                }
                text.axis x=((LEFT + RIGHT) / 2.0) y=(unit(HEIGHT - 5.0)) text-anchor="middle" { (self.x) }
                text.axis transform={ "translate(13 " (unit((TOP + BOTTOM) / 2.0)) ") rotate(-90)" }
                    text-anchor="middle"
                {
                    (self.y) @if y.log { ", logarithmic" }
                }
        }
    }

    /// For each area its points as (x, lower edge, upper edge).
    fn stacked(&self) -> Vec<Vec<(f64, f64, f64)>> {
        let mut floor: Vec<f64> = Vec::new();
        let mut areas = Vec::new();
        for series in self.series.iter().filter(|s| s.mark == Mark::Area) {
            floor.resize(series.points.len(), 0.0);
            let area: Vec<_> = series.points.iter().zip(&floor).map(|(p, f)| (p.0, *f, f + p.1)).collect();
            floor = area.iter().map(|a| a.2).collect();
            areas.push(area);
        }
        areas
    }

    fn x_axis(&self) -> Axis {
        let xs = || self.series.iter().flat_map(|s| &s.points).map(|p| p.0);
        let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
        if self.keys.is_empty() {
            Axis::of_quantities(low, high, (LEFT, RIGHT))
        } else if low == high {
            // A single frame is centred.
            Axis::linear(low - 1.0, high + 1.0, (LEFT, RIGHT))
        } else {
            Axis::linear(low, high, (LEFT, RIGHT))
        }
    }

    fn legend(&self) -> Markup {
        html! {
            ul.legend {
                @for series in self.series.iter().filter(|s| !s.points.is_empty()) {
                    @let shape = match series.mark {
                        Mark::Line | Mark::Points => "",
                        Mark::Dashed => " dashed",
                        Mark::Area => " block",
                    };
                    li { i class={ (series.class) (shape) } {} (series.name) }
                }
            }
        }
    }

    /// Labels beside their points, each without covering another; one without room is left out.
    fn point_labels(&self, x: &Axis, y: &Axis) -> Markup {
        let mut taken: Vec<(f64, f64, f64)> = Vec::new();
        let mut free_position = |px: f64, py: f64, label: &str| {
            let width = 7.0 * label.chars().count() as f64;
            let around = [(px - 8.0 - width, py - 6.0), (px - width / 2.0, py - 12.0), (px + 9.0, py + 4.0)];
            let (left, base) = around.into_iter().find(|(left, base)| {
                *left > LEFT
                    && taken.iter().all(|(other, line, other_width)| {
                        left + width < *other || other + other_width < *left || (line - base).abs() > 13.0
                    })
            })?;
            taken.push((left, base, width));
            Some((left, base))
        };
        html! {
            @for (px, py, label) in &self.labels {
                @if let Some((left, base)) = free_position(x.at(*px), y.at(*py), label) {
                    text.label x=(unit(left)) y=(unit(base)) { (label) }
                }
            }
        }
    }
}

/// A length or position: a tenth of an SVG unit is finer than a pixel.
fn unit(value: f64) -> String {
    format!("{value:.1}")
}

fn grid(x: &Axis, y: &Axis) -> Markup {
    html! {
        @for tick in y.ticks(5.0) {
            @let at = y.at(tick);
            line.grid x1=(LEFT) x2=(RIGHT) y1=(unit(at)) y2=(unit(at)) {}
            text.tick x=(unit(LEFT - 7.0)) y=(unit(at + 4.0)) text-anchor="end" { (tick_figure(tick)) }
        }
        @for tick in x.ticks(7.0) {
            @let at = unit(x.at(tick));
            line.notch x1=(at) x2=(at) y1=(BOTTOM) y2=(unit(BOTTOM + 4.0)) {}
            text.tick x=(at) y=(unit(BOTTOM + 17.0)) text-anchor="middle" { (tick_figure(tick)) }
        }
        line.base x1=(LEFT) x2=(RIGHT) y1=(BOTTOM) y2=(BOTTOM) {}
    }
}

fn line(series: &Series, x: &Axis, y: &Axis) -> Markup {
    let points: Vec<(f64, f64)> = series.points.iter().map(|p| (x.at(p.0), y.at(p.1))).collect();
    let (style, radius) = match series.mark {
        Mark::Dashed => (" dashed", None),
        Mark::Points => (" thin", Some(4.5)),
        Mark::Line | Mark::Area => ("", (points.len() <= DOTS_UP_TO).then_some(2.0)),
    };
    html! {
        polyline class={ "line " (series.class) (style) } points=(path(points.iter().copied())) {}
        @if let Some(radius) = radius {
            @for (px, py) in points {
                circle class={ "dot " (series.class) } cx=(unit(px)) cy=(unit(py)) r=(radius) {}
            }
        }
    }
}

fn polygon(class: &str, area: &[(f64, f64, f64)], x: &Axis, y: &Axis) -> Markup {
    let upper = area.iter().map(|a| (a.0, a.2));
    let lower = area.iter().rev().map(|a| (a.0, a.1));
    let outline = upper.chain(lower).map(|p| (x.at(p.0), y.at(p.1)));
    html! { polygon class={ "area " (class) } points=(path(outline)) {} }
}

fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    points.map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn svg(points: Vec<(f64, f64)>) -> String {
        let series = Series { name: "<b>\"x\"".to_owned(), class: "or", mark: Mark::Line, points };
        let keys: &[&str] = &["or_ms"];
        Chart { x: "frame", y: "ms", series: vec![series], keys, ..Chart::default() }.render().into_string()
    }

    #[test]
    fn nothing_measured_is_said() {
        assert!(svg(Vec::new()).contains("Not measured"));
    }

    #[test]
    fn one_frame_and_all_zeros_make_finite_charts() {
        for points in [vec![(0.0, 3.0)], vec![(0.0, 0.0), (1.0, 0.0)], vec![(7.0, 0.0)]] {
            let svg = svg(points);
            assert!(svg.contains("polyline"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn a_logarithmic_axis_says_so() {
        let spike = |low| (0..20).map(|i| (f64::from(i), if i == 0 { 5000.0 } else { low })).collect();
        assert!(svg(spike(10.0)).contains("logarithmic"));
        assert!(!svg(spike(0.0)).contains("logarithmic"));
    }

    #[test]
    fn names_are_escaped_in_text_and_attributes() {
        let svg = svg(vec![(0.0, 1.0)]);
        assert_eq!(svg.matches("&lt;b&gt;&quot;x&quot;").count(), 2, "in the legend and in the label");
        assert!(!svg.contains("<b>") && !svg.contains("\"x\""), "{svg}");
    }
}
