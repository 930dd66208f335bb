//! A comparison on disk: `compare.json`, the page `compare.html`, its figures and its tables as files.

mod figures;
mod tables;

use std::{
    fs,
    path::{Path, PathBuf},
};

use trimaran_cull::Image;

use super::{ReportError, error::io_error, html, schema::Comparison};
pub(super) use figures::{Figure, figures};
pub(super) use tables::{Table, ratio, tables};

/// A frame, identical for all systems whose pictures have no wrong pixel.
#[derive(Debug, Clone)]
pub struct ComparedPicture {
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// The frame.
    pub frame: u32,
    /// Why it was chosen.
    pub which: &'static str,
    /// Mean FLIP against full detail.
    pub flip_mean: f64,
    /// The picture.
    pub shown: Image,
    /// The same at full detail.
    pub full: Image,
}

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
        // Whole or not at all: a reader never finds half a page.
        let beside = path.with_extension("part");
        fs::write(&beside, text).map_err(io_error("writing", &beside))?;
        fs::rename(&beside, &path).map_err(io_error("writing", &path))?;
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
    put(
        dir.join("compare.html"),
        html::comparison_page(comparison, pictures, &figures, &tables).map_err(ReportError::Json)?,
    )
}
