//! A comparison on disk: `compare.json`, the page `compare.html`, its figures and its tables as files.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{
    figures::figures,
    page::{ComparedPicture, page},
    schema::Comparison,
    tables::{Table, tables},
};
use crate::report::{ReportError, io_error, write_whole};

/// Writes a comparison into the existing folder `dir`: first the figures, then the page. Returns the page.
///
/// # Errors
/// The file that could not be written.
pub fn write(
    dir: &Path,
    comparison: &Comparison,
    pictures: &[ComparedPicture],
) -> Result<PathBuf, ReportError> {
    let put = |path: PathBuf, text: String| {
        write_whole(&path, &text).map_err(io_error("writing", &path))?;
        Ok::<_, ReportError>(path)
    };
    let folder = dir.join("figures");
    fs::create_dir_all(&folder).map_err(io_error("creating", &folder))?;
    let figures = figures(comparison);
    for figure in &figures {
        put(folder.join(format!("{}.svg", figure.name)), figure.file())?;
    }
    let tables = tables(comparison);
    put(dir.join("tables.md"), tables.iter().map(Table::markdown).collect::<Vec<_>>().join("\n"))?;
    let json = serde_json::to_string_pretty(comparison).map_err(ReportError::Json)?;
    put(dir.join("compare.json"), json)?;
    put(dir.join("compare.html"), page(comparison, pictures, &figures, &tables).map_err(ReportError::Json)?)
}
