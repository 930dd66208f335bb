//! Wavefront OBJ, with the base colours of its material libraries.
//!
//! Each run of faces under one `o` or `g` name becomes an object, even if the name is repeated: exporters
//! give many parts one name. `g` names under an `o` name are in a group of its name. Exporters deviate from
//! the specification, and other readers tolerate it: a fault costs its line or its face, and is counted.

mod assemble;
mod faults;
mod library;
mod materials;
mod parse;
mod tints;

use std::path::Path;

use thiserror::Error;

use self::faults::Faults;
use super::budget::Budget;
use super::neighbours::Neighbours;
use super::report::{ImportReport, WarningKind};
use super::text::{self, NotText};
use super::{Format, ImportOptions, OverBudget, Part};
use crate::Model;

/// An error in an OBJ file, and its place.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ObjError {
    /// The bytes are no text.
    #[error(transparent)]
    NotText(#[from] NotText),
    /// Nothing in it is usable.
    #[error("nothing of it can be drawn: {first}; export it as polygons, and see that it is an OBJ file")]
    Nothing {
        /// The first faulty line, and its error.
        first: String,
    },
    /// It exceeds a limit.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

/// Reads an OBJ file. `source_index` of its objects is their running number in the file, from 0 on.
pub(super) fn import(
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, ObjError> {
    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    let mut faults = Faults::default();
    let text = text::decode(bytes)?;
    let (parsed, libraries) = parse::parse(&text, Neighbours::of(path, budget), budget, &mut faults)?;
    part.report.warn(WarningKind::PointsOrLines, parsed.points_or_lines);
    libraries.report(&mut part.report);

    let file_to_world = options.frame_of(Format::Obj).to_scene();
    assemble::assemble(parsed, &file_to_world, budget, &mut faults, &mut part)?;
    match faults.first().filter(|_| part.model.objects.is_empty()) {
        // Text may contain zeros; a file with zeros and nothing usable is not text.
        Some(_) if text.contains('\0') => Err(NotText::Binary.into()),
        Some(first) => Err(ObjError::Nothing { first }),
        None => {
            faults.report(&mut part.report);
            Ok(part)
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_scene::{Rgba8, UpAxis};

    use super::*;

    fn parse(text: &str) -> Result<Part, ObjError> {
        import_with(text, &ImportOptions::default())
    }

    fn import_with(text: &str, options: &ImportOptions) -> Result<Part, ObjError> {
        import(
            Some(Path::new("no-such-folder/a.obj")),
            text.as_bytes(),
            options,
            &Budget::new(options.limits),
        )
    }

    const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";

    #[test]
    fn groups_become_objects_and_materials_do_not_split_them() {
        let text = format!("{SQUARE}o left\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\ng right\nf 1 2 3 4\n");
        let Part { model, report } = parse(&text).unwrap();
        let names: Vec<_> = model.objects.iter().map(|o| (o.name.as_str(), o.source_index)).collect();
        assert_eq!(names, [("left", 0), ("right", 1)]);
        assert_eq!(model.meshes.iter().map(crate::Mesh::triangle_count).collect::<Vec<_>>(), [2, 2]);
        assert_eq!(model.objects[0].to_world.translation, DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(report.counts(), [(WarningKind::MaterialUndefined, 3)]);
    }

    #[test]
    fn a_concave_face_keeps_its_notch() {
        let text = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf -4 -3 -2 -1\n";
        let Part { model, .. } = parse(text).unwrap();
        let mesh = &model.meshes[0];
        let area: f32 = mesh
            .indices
            .as_chunks::<3>()
            .0
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
                (b - a).cross(c - a).length() / 2.0
            })
            .sum();
        assert_eq!(area, 4.0);
    }

    #[test]
    fn units_axes_and_large_coordinates() {
        let text = "v 500000000 1000 7000\nv 500001000 1000 7000\nv 500000000 2000 7000\nf 1 2 3\n";
        let options = ImportOptions { unit: Some(0.001), up: Some(UpAxis::Z), ..Default::default() };
        let Part { model, .. } = import_with(text, &options).unwrap();
        assert_eq!(model.objects[0].to_world.translation, DVec3::new(500_000.5, 7.0, -1.5));
        assert_eq!(model.meshes[0].positions[1] - model.meshes[0].positions[0], glam::Vec3::X);
    }

    #[test]
    fn what_has_no_surface_is_counted() {
        let text = format!("{SQUARE}g a\nl 1 2 3\np 1\ng b\nf 1 2 3\nmtllib lost.mtl\n");
        let Part { model, report } = parse(&text).unwrap();
        assert_eq!(model.objects.len(), 1);
        assert_eq!(report.counts(), [(WarningKind::PointsOrLines, 2), (WarningKind::MaterialsMissing, 1)]);
    }

    #[test]
    fn a_file_of_which_nothing_is_left_is_an_error_that_names_the_first_line() {
        let said = |text: &str| parse(text).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(said("v 0 0 0\n\nv 1 x 0\n").contains("line 3: \"x\" is no number"));
        assert!(said(&format!("{SQUARE}vn 0 0 1\nf 1 2 9\n")).contains("line 6: vertex 9 of 4"));
        assert!(said("f 0 0 0\n").contains("line 1: \"0\": vertices count from 1"));
        assert!(
            said("v 0 0 0\nv inf 0 0\nv 0 1 0\no bad\nf 1 2 3\n").contains("vertex 2 has no finite place")
        );
        assert!(
            said("v 0 0 0\ncurv 0 1 1 1\nend\n").contains("line 2: free-form curves and surfaces left out")
        );
        assert!(said("<html>\n").contains("line 1: \"<html>\""));
        assert!(parse("v 0 0 0\np 1\n").is_ok_and(|part| part.model.objects.is_empty()));
    }

    #[test]
    fn numbers_of_normals_cannot_overflow() {
        let text =
            format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/-9223372036854775808/9223372036854775807 2/1/1 3/1/1\n");
        assert_eq!(parse(&text).unwrap().model.objects.len(), 1);
    }

    #[test]
    fn colours_of_vertices_are_kept() {
        let text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n";
        let Part { model, .. } = parse(text).unwrap();
        assert_eq!(model.meshes[0].colours[1], Rgba8([0, 255, 0, 255]));
        // Those without one are grey.
        let Part { model, .. } = parse(&text.replacen(" 1 0 0\n", "\n", 1)).unwrap();
        let colours: Vec<_> = model.meshes[0].colours.iter().map(|colour| colour.0).collect();
        assert_eq!(colours, [[153, 153, 153, 255], [0, 255, 0, 255], [0, 0, 255, 255]]);
    }
}
