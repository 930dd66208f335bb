//! Line charts, stacked areas and scatters as inline SVG. Colours come from classes, so that light and dark
//! pages share them.

mod axis;

use std::fmt::Write as _;

use super::escape;
use crate::report::format::tick_figure;
use axis::Axis;
pub(super) use axis::nice_step;

/// The drawing's size and the plot's place in it, in SVG units; `script.js` knows them too.
const WIDTH: f64 = 560.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = WIDTH - 14.0;
const HEIGHT: f64 = 240.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = HEIGHT - 40.0;
/// Above this many points a line shows no dots.
const DOTS_UP_TO: usize = 90;
/// A horizontal axis is where the largest value is more than this many times the smallest.
const LOG_X_ABOVE: f64 = 50.0;

/// What a chart shows for one name of its legend.
#[derive(Debug, Clone)]
pub(super) struct Series {
    /// Its name in the legend.
    pub(super) name: String,
    /// The class that gives its colour: `or`, `hc`, `rvg`, `drawn`, `exact`, `paper`, `model`, `k0` to `k5`.
    pub(super) class: &'static str,
    /// How it is drawn.
    pub(super) mark: Mark,
    /// Its points, by ascending x; none where nothing was measured.
    pub(super) points: Vec<(f64, f64)>,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    /// A line through the points.
    Line,
    /// A dashed line: a bound, or a formula.
    Dashed,
    /// An area from the areas before it; all areas of a chart have the same x.
    Area,
    /// Single points, joined by a thin line.
    Points,
}

/// A chart.
#[derive(Debug, Clone)]
pub(super) struct Chart {
    /// The name of the x axis, with its unit.
    pub(super) x: &'static str,
    /// The name of the y axis, with its unit.
    pub(super) y: &'static str,
    /// What it shows.
    pub(super) series: Vec<Series>,
    /// A horizontal line that the values are held against.
    pub(super) bound: Option<(f64, String)>,
    /// Labels beside single points.
    pub(super) labels: Vec<(f64, f64, String)>,
    /// The keys of the frames' records to show under the pointer; empty if x is not a frame.
    pub(super) keys: &'static [&'static str],
}

impl Chart {
    /// The chart as SVG and legend; a remark where nothing was measured.
    pub(super) fn svg(&self) -> String {
        let all = || self.series.iter().flat_map(|s| &s.points).chain(&[]);
        if all().next().is_none() {
            return "<p class=\"none\">Not measured in this run.</p>".to_owned();
        }
        let areas = self.stacked();
        let mut ys: Vec<f64> = all().map(|p| p.1).chain(areas.iter().flatten().map(|a| a.2)).collect();
        ys.extend(self.bound.iter().map(|b| b.0));
        let y = Axis::of_values(&mut ys, areas.is_empty());
        let x = self.x_axis();

        let mut svg = self.open(&x);
        grid(&mut svg, &x, &y);
        for (series, area) in self.series.iter().filter(|s| s.mark == Mark::Area).zip(&areas) {
            area_path(&mut svg, series.class, area, &x, &y);
        }
        for series in self.series.iter().filter(|s| s.mark != Mark::Area) {
            line(&mut svg, series, &x, &y);
        }
        if let Some((value, name)) = &self.bound {
            let at = y.at(*value);
            let _ = write!(
                svg,
                "<line class=\"bound\" x1=\"{LEFT}\" x2=\"{RIGHT}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text class=\"boundname\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                RIGHT - 4.0,
                at - 5.0,
                escape(name)
            );
        }
        self.point_labels(&mut svg, &x, &y);
        if y.high < y.largest {
            let _ = write!(
                svg,
                "<text class=\"boundname\" x=\"{:.1}\" y=\"{:.1}\">up to {}, cut off here</text>",
                LEFT + 12.0,
                TOP + 4.0,
                tick_figure(y.largest)
            );
        }
        self.axis_names(&mut svg, y.log);
        svg.push_str("</svg>");
        self.legend() + &svg
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
        if self.keys.is_empty() && low > 0.0 && high > LOG_X_ABOVE * low {
            let (low, high) = (low * 0.8, high * 1.25);
            return Axis { low, high, from: LEFT, to: RIGHT, log: true, empty: false, largest: high };
        }
        if self.keys.is_empty() {
            return Axis::linear(0.0, if high > 0.0 { high * 1.08 } else { 1.0 }, LEFT, RIGHT);
        }
        // A single frame stands in the middle.
        if low == high {
            return Axis::linear(low - 1.0, high + 1.0, LEFT, RIGHT);
        }
        Axis::linear(low, high, LEFT, RIGHT)
    }

