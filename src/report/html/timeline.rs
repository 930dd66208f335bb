//! Who was busy when: one row a machine, one bar a role and frame.

use std::fmt::Write as _;

use super::chart::nice_step;
use crate::report::format::{figure, tick_figure};
use crate::report::schema::{Frame, Role, Seat, Span};

/// The frames that a timeline shows at most; more would be hairlines.
const WINDOW: usize = 20;
const WIDTH: f64 = 1160.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = WIDTH - 8.0;
const ROW: f64 = 38.0;
const BAR: f64 = 28.0;
const TOP: f64 = 8.0;
const SEATS: [(Seat, &str); 3] =
    [(Seat::SwitchA, "switch A"), (Seat::SwitchB, "switch B"), (Seat::Display, "display")];

/// A window of frames on the clock of the run.
pub(super) struct Timeline<'a> {
    frames: &'a [Frame],
    start_ms: f64,
    end_ms: f64,
}

impl<'a> Timeline<'a> {
    /// The window around the frame that the pair or the display took longest for; `None` if nothing was
    /// timed.
    pub(super) fn around_slowest(frames: &'a [Frame]) -> Option<Self> {
        let longest = |frame: &Frame| frame.pair_ms().unwrap_or(0.0).max(frame.rvg_ms.unwrap_or(0.0));
        let slowest = (0..frames.len())
            .filter(|&i| !frames[i].timeline.is_empty())
            .max_by(|&a, &b| longest(&frames[a]).total_cmp(&longest(&frames[b])))?;
        Self::around(frames, slowest)
    }

    /// The window around one frame; `None` if nothing there was timed.
    pub(super) fn around(frames: &'a [Frame], place: usize) -> Option<Self> {
        let first = place.saturating_sub(WINDOW / 2).min(frames.len().saturating_sub(WINDOW));
        let frames = frames.get(first..(first + WINDOW).min(frames.len()))?;
        let spans = || frames.iter().flat_map(|f| &f.timeline);
        let start_ms = spans().map(|s| s.start_ms).fold(f64::INFINITY, f64::min);
        let end_ms = spans().map(|s| s.end_ms).fold(f64::NEG_INFINITY, f64::max);
        (end_ms > start_ms).then_some(Self { frames, start_ms, end_ms })
    }

    /// The first and last frame shown.
    pub(super) fn range(&self) -> (u32, u32) {
        (self.frames.first().map_or(0, |f| f.frame), self.frames.last().map_or(0, |f| f.frame))
    }

    /// How many machines are busy on average.
    pub(super) fn busy(&self) -> f64 {
        let busy: f64 = self.frames.iter().flat_map(|f| &f.timeline).map(|s| s.end_ms - s.start_ms).sum();
        busy / (self.end_ms - self.start_ms)
    }

    pub(super) fn svg(&self) -> String {
        let bottom = TOP + ROW * SEATS.len() as f64;
        let mut svg = format!(
            "<ul class=\"legend\"><li><i class=\"or block\"></i>OR: draws the next frame's occluders</li>\
             <li><i class=\"hc block\"></i>HC: culls</li><li><i class=\"rvg block\"></i>RVG: draws the picture</li></ul>\
             <svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"which machine is busy when\">",
            bottom + 40.0
        );
        self.grid(&mut svg, bottom);
        for (row, (seat, name)) in SEATS.iter().enumerate() {
            let y = TOP + ROW * row as f64 + (ROW - BAR) / 2.0;
            let _ = write!(
                svg,
                "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{name}</text>",
                LEFT - 6.0,
                y + BAR / 2.0 + 4.0
            );
            for frame in self.frames {
                for span in frame.timeline.iter().filter(|s| s.seat == *seat) {
                    self.bar(&mut svg, frame.frame, span, y);
                }
            }
        }
        let _ = write!(
            svg,
            "<text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">time since the run's start (ms); numbers are frames</text></svg>",
            (LEFT + RIGHT) / 2.0,
            bottom + 35.0
        );
        svg
    }

    fn at(&self, ms: f64) -> f64 {
        LEFT + (ms - self.start_ms) / (self.end_ms - self.start_ms) * (RIGHT - LEFT)
    }

    fn grid(&self, svg: &mut String, bottom: f64) {
        let step = nice_step((self.end_ms - self.start_ms) / 14.0);
        for tick in (self.start_ms / step).ceil() as i64..=(self.end_ms / step).floor() as i64 {
            let x = self.at(tick as f64 * step);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{bottom:.1}\"/>\
                 <text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                tick_figure(tick as f64 * step)
            );
        }
    }

    fn bar(&self, svg: &mut String, frame: u32, span: &Span, y: f64) {
        let (class, name) = match span.role {
            Role::Or => ("or", "OR"),
            Role::Hc => ("hc", "HC"),
            Role::Rvg => ("rvg", "RVG"),
        };
        let (left, right) = (self.at(span.start_ms), self.at(span.end_ms));
        let width = (right - left).max(1.0);
        let _ = write!(
            svg,
            "<g><title>{name} of frame {frame}: {} ms</title>\
             <rect class=\"bar {class}\" x=\"{left:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{BAR}\" rx=\"2\"/>",
            figure(span.end_ms - span.start_ms)
        );
        if width > 18.0 {
            let _ = write!(
                svg,
                "<text class=\"onbar\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{frame}</text>",
                left + width / 2.0,
                y + BAR / 2.0 + 4.0
            );
        }
        svg.push_str("</g>");
    }
}
