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
    let mut page = format!(
        "{}\n{drivers}\nEach case is walked on each device in these systems, with these occlusion tests: {ways}.\n\n{HARD}\n",
        INTRODUCTION.replace("COMMAND", command)
    );
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
    page.push('\n');
    page += CURVES;
    curves.iter().for_each(|curve| add_curve(&mut page, curve));
    page
}

fn add_curve(page: &mut String, curve: &Curve) {
    let Curve { of, about, figures, points } = curve;
    let (first, rest) = of.split_at_checked(1).unwrap_or_default();
    let _ = write!(page, "\n### {}{rest}\n{about}\n\n", first.to_uppercase());
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
    page.push('\n');
    match wrong.as_str() {
        "" => *page += "Nothing is wrong that is not refused.",
        wrong => *page += &format!("**Wrong at {wrong}.**"),
    }
    if !differs.is_empty() {
        *page += &format!(" Rounded positions change the picture at {differs}.");
    }
    page.push('\n');
    if !said.is_empty() {
        *page += &format!("\nThe program refuses by a typed error:\n\n{said}");
    }
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

This page is for those who doubt that culling changes no pixel, or whose model is very large, very small or far
from the origin. This command made it, and its exit code is 1 if any figure is wrong:

```sh
COMMAND
```

It measures on all devices that the Vulkan loader shows. `./x swiftshader` prints the file of a second driver,
which `VK_ADD_DRIVER_FILES` adds. This page has:

";

const HARD: &str = "\
## The hard cases

Twenty-three numerical difficulties are known to break occlusion culling. Each is a small scene and a camera path
in `lab/audit/src/cases`, or a figure of its own. A cell is the worst of all systems and occlusion tests: pixels
that show another triangle than the same frame without culling, and visible nodes that were not drawn. Where the
camera stands still, nodes that come and go would be counted as toggles.

Rays are left out: a ray and a rasterizer may differ at the edge of a triangle. A display without cullers now and
then draws all that is in sight to find out whether that costs less, so its toggles are not counted.
";

const CURVES: &str = "\
## Limits

A plant of 120 objects is walked with one property taken to its limits, by two cullers with each occlusion test.
Figures, all frames together:

- *wrong pixels*: as above, with lost nodes added;
- *toggles*: nodes that come or go while the camera stands still;
- *deviation*: the largest distance by which levels of detail move a surface, at an error bound of 16 pixels;
- *unlike*: pixels of a third of the frames that show another object than the usual plant does. Culling is not the
  cause: positions are rounded, and culled and unculled pictures round alike.
";
