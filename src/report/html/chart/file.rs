//! Charts as files of their own.

use maud::{Markup, PreEscaped, html};

use super::{Chart, HEIGHT, LEFT, RIGHT, Series, WIDTH, unit};

impl Chart {
    /// The chart as a file of its own, with a title.
    pub(crate) fn file(&self, title: &str) -> Markup {
        const ROW: f64 = 18.0;
        const COLUMNS: usize = 3;
        let named: Vec<&Series> = self.series.iter().filter(|s| !s.points.is_empty()).collect();
        let above = 24.0 + ROW * named.len().div_ceil(COLUMNS) as f64;
        let place = |at: usize| {
            let column = (RIGHT - LEFT) / COLUMNS as f64 * (at % COLUMNS) as f64;
            (LEFT + column, 36.0 + ROW * (at / COLUMNS) as f64)
        };
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (HEIGHT + above) }
                role="img" aria-label={ (title) ": " (self.y) " over " (self.x) }
            {
                style { (PreEscaped(include_str!("../chart.css"))) }
                rect.back width="100%" height="100%" rx="8" {}
                text.label x=(LEFT) y="18" font-weight="600" { (title) }
                @for (at, series) in named.iter().enumerate() {
                    @let (left, base) = place(at);
                    line class={ "line " (series.class) } x1=(unit(left)) x2=(unit(left + 16.0))
                        y1=(unit(base - 4.0)) y2=(unit(base - 4.0)) stroke="currentColor" {}
                    text x=(unit(left + 22.0)) y=(unit(base)) { (series.name) }
                }
                g transform={ "translate(0 " (unit(above)) ")" } { (self.drawing()) }
            }
        }
    }
}
