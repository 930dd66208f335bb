//! PLY (the Stanford polygon format): vertices and faces, as scanners and mesh tools write them.
//!
//! A file becomes one object. It has rows of values, whose meaning its header describes; values of no use to a
//! walk are read and dropped. The format has no unit and no upward axis: metres and z are the custom of
//! scanners.

mod header;
mod rows;
mod shape;

use thiserror::Error;

use self::header::Header;
use self::rows::Values;
use self::shape::Shape;
use super::assemble::{centred, draws_nothing, place_own};
use super::budget::Budget;
use super::report::{ImportReport, WarningKind};
use super::{FilePosition, Format, ImportOptions, OverBudget, Part};
use crate::Model;

/// An error in a PLY file, and its place.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlyError {
    /// The header is not one of PLY 1.0, or lacks an element.
    #[error("line {line} of its header: {what}; export it again as PLY 1.0")]
    Header {
        /// The line, from 1 on.
        line: u32,
        /// The error.
        what: String,
    },
    /// It ends before the last row.
    #[error("it is cut off at {at}, in row {row} of the {rows} rows of element {element:?}; get it again")]
    Cut {
        /// Where it ends.
        at: FilePosition,
        /// The element.
        element: String,
        /// The row, from 1 on.
        row: u64,
        /// The rows that the header announces.
        rows: u64,
    },
    /// A value is not one.
    #[error("{at}, row {row} of element {element:?}: {what}; the file is damaged: get it again")]
    Value {
        /// Where the value is.
        at: FilePosition,
        /// The element.
        element: String,
        /// The row, from 1 on.
        row: u64,
        /// The error.
        what: String,
    },
    /// It has points and no faces.
    #[error(
        "it has {points} points and no faces, so it has no surface to draw; \
         make one first, as with CloudCompare or MeshLab (Poisson surface reconstruction)"
    )]
    PointCloud {
        /// Its points.
        points: u64,
    },
    /// Nothing in it is usable.
    #[error("nothing of it can be drawn: {first}; export it again with faces")]
    Nothing {
        /// The place of the first faulty face, and its error.
        first: String,
    },
    /// It exceeds a limit.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

/// Reads a PLY file. `stem` is the name of its object, whose `source_index` is 0.
pub(super) fn import(
    stem: &str,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, PlyError> {
    let header = Header::read(bytes)?;
    let mut values = Values::of(bytes, &header);
    let mut shape = Shape::new(&header, options.frame_of(Format::Ply).to_scene())?;
    for element in &header.elements {
        shape.read(element, &mut values)?;
    }
    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    let behind = values.behind();
    part.report.warn_about(WarningKind::BehindLast, &format!("{behind} bytes"), u64::from(behind > 0));
    if let Some(texture) = &header.texture {
        part.report.warn_of(WarningKind::TexturedMaterial, texture, stem);
    }
    let (positions, colours, indices) = shape.surface(stem, budget, &mut part.report)?;
    let (mesh, origin) = centred(&positions, colours, indices);
    if draws_nothing(&mesh) {
        part.report.warn_of(WarningKind::EmptyObject, "", stem);
        return Ok(part);
    }
    budget.objects(1, stem.len(), || format!("object {stem:?}"))?;
    place_own(&mut part.model, mesh, origin, stem, 0);
    Ok(part)
}
