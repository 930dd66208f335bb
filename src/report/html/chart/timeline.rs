//! A timeline: one row per machine, one bar per role and frame.

use std::collections::BTreeSet;

use maud::{Markup, Render, html};

use super::{Axis, unit};
use crate::report::format::{figure, tick_figure};
use crate::report::schema::{Frame, Machine, Role, Span};

/// The frames that a timeline shows at most; more would be hairlines.
const WINDOW: usize = 20;
/// The drawing's size and the plot's position in it, SVG units.
const WIDTH: f64 = 1160.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = WIDTH - 8.0;
const ROW: f64 = 38.0;
const BAR: f64 = 28.0;
const TOP: f64 = 8.0;

/// A window of frames on the clock of the run.
pub(crate) struct Timeline<'a> {
    frames: &'a [Frame],
    /// The machines that worked, one row each.
    machines: BTreeSet<Machine>,
    /// Milliseconds since the run's start.
    time: Axis,
}

impl<'a> Timeline<'a> {
    /// The window around the frame with the longest culling or drawing; `None` if nothing was timed.
    pub(crate) fn around_slowest(frames: &'a [Frame]) -> Option<Self> {
        let longest = |frame: &Frame| frame.pair_ms().unwrap_or(0.0).max(frame.rvg_ms.unwrap_or(0.0));
        let timed = frames.iter().enumerate().filter(|(_, frame)| !frame.timeline.is_empty());
        let (slowest, _) = timed.max_by(|(_, a), (_, b)| longest(a).total_cmp(&longest(b)))?;
        Self::around(frames, slowest)
    }

    /// The window around the frame at `index`; `None` if nothing there was timed.
    pub(crate) fn around(frames: &'a [Frame], index: usize) -> Option<Self> {
        let first = index.saturating_sub(WINDOW / 2).min(frames.len().saturating_sub(WINDOW));
        let frames = frames.get(first..(first + WINDOW).min(frames.len()))?;
        let spans = || frames.iter().flat_map(|f| &f.timeline);
        let start = spans().map(|s| s.start_ms).fold(f64::INFINITY, f64::min);
        let end = spans().map(|s| s.end_ms).fold(f64::NEG_INFINITY, f64::max);
        let machines = spans().map(|s| s.machine).collect();
        (end > start).then(|| Self { frames, machines, time: Axis::linear(start, end, (LEFT, RIGHT)) })
    }

    /// The first and last frame shown.
    pub(crate) fn range(&self) -> (u32, u32) {
        (self.frames.first().map_or(0, |f| f.frame), self.frames.last().map_or(0, |f| f.frame))
    }

    /// How many machines there are.
    pub(crate) fn machines(&self) -> usize {
        self.machines.len()
    }

    /// The plot's lower edge.
    fn bottom(&self) -> f64 {
        TOP + ROW * self.machines.len() as f64
    }

    /// The average number of busy machines.
    pub(crate) fn busy(&self) -> f64 {
        let busy: f64 = self.frames.iter().flat_map(|f| &f.timeline).map(|s| s.end_ms - s.start_ms).sum();
        busy / (self.time.high - self.time.low)
    }

    fn grid(&self) -> Markup {
        html! {
            @for tick in self.time.ticks(14.0) {
                @let x = unit(self.time.at(tick));
                line.grid x1=(x) x2=(x) y1=(TOP) y2=(unit(self.bottom())) {}
                text.tick x=(x) y=(unit(self.bottom() + 16.0)) text-anchor="middle" { (tick_figure(tick)) }
            }
        }
    }

    fn row(&self, machine: Machine, top: f64) -> Markup {
        html! {
            text.tick x=(unit(LEFT - 6.0)) y=(unit(top + BAR / 2.0 + 4.0)) text-anchor="end" { (machine) }
            @for frame in self.frames {
                @for span in frame.timeline.iter().filter(|s| s.machine == machine) {
                    (self.bar(frame.frame, span, top))
                }
            }
        }
    }

    fn bar(&self, frame: u32, span: &Span, top: f64) -> Markup {
        let (class, name) = match span.role {
            Role::Or => ("or", "OR"),
            Role::Hc => ("hc", "HC"),
            Role::Rvg => ("rvg", "RVG"),
        };
        let left = self.time.at(span.start_ms);
        let width = (self.time.at(span.end_ms) - left).max(1.0);
        html! {
            g {
                title { (name) " of frame " (frame) ": " (figure(span.end_ms - span.start_ms)) " ms" }
                rect class={ "bar " (class) } x=(unit(left)) y=(unit(top)) width=(unit(width)) height=(BAR)
                    rx="2" {}
                @if width > 18.0 {
                    @let (x, y) = (unit(left + width / 2.0), unit(top + BAR / 2.0 + 4.0));
                    text.onbar x=(x) y=(y) text-anchor="middle" { (frame) }
                }
            }
        }
    }
}

impl Render for Timeline<'_> {
    fn render(&self) -> Markup {
        html! {
            ul.legend {
                li { i.or.block {} "OR: draws the next frame's occluders" }
                li { i.hc.block {} "HC: culls" }
                li { i.rvg.block {} "RVG: draws the picture" }
            }
            svg viewBox={ "0 0 " (WIDTH) " " (self.bottom() + 40.0) } role="img"
                aria-label="which machine is busy when"
            {
                (self.grid())
                @for (row, machine) in self.machines.iter().enumerate() {
                    (self.row(*machine, TOP + ROW * row as f64 + (ROW - BAR) / 2.0))
                }
                text.axis x=(unit((LEFT + RIGHT) / 2.0)) y=(unit(self.bottom() + 35.0)) text-anchor="middle" {
                    "time since the run's start (ms); numbers are frames"
                }
            }
        }
    }
}