    fn open(&self, x: &Axis) -> String {
        let hover = if self.keys.is_empty() {
            String::new()
        } else {
            format!(" data-keys=\"{}\" data-low=\"{}\" data-high=\"{}\"", self.keys.join(" "), x.low, x.high)
        };
        let names: Vec<&str> = self.series.iter().map(|s| s.name.as_str()).collect();
        format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{} over {}: {}\"{hover}>",
            escape(self.y),
            escape(self.x),
            escape(&names.join(", "))
        )
    }

    /// Labels beside their points, each where it covers no other; one that finds no place is left out.
    fn point_labels(&self, svg: &mut String, x: &Axis, y: &Axis) {
        let mut taken: Vec<(f64, f64, f64)> = Vec::new();
        for (px, py, label) in &self.labels {
            let (px, py) = (x.at(*px), y.at(*py));
            let width = 7.0 * label.chars().count() as f64;
            let places = [(px - 8.0 - width, py - 6.0), (px - width / 2.0, py - 12.0), (px + 9.0, py + 4.0)];
            let free = |place: &&(f64, f64)| {
                let beside = |t: &(f64, f64, f64)| place.0 + width < t.0 || t.0 + t.2 < place.0;
                let apart = |t: &(f64, f64, f64)| beside(t) || (t.1 - place.1).abs() > 13.0;
                place.0 > LEFT && taken.iter().all(apart)
            };
            if let Some(&(left, base)) = places.iter().find(free) {
                let text = escape(label);
                let _ = write!(svg, "<text class=\"label\" x=\"{left:.1}\" y=\"{base:.1}\">{text}</text>");
                taken.push((left, base, width));
            }
        }
    }

    fn axis_names(&self, svg: &mut String, log: bool) {
        let middle = (LEFT + RIGHT) / 2.0;
        let logarithmic = if log { ", logarithmic" } else { "" };
        let _ = write!(
            svg,
            "<text class=\"axis\" x=\"{middle}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"axis\" transform=\"translate(13 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}{logarithmic}</text>",
            HEIGHT - 5.0,
            escape(self.x),
            (TOP + BOTTOM) / 2.0,
            escape(self.y),
        );
    }

    fn legend(&self) -> String {
        let entries: String = self
            .series
            .iter()
            .filter(|s| !s.points.is_empty())
            .map(|s| {
                let shape = match s.mark {
                    Mark::Line | Mark::Points => "",
                    Mark::Dashed => " dashed",
                    Mark::Area => " block",
                };
                format!("<li><i class=\"{}{shape}\"></i>{}</li>", s.class, escape(&s.name))
            })
            .collect();
        format!("<ul class=\"legend\">{entries}</ul>")
    }
}

fn grid(svg: &mut String, x: &Axis, y: &Axis) {
    for tick in y.ticks(5.0) {
        let at = y.at(tick);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{RIGHT}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 7.0,
            at + 4.0,
            tick_figure(tick)
        );
    }
    for tick in x.ticks(7.0) {
        let at = x.at(tick);
        let _ = write!(
            svg,
            "<line class=\"notch\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{BOTTOM}\" y2=\"{:.1}\"/>\
             <text class=\"tick\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            BOTTOM + 4.0,
            BOTTOM + 17.0,
            tick_figure(tick)
        );
    }
    let _ =
        write!(svg, "<line class=\"base\" x1=\"{LEFT}\" x2=\"{RIGHT}\" y1=\"{BOTTOM}\" y2=\"{BOTTOM}\"/>");
}

fn line(svg: &mut String, series: &Series, x: &Axis, y: &Axis) {
    let points: Vec<(f64, f64)> = series.points.iter().map(|p| (x.at(p.0), y.at(p.1))).collect();
    let path: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", p.0, p.1)).collect();
    let style = match series.mark {
        Mark::Dashed => " dashed",
        Mark::Points => " thin",
        Mark::Line | Mark::Area => "",
    };
    let _ = write!(svg, "<polyline class=\"line {}{style}\" points=\"{}\"/>", series.class, path.join(" "));
    let radius = if series.mark == Mark::Points { 4.5 } else { 2.0 };
    if series.mark == Mark::Points || (series.mark == Mark::Line && points.len() <= DOTS_UP_TO) {
        for (px, py) in points {
            let _ = write!(
                svg,
                "<circle class=\"dot {}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"{radius}\"/>",
                series.class
            );
        }
    }
}

fn area_path(svg: &mut String, class: &str, area: &[(f64, f64, f64)], x: &Axis, y: &Axis) {
    let upper = area.iter().map(|a| (a.0, a.2));
    let lower = area.iter().rev().map(|a| (a.0, a.1));
    let path: Vec<String> =
        upper.chain(lower).map(|p| format!("{:.1},{:.1}", x.at(p.0), y.at(p.1))).collect();
    let _ = write!(svg, "<polygon class=\"area {class}\" points=\"{}\"/>", path.join(" "));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>) -> Chart {
        let series = Series { name: "<b>".to_owned(), class: "or", mark: Mark::Line, points };
        let keys: &[&str] = &["or_ms"];
        Chart { x: "frame", y: "ms", series: vec![series], bound: None, labels: Vec::new(), keys }
    }

    #[test]
    fn nothing_measured_is_said() {
        assert!(chart(Vec::new()).svg().contains("Not measured"));
    }

    #[test]
    fn one_frame_and_all_zeros_make_finite_charts() {
        for points in [vec![(0.0, 3.0)], vec![(0.0, 0.0), (1.0, 0.0)], vec![(7.0, 0.0)]] {
            let svg = chart(points).svg();
            assert!(svg.contains("polyline"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn a_spike_makes_the_axis_logarithmic_unless_a_value_is_zero() {
        let spike = |low| (0..20).map(|i| (f64::from(i), if i == 0 { 5000.0 } else { low })).collect();
        assert!(chart(spike(10.0)).svg().contains("logarithmic"));
        assert!(!chart(spike(0.0)).svg().contains("logarithmic"));
    }

    #[test]
    fn names_are_escaped() {
        let svg = chart(vec![(0.0, 1.0)]).svg();
        assert!(svg.contains("&lt;b&gt;") && !svg.contains("<b>"));
    }

    #[test]
    fn steps_are_one_two_or_five() {
        for (raw, step) in [(0.9, 1.0), (1.0, 1.0), (1.3, 2.0), (2.1, 5.0), (51.0, 100.0), (0.03, 0.05)] {
            assert!((nice_step(raw) - step).abs() < 1e-9, "{raw}");
        }
    }
}
