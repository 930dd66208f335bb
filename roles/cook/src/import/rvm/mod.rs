//! RVM: the review format of AVEVA's plant design programs (PDMS, E3D), in which process plants are
//! exchanged.
//!
//! A file is a tree of named groups with primitives: cylinders, boxes, tori, and so on, eleven kinds. Each
//! group with primitives of its own becomes one object, its primitives tessellated into one mesh about the
//! middle of the group. There is no public specification; these facts are common to readers of the format,
//! and were checked against the box stored with every primitive. The form is binary or text.

mod attributes;
mod beside;
mod chunks;
mod colour;
mod encoding;
mod error;
mod file;
mod matching;
mod parse;
mod reader;
mod round;
mod said;
mod shape;
mod solid;
mod tessellate;
mod text;

use std::io::{Read, Seek};
use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

pub use error::RvmError;

use self::file::{File, Group, Primitive, Solids};
use self::said::Said;
use self::shape::{Broken, Shape};
use self::solid::{Chord, Solid};
use self::tessellate::tessellate;
use super::assemble::{bounds, centred, draws_nothing, is_in_reach, place_own};
use super::budget::{Budget, OverBudget};
use super::hierarchy::{self, Branch};
use super::report::WarningKind;
use super::{FilePosition, Format, ImportOptions, Part};
use crate::{Mesh, Model};
use trimaran_scene::{FileFrame, ObjectAttributes};

/// Whether a file that begins with these bytes is a review file, of either form.
pub(super) fn is_review_file(start: &[u8]) -> bool {
    let start = start.get(..Format::START as usize).unwrap_or(start);
    start.starts_with(&chunks::MAGIC) || text::is_text(start)
}

/// The metres per unit that a file's matrices assume.
pub(super) const USUAL_UNIT: f64 = 1e-3;

/// Reads an RVM file of either form. `source_index` of its objects is the running number of the group among
/// all groups of the file, in the order in which they open; groups without primitives count too.
///
/// Attributes of its groups from attribute files are kept.
pub(super) fn import(
    path: Option<&Path>,
    source: impl Read + Seek,
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, RvmError> {
    let File { groups, solids, encoding, mut report, .. } = File::read(source, budget)?;
    let said = match path {
        Some(path) => beside::attributes_of(path, encoding, budget, &mut report)?,
        None => None,
    };
    let file = options.frame_of(Format::Rvm);
    // Matrices make metres of millimetres, so of the unit only the difference counts.
    let scale = file.metres_per_unit.map(|unit| unit / USUAL_UNIT);
    let frame = Frame {
        file_to_world: FileFrame { metres_per_unit: scale, ..file }.to_scene(),
        chord_tolerance: options.chord_tolerance,
        budget,
    };
    let name_of = |solids: &Solids| groups.get(solids.group as usize).map_or("", |group| &group.name);
    let placed: Vec<Placed> =
        solids.par_iter().map(|solids| frame.place(solids, name_of(solids))).collect::<Result<_, _>>()?;

    let mut model = Model::default();
    for (solids, placed) in solids.iter().zip(placed) {
        let name = name_of(solids);
        report.box_mismatches += placed.box_mismatches;
        report.warn(WarningKind::LargePolygon, placed.large_polygons);
        report.warn_many(WarningKind::BrokenPrimitive, &Broken::Place.to_string(), name, placed.left_out);
        let Some((mesh, origin)) = placed.mesh else {
            report.warn_of(WarningKind::EmptyObject, "", name);
            continue;
        };
        if draws_nothing(&mesh) {
            report.warn_of(WarningKind::NoArea, "", name);
        }
        if let Some(material) = solids.material.filter(|_| !solids.colour_known) {
            report.warn_of(WarningKind::UnknownColour, &format!("material {material}"), name);
        }
        place_own(&mut model, mesh, origin, name, solids.group);
    }
    let leaves: Vec<u32> = model.objects.iter().map(|object| object.source_index).collect();
    let mut branches = branches(&groups);
    if let Some(said) = said {
        let mut said = Said::new(said, &groups, &leaves);
        [report.parts, report.parts_matched] = said.matched();
        if report.parts_matched == 0 {
            report.warn(WarningKind::AttributesUnmatched, 1);
        }
        for (number, branch) in &mut branches {
            branch.attributes = said.of(*number, budget)?;
        }
        for (object, &number) in (0..).zip(&leaves) {
            let attributes = said.of(number, budget)?;
            if !attributes.is_empty() {
                model.hierarchy.attributes.push(ObjectAttributes { object, attributes });
            }
        }
    }
    model.hierarchy.groups =
        hierarchy::groups(branches.into_iter().map(|(_, branch)| branch).collect(), &leaves);
    Ok(Part { model, report })
}

/// The groups that hold groups, with their numbers among all.
fn branches(groups: &[Group]) -> Vec<(u32, Branch)> {
    let mut branches: Vec<(u32, Branch)> = Vec::new();
    for (number, group) in (0..).zip(groups) {
        if group.end > number + 1 {
            let above = |parent| branches.binary_search_by_key(&parent, |(number, _)| *number).ok();
            let parent = group.parent.and_then(above).map(|above| above as u32);
            let leaves = number..group.end;
            let branch = Branch { name: group.name.clone(), parent, leaves, attributes: Vec::new() };
            branches.push((number, branch));
        }
    }
    branches
}

/// The common frame and tolerance of a file's groups.
struct Frame<'a> {
    file_to_world: DAffine3,
    /// Metres.
    chord_tolerance: f64,
    budget: &'a Budget,
}

