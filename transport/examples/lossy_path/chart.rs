//! The table as a picture: the latency of frames, a line for each link over each path.

use std::fmt::{self, Write as _};

/// Sizes, in SVG units.
const WIDTH: f64 = 840.0;
const LEFT: f64 = 214.0;
const RIGHT: f64 = WIDTH - 84.0;
const LINE: f64 = 20.0;
const TITLE: f64 = 34.0;

/// The time from one frame to the next, milliseconds.
const FRAME: f64 = 1e3 / 60.0;

/// Colours of light pages and of dark ones.
const STYLE: &str = "<style>\
    text{font:13px system-ui,sans-serif;fill:#16202b;paint-order:stroke;stroke:#fff;stroke-width:3px}.soft{fill:#5a6775;font-size:12px}.head{font-weight:600}\
    .card{fill:#fff}.grid{stroke:#e3e8ee}.frame{stroke:#b0245c;stroke-dasharray:5 4}.frametext{fill:#b0245c;font-size:12px}\
    .tcp{color:#c2570c}.quic{color:#0b63b0}.udp{color:#0a7f5b}\
    line{stroke:currentColor;stroke-width:2}line.grid,line.frame{stroke-width:1}circle{fill:currentColor}\
    .low{opacity:.45}\
    @media(prefers-color-scheme:dark){text{fill:#e7edf3;stroke:#182029}.soft{fill:#9aa8b6}.card{fill:#182029}.grid{stroke:#2b3743}\
    .frame{stroke:#ff7fae}.frametext{fill:#ff7fae}.tcp{color:#ff9d5c}.quic{color:#64b5ff}.udp{color:#46d0a0}}</style>";

/// The latencies of a link's frames over a path.
pub(crate) struct Row {
    pub(crate) loss: &'static str,
    pub(crate) link: &'static str,
    /// The median, the 99th percentile and the 99.9th, milliseconds.
    pub(crate) latencies: [f64; 3],
}

/// The rows on a logarithmic axis of milliseconds, grouped by loss.
pub(crate) fn svg(rows: &[Row]) -> Result<String, fmt::Error> {
    let titles = rows.chunk_by(|a, b| a.loss == b.loss).count();
    let bottom = rows.len() as f64 * LINE + titles as f64 * TITLE + 30.0;
    let axis = Axis::of(rows);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {}\" role=\"img\" \
         aria-label=\"Latency of frames by link and loss: median, p99 and p99.9 in milliseconds\">{STYLE}\
         <rect class=\"card\" width=\"100%\" height=\"100%\" rx=\"10\"/>",
        bottom + 44.0
    );
    for tick in axis.ticks() {
        let x = axis.at(tick);
        write!(svg, "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"30\" y2=\"{bottom}\"/>")?;
        write!(
            svg,
            "<text class=\"soft\" x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{tick}</text>",
            bottom + 18.0
        )?;
    }
    let x = axis.at(FRAME);
    write!(svg, "<line class=\"frame\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"30\" y2=\"{bottom}\"/>")?;
    write!(
        svg,
        "<text class=\"frametext\" x=\"{x:.1}\" y=\"22\" text-anchor=\"middle\">one frame at 60 Hz</text>"
    )?;
    let mut y = 30.0;
    for group in rows.chunk_by(|a, b| a.loss == b.loss) {
        y += TITLE;
        let loss = group.first().map_or("", |row| row.loss);
        write!(svg, "<text class=\"head\" x=\"20\" y=\"{:.1}\">packets lost: {loss}</text>", y - 12.0)?;
        for row in group {
            row.draw(&mut svg, &axis, y)?;
            y += LINE;
        }
    }
    writeln!(
        svg,
        "<text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">\
         ms from a frame's first point to its last one's arrival: median, p99, p99.9 (figure)</text></svg>",
        (LEFT + RIGHT) / 2.0,
        bottom + 36.0
    )?;
    Ok(svg)
}

impl Row {
    fn draw(&self, svg: &mut String, axis: &Axis, y: f64) -> fmt::Result {
        let class = self.link.split([' ', ',']).next().unwrap_or_default();
        let [p50, p99, p999] = self.latencies;
        let [a, b, c] = self.latencies.map(|latency| axis.at(latency));
        let text = y + 4.0;
        write!(svg, "<g class=\"{class}\"><text x=\"32\" y=\"{text:.1}\">{}</text>", self.link)?;
        write!(svg, "<line class=\"low\" x1=\"{a:.1}\" x2=\"{c:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>")?;
        for (x, radius) in [(a, 3.0), (b, 4.0), (c, 5.0)] {
            write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>")?;
        }
        let figure = if p999 < 100.0 { format!("{p999:.1}") } else { format!("{p999:.0}") };
        let all = format!("{}: median {p50:.1} ms, p99 {p99:.1} ms, p99.9 {p999:.1} ms", self.link);
        write!(svg, "<text x=\"{:.1}\" y=\"{text:.1}\">{figure}</text><title>{all}</title></g>", c + 10.0)
    }
}

/// Milliseconds to SVG units.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    fn of(rows: &[Row]) -> Self {
        let all =
            || rows.iter().flat_map(|row| row.latencies).filter(|latency| *latency > 0.0).chain([FRAME]);
        Self { low: 0.8 * all().fold(f64::INFINITY, f64::min), high: 1.1 * all().fold(0.0, f64::max) }
    }

    fn at(&self, latency: f64) -> f64 {
        LEFT + (latency.max(self.low) / self.low).ln() / (self.high / self.low).ln() * (RIGHT - LEFT)
    }

    /// 1, 2 and 5 of each power of ten.
    fn ticks(&self) -> impl Iterator<Item = f64> {
        let steps = (-1..6).flat_map(|power| [1.0, 2.0, 5.0].map(|step| step * 10_f64.powi(power)));
        let (low, high) = (self.low, self.high);
        steps.filter(move |tick| (low..high).contains(tick))
    }
}
