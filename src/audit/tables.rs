//! The figures as tables.

use std::fmt::Write as _;

use super::{
    figures::NONE,
    hard::{Cell, HardCases, Row},
    stability::{Curve, Point},
};
use crate::report::text;

/// The hard cases as a table for a terminal.
#[must_use]
pub fn table(found: &HardCases) -> String {
    let head: Vec<&str> =
        ["case", "#"].into_iter().chain(found.drivers.iter().map(|driver| driver.name.as_str())).collect();
    let row = |row: &Row| {
        let about = [row.figure.clone(), row.number.to_string()];
        about.into_iter().chain(row.cells.iter().map(|cell| cell_text(cell.as_ref()))).collect()
    };
    let rows: Vec<Vec<String>> = found.rows.iter().map(row).collect();
    text::table(&head, &rows)
}

fn cell_text(cell: Option<&Cell>) -> String {
    match cell {
        None => NONE.to_owned(),
        Some(Cell { text, holds: true, .. }) => text.clone(),
        Some(Cell { text, .. }) => format!("WRONG: {text}"),
    }
}

/// A page (Markdown) of the hard cases and the curves; `command` made it.
#[must_use]
pub fn page(found: &HardCases, curves: &[Curve], command: &str) -> String {
    let drivers: String =
        found.drivers.iter().map(|driver| format!("- **{}**: {}\n", driver.name, driver.about)).collect();
    let ways = found.ways.iter().map(|way| format!("`{way}`")).collect::<Vec<_>>().join("; ");
    let ways =
        format!("Each case is walked on each device in these systems, with these occlusion tests: {ways}.");
    let mut page =
        format!("{}{drivers}\n{HARD}\n{}\n", INTRODUCTION.replace("COMMAND", command), wrapped(&ways));
    let mut head = vec!["#".to_owned(), "case or figure".to_owned()];
    head.extend(found.drivers.iter().map(|driver| driver.name.clone()));
    markdown(
        &mut page,
        &head,
        &mut found.rows.iter().map(|row| {
            let about = [row.number.to_string(), row.figure.clone()];
            about.into_iter().chain(row.cells.iter().map(|cell| cell_text(cell.as_ref()))).collect()
        }),
    );
    page += "\n### What tests show besides\n\n";
    let mut last = 0;
    for row in found.rows.iter().filter(|row| !row.tests.is_empty()) {
        if std::mem::replace(&mut last, row.number) != row.number {
            let tests = row.tests.iter().map(|test| format!("`{test}`")).collect::<Vec<_>>().join(", ");
            let _ = writeln!(page, "- {}, {}: {tests}", row.number, row.difficulty);
        }
    }
    page += BROWSER;
    page += CURVES;
    curves.iter().for_each(|curve| add_curve(&mut page, curve));
    page
}

fn add_curve(page: &mut String, curve: &Curve) {
    let Curve { of, about, figures, points } = curve;
    let (first, rest) = of.split_at_checked(1).unwrap_or_default();
    let _ = write!(page, "\n### {}{rest}\n{}\n", first.to_uppercase(), wrapped(about));
    let mut head = vec![String::new()];
    head.extend(figures.iter().cloned());
    let row = |point: &Point| {
        let refused = || vec!["refused".to_owned()];
        let mut row = vec![point.at.clone()];
        row.extend(point.figures.as_ref().map_or_else(|_| refused(), Clone::clone));
        row.resize(head.len(), NONE.to_owned());
        row
    };
    markdown(page, &head, &mut points.iter().map(row));
    let said = points.iter().flat_map(|point| {
        let refused = point.figures.as_ref().err().into_iter().chain(&point.notes);
        refused.map(move |why| format!("- {}: {why}\n", point.at))
    });
    let said: String = said.collect();
    let names = |is: fn(&Point) -> bool| {
        points.iter().filter(|point| is(point)).map(|point| point.at.as_str()).collect::<Vec<_>>().join(", ")
    };
    let (wrong, differs) = (names(|point| !point.holds), names(|point| point.differs));
    if !wrong.is_empty() {
        *page += &format!("\n**Wrong at {wrong}.**\n");
    }
    if !differs.is_empty() {
        *page += &format!("\nRounded positions change the picture first at {differs}.\n");
    }
    if !said.is_empty() {
        *page += &format!("\nThe program refuses by a typed error:\n\n{said}");
    }
}

