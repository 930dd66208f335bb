//! STL: the triangles of parts as CAD programs and printers exchange them, in the binary or the text form.
//!
//! Each solid of the text form becomes an object, and so does a binary file. The format has no unit and no
//! upward axis: millimetres and z are its custom. Vertices of equal places are joined, as the format repeats
//! them for each triangle.

mod binary;
mod colour;
mod text;

use glam::{DAffine3, DVec3};
use thiserror::Error;

use super::assemble::{centred, draws_nothing, is_in_reach, place_own};
use super::budget::Budget;
use super::left_out::LeftOut;
use super::polygon::Triangulator;
use super::report::{ImportReport, WarningKind};
use super::text::NotText;
use super::{Format, ImportOptions, OverBudget, Part};
use crate::Model;
use trimaran_scene::Rgba8;

pub(super) use self::binary::is_stl;

/// An error in an STL file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StlError {
    /// A binary file has fewer triangles than it announces.
    #[error("it is cut off: it announces {announced} triangles and has {present}; get it again")]
    Cut {
        /// The count in its header.
        announced: u32,
        /// The triangles in it.
        present: usize,
    },
    /// A text file ends within a facet.
    #[error("it is cut off: it ends in line {line}, within a facet; get it again")]
    CutFacet {
        /// Its last line.
        line: u32,
    },
    /// The bytes of a text file are no text.
    #[error(transparent)]
    NotText(#[from] NotText),
    /// Nothing in it is usable.
    #[error("nothing of it can be drawn: {first}; export it again as triangles")]
    Nothing {
        /// The place of the first faulty facet, and its error.
        first: String,
    },
    /// It exceeds a limit.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

/// Reads an STL file of either form. `stem` is the name of solids that have none. `source_index` of its
/// objects is the running number of the solid in the file, from 0 on.
pub(super) fn import(
    stem: &str,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, StlError> {
    let mut solids = Solids {
        part: Part { model: Model::default(), report: ImportReport::default() },
        faces: LeftOut::default(),
        statements: LeftOut::default(),
        triangulator: Triangulator::default(),
        to_world: options.frame_of(Format::Stl).to_scene(),
        stem,
        budget,
        count: 0,
    };
    match binary::Binary::of(bytes) {
        Some(binary) => binary.read(&mut solids)?,
        None => text::read(bytes, &mut solids)?,
    }
    solids.finish()
}

/// One solid, in the world frame. Each facet has vertices of its own.
#[derive(Default)]
struct Solid {
    positions: Vec<DVec3>,
    colours: Vec<Rgba8>,
    indices: Vec<u32>,
}

/// The solids of a file so far.
struct Solids<'a> {
    part: Part,
    faces: LeftOut,
    statements: LeftOut,
    triangulator: Triangulator,
    to_world: DAffine3,
    stem: &'a str,
    budget: &'a Budget,
    /// Solids met, those without a triangle too.
    count: u32,
}

impl Solids<'_> {
    /// Adds a facet with its corners in the file's frame, or returns the error of one that cannot be drawn.
    fn facet(&mut self, solid: &mut Solid, corners: &[DVec3], colour: Rgba8) -> Result<(), String> {
        if corners.len() < 3 {
            return Err(format!("a facet of {} corners", corners.len()));
        }
        let first = solid.positions.len();
        solid.positions.extend(corners.iter().map(|&corner| self.to_world.transform_point3(corner)));
        if !solid.positions.iter().skip(first).all(|&place| is_in_reach(place)) {
            solid.positions.truncate(first);
            return Err("a corner has no finite place, or is too far away".to_owned());
        }
        solid.colours.resize(solid.positions.len(), colour);
        let face: Vec<u32> = (first as u32..).take(corners.len()).collect();
        self.triangulator.face(&face, &solid.positions, &mut solid.indices);
        Ok(())
    }

    /// Counts the memory of a solid against the budget.
    fn count(&self, name: &str, triangles: usize, vertices: usize) -> Result<(), OverBudget> {
        self.budget.mesh(triangles as u64, vertices as u64, || format!("solid {name:?}"))
    }

    /// Makes a solid an object.
    fn add(&mut self, name: &str, solid: Solid) -> Result<(), OverBudget> {
        let name = if name.is_empty() { self.stem } else { name };
        let index = self.count;
        self.count += 1;
        let Solid { positions, colours, indices } = solid;
        let (mesh, origin) = centred(&positions, colours, indices);
        if draws_nothing(&mesh) {
            self.part.report.warn_of(WarningKind::EmptyObject, "", name);
            return Ok(());
        }
        self.budget.objects(1, name.len(), || format!("solid {name:?}"))?;
        place_own(&mut self.part.model, mesh, origin, name, index);
        Ok(())
    }

    fn finish(mut self) -> Result<Part, StlError> {
        if let (true, Some(first)) = (self.part.model.objects.is_empty(), self.faces.first()) {
            return Err(StlError::Nothing { first: first.to_owned() });
        }
        self.faces.report(WarningKind::FaceLeftOut, &mut self.part.report);
        self.statements.report(WarningKind::UnknownStatement, &mut self.part.report);
        self.part.report.warn(WarningKind::LargePolygon, self.triangulator.large_polygons());
        Ok(self.part)
    }
}