/// The primitives of a group in the world.
#[derive(Default)]
struct Placed {
    /// A mesh about a centre; none without triangles.
    mesh: Option<(Mesh, DVec3)>,
    box_mismatches: u64,
    large_polygons: u64,
    /// Primitives that are too far away.
    left_out: u64,
}

impl Frame<'_> {
    /// The primitives of the group `name` as one mesh.
    fn place(&self, group: &Solids, name: &str) -> Result<Placed, OverBudget> {
        let mut placed = Placed::default();
        let mut positions: Vec<DVec3> = Vec::new();
        let mut indices: Vec<u32> = Vec::new();
        for primitive in &group.primitives {
            let to_world = self.file_to_world * primitive.matrix;
            let scale = largest_scale(&to_world);
            let tolerance = if scale > 0.0 { self.chord_tolerance / scale } else { f64::MAX };
            let solid = tessellate(&primitive.shape, Chord { tolerance });
            // One primitive is small: curves have a limited number of chords, and facets are in the file.
            let (triangles, vertices) = (solid.indices.len() / 3, solid.positions.len());
            self.budget.mesh(triangles as u64, vertices as u64, || {
                format!("the primitive at {} in group {name:?}", primitive.at)
            })?;
            let in_world = solid.positions.iter().map(|&p| to_world.transform_point3(p));
            let first = positions.len();
            positions.extend(in_world);
            if !positions.iter().skip(first).all(|&place| is_in_reach(place)) {
                positions.truncate(first);
                placed.left_out += 1;
                continue;
            }
            placed.large_polygons += solid.large_polygons;
            placed.box_mismatches += u64::from(!fits_stored_box(primitive, &solid, tolerance));
            // A mirroring matrix turns the solid inside out.
            let mirrored = to_world.matrix3.determinant() < 0.0;
            let turned = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
            let triangles = solid.indices.as_chunks::<3>().0.iter();
            indices.extend(triangles.flat_map(turned).map(|index| index + first as u32));
        }
        if !indices.is_empty() {
            let colours = vec![group.colour; positions.len()];
            placed.mesh = Some(centred(&positions, colours, indices));
        }
        Ok(placed)
    }
}

/// An upper bound of the map's largest stretch, exact if its axes stay orthogonal (Gershgorin's circles about
/// the squares of the singular values).
fn largest_scale(map: &DAffine3) -> f64 {
    let m = map.matrix3;
    let row = |a: DVec3| a.dot(m.x_axis).abs() + a.dot(m.y_axis).abs() + a.dot(m.z_axis).abs();
    row(m.x_axis).max(row(m.y_axis)).max(row(m.z_axis)).sqrt()
}

/// Whether the tessellation fills the box stored with the primitive: no side is off by more than 5 % of the
/// box's diagonal, plus the loss by chords. Lines have no surface and fit any box.
fn fits_stored_box(primitive: &Primitive, solid: &Solid, tolerance: f64) -> bool {
    if matches!(primitive.shape, Shape::Line) {
        return true;
    }
    let [stored_low, stored_high] = primitive.stored_box;
    let (low, high) = bounds(&solid.positions);
    let off = (low - stored_low).abs().max((high - stored_high).abs()).max_element();
    off <= 0.05 * (stored_high - stored_low).length() + tolerance
}

#[cfg(test)]
mod tests {
    use trimaran_scene::Rgba8;

    use super::*;
    use crate::import::{ImportLimits, Resource};