/// A paragraph in lines of at most 110 columns.
fn wrapped(text: &str) -> String {
    let (mut lines, mut columns) = (String::new(), 0);
    for word in text.split(' ') {
        let length = word.chars().count();
        let fits = columns + 1 + length <= 110;
        if columns > 0 {
            lines.push(if fits { ' ' } else { '\n' });
        }
        columns = if fits && columns > 0 { columns + 1 + length } else { length };
        lines += word;
    }
    lines + "\n"
}

fn markdown(page: &mut String, head: &[String], rows: &mut dyn Iterator<Item = Vec<String>>) {
    let mut line = |cells: &[String]| {
        let _ = writeln!(page, "| {} |", cells.join(" | "));
    };
    line(head);
    line(&vec!["---".to_owned(); head.len()]);
    rows.for_each(|row| line(&row));
}

const INTRODUCTION: &str = "\
# Where culling stays exact, and where the program refuses

This page is for readers who doubt that culling changes no pixel, or whose model is very large, very small or
far from the origin. This command made it. Its exit code is 1 if a figure is wrong:

```sh
COMMAND
```

It measures on all devices that the Vulkan loader shows. `./x swiftshader` prints the file of a second driver,
and `VK_ADD_DRIVER_FILES` adds it. This page has:

";

const HARD: &str = "\
## The hard cases

Twenty-three numerical difficulties are known to break occlusion culling. Each is a small scene and a camera
path in `lab/audit/src/cases`, or a figure of its own. A cell is the worst of all systems and occlusion tests:
pixels that show another triangle than the same frame without culling, and visible nodes that were not drawn.
Where the camera stands still, nodes that come and go count as toggles. A cell names them if there are any.

Rays are left out: a ray and a rasterizer may differ at the edge of a triangle. A display without cullers now
and then draws all that is in sight, to find out whether that costs less. So its toggles are not counted.
";

/// All cases in a browser, by a test: the program has no browser.
const BROWSER: &str = "\
- all cases in a browser: `tests/pages/hard_cases.rs`

The last one draws each frame with the page's renderer (WebGL2), whole and as the f64 oracle culls it. No
pixel differs in 34 of the 37 cases. In the others the browser sees something past an occluder's edge, where
the culler's rasterizer covers it ([why](design.md#why-culling-is-exact)): 1 pixel of *a grating finer than a
pixel*, 3 of *scaled by 1e-3 to 1e3*, 1 of *97 x 1*.

";

const CURVES: &str = "\
## Limits

A plant of 120 objects is walked with one property taken to its limits, by two cullers with each occlusion
test. Figures, all frames together:

- *wrong pixels*: as above, with lost nodes added;
- *toggles*: nodes that come or go while the camera stands still;
- *deviation*: the largest distance by which levels of detail move a surface, at an error bound of 16 pixels;
- *unlike*: pixels of a third of the frames that show another object than the usual plant does. Culling is not
  the cause: positions are rounded, and culled and unculled pictures round alike.
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_paragraph_is_wrapped_and_a_page_says_what_is_wrong_and_what_is_refused() {
        let text = wrapped(&"word ".repeat(100));
        assert!(text.lines().count() == 5 && text.lines().all(|line| line.len() <= 110), "{text}");
        let point = |at: &str| Point::new(at.to_owned());
        let curve = Curve {
            of: "scale",
            about: "About it.",
            figures: vec!["wrong pixels".to_owned()],
            points: vec![
                Point { figures: Ok(vec!["0".to_owned()]), ..point("1") },
                Point { figures: Ok(vec!["9".to_owned()]), holds: false, ..point("2") },
                Point { figures: Err("too large".to_owned()), ..point("3") },
            ],
        };
        let mut page = String::new();
        add_curve(&mut page, &curve);
        let expected = "\n### Scale\nAbout it.\n\n|  | wrong pixels |\n| --- | --- |\n| 1 | 0 |\n| 2 | 9 |\n\
                        | 3 | refused |\n\n**Wrong at 2.**\n\nThe program refuses by a typed error:\n\n\
                        - 3: too large\n";
        assert_eq!(page, expected);
    }
}
