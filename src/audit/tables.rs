//! The figures as tables.

use super::hard::{Cell, HardCases, Row};
use crate::report::text;

const NONE: &str = "–";

/// The hard cases as a table for a terminal.
#[must_use]
pub fn table(found: &HardCases) -> String {
    let head: Vec<&str> = ["case", "#"].into_iter().chain(found.drivers.iter().map(String::as_str)).collect();
    let row = |row: &Row| {
        let about = [row.figure.to_owned(), row.number.to_string()];
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