    fn tube(radius: f64, matrix: DAffine3) -> Solids {
        let shape = Shape::Cylinder { radius, height: 100.0 };
        let stored_box = [DVec3::new(-radius, -radius, -50.0), DVec3::new(radius, radius, 50.0)];
        let primitives = vec![Primitive { at: FilePosition::Byte(77), matrix, stored_box, shape }];
        Solids { group: 0, material: Some(1), colour_known: true, colour: Rgba8([0; 4]), primitives }
    }

    fn place(group: &Solids) -> Placed {
        place_within(group, ImportLimits::default()).unwrap()
    }

    fn place_within(group: &Solids, limits: ImportLimits) -> Result<Placed, OverBudget> {
        let budget = Budget::new(limits);
        let frame = Frame { file_to_world: DAffine3::IDENTITY, chord_tolerance: 1e-3, budget: &budget };
        frame.place(group, "/TUBE")
    }

    fn volume(mesh: &Mesh) -> f32 {
        let at = |index: u32| mesh.positions[index as usize];
        mesh.indices.as_chunks::<3>().0.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    #[test]
    fn too_many_triangles_are_an_error_that_names_the_primitive() {
        let group = tube(50.0, DAffine3::from_scale(DVec3::splat(1e-3)));
        let limits = ImportLimits { triangles: 50, ..Default::default() };
        let Err(error) = place_within(&group, limits) else { unreachable!("50 are enough") };
        assert_eq!((error.resource, error.limit), (Resource::Triangles, 50));
        assert!(error.user.contains("byte 77") && error.user.contains("/TUBE"), "{error}");
    }

    /// One huge number in a file.
    #[test]
    fn an_absurd_size_does_not_make_millions_of_triangles() {
        let huge = 1e30;
        let shapes = [
            Shape::Sphere { diameter: huge },
            Shape::Cylinder { radius: huge, height: 1.0 },
            Shape::CircularTorus { offset: huge, radius: 1.0, angle: 7.0 },
            Shape::CircularTorus { offset: huge, radius: huge, angle: 7.0 },
            Shape::CircularTorus { offset: 1.0, radius: huge, angle: 1.0 },
            Shape::RectangularTorus { inner: 1.0, outer: huge, height: 1.0, angle: 7.0 },
            Shape::EllipticalDish { radius: huge, height: 1.0 },
            Shape::EllipticalDish { radius: 1.0, height: huge },
            Shape::SphericalDish { radius: huge, height: 1.0 },
            Shape::SphericalDish { radius: huge, height: huge },
            Shape::Snout {
                bottom: huge,
                top: 1.0,
                height: 1.0,
                offset: [0.0; 2],
                bottom_shear: [1.5; 2],
                top_shear: [0.0; 2],
            },
        ];
        for shape in shapes {
            let solid = tessellate(&shape, Chord { tolerance: 1.0 });
            let triangles = solid.indices.len() / 3;
            assert!((12..=200_000).contains(&triangles), "{shape:?}: {triangles} triangles");
        }
    }

    #[test]
    fn what_is_beyond_all_reach_is_left_out() {
        let mut group = tube(50.0, DAffine3::from_scale(DVec3::splat(1e-3)));
        let (alone, origin) = place(&group).mesh.unwrap();
        group.primitives.extend(tube(50.0, DAffine3::from_translation(DVec3::X * 1e16)).primitives);
        let placed = place(&group);
        assert_eq!((placed.left_out, placed.box_mismatches), (1, 0));
        let (mesh, place) = placed.mesh.unwrap();
        assert_eq!((mesh.positions, mesh.indices, place), (alone.positions, alone.indices, origin));
    }

    #[test]
    fn a_mirroring_matrix_keeps_faces_outward() {
        for side in [1e-3, -1e-3] {
            let group = tube(50.0, DAffine3::from_scale(DVec3::new(side, 1e-3, 1e-3)));
            let placed = place(&group);
            assert!(volume(&placed.mesh.unwrap().0) > 7e-4, "{side}");
            assert_eq!(placed.box_mismatches, 0);
        }
    }

    #[test]
    fn the_tolerance_is_that_of_the_world() {
        let triangles = |matrix| place(&tube(50.0, matrix)).mesh.unwrap().0.triangle_count();
        let small = triangles(DAffine3::from_scale(DVec3::splat(1e-3)));
        let stretched = triangles(DAffine3::from_scale(DVec3::new(1e-3, 0.1, 1e-3)));
        assert!(stretched > 9 * small, "{stretched} and {small}");
    }
}
