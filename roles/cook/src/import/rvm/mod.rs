//! RVM: the review format of AVEVA's plant design programs (PDMS, E3D), in which process plants are
//! exchanged.
//!
//! A file is a tree of named groups that hold primitives: cylinders, boxes, tori, and so on, eleven kinds.
//! Each group with primitives of its own becomes one object, its primitives tessellated into one mesh about
//! the middle of the group. There is no public specification; the facts here are those that readers of the
//! format agree on, checked against the box that every primitive stores.

mod attributes;
mod colour;
mod error;
mod parse;
mod reader;
mod round;
mod shape;
mod solid;
mod tessellate;

use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

pub use error::RvmError;

use self::attributes::Attributes;
use self::parse::{File, Group, Primitive};
use self::shape::Shape;
use self::solid::{Chord, Solid};
use self::tessellate::tessellate;
use super::assemble::{bounds, centred};
use super::budget::Budget;
use super::hierarchy::groups;
use super::report::{ImportReport, WarningKind};
use super::{ImportOptions, Part, UpAxis};
use crate::{Mesh, Model, Object};
use trimaran_scene::{ObjectAttributes, Rgba8};

/// Metres a unit of length that writers have in mind: a file's matrices take millimetres to metres.
const USUAL_UNIT: f64 = 1e-3;

/// Reads an RVM file. `source_index` of its objects is the running number of the group among all groups of
/// the file, in the order in which they open; groups without primitives count too.
///
/// What an attribute file beside it says of its groups is kept.
pub(super) fn import(
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, RvmError> {
    let file = File::parse(bytes, budget)?;
    let attributes = path.and_then(|path| attributes_beside(path, budget));
    let scale = options.unit.unwrap_or(USUAL_UNIT) / USUAL_UNIT;
    let frame = Frame {
        file_to_world: options.file_to_world(UpAxis::Z) * DAffine3::from_scale(DVec3::splat(scale)),
        chord_tolerance: options.chord_tolerance,
        budget,
    };
    let objects: Vec<Option<Placed>> = file
        .groups
        .par_iter()
        .map(|group| frame.place(group, colour::of(group.material, &file.colours)))
        .collect::<Result<_, _>>()?;

    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    part.report.warn(WarningKind::VolumeLeftOut, file.volumes);
    for (group, placed) in file.groups.into_iter().zip(objects) {
        let Some(Placed { mesh, origin, box_mismatches, large_polygons }) = placed else {
            part.report.warn_of(WarningKind::EmptyObject, "", &group.name);
            continue;
        };
        part.report.box_mismatches += box_mismatches;
        part.report.warn(WarningKind::LargePolygon, large_polygons);
        let object = part.model.objects.len() as u32;
        let said = attributes.as_ref().map(|all| all.of(&group.name)).unwrap_or_default();
        if !said.is_empty() {
            part.model.hierarchy.attributes.push(ObjectAttributes { object, attributes: said });
        }
        part.model.objects.push(Object {
            mesh: part.model.meshes.len() as u32,
            to_world: DAffine3::from_translation(origin),
            name: group.name,
            source: 0,
            source_index: group.index,
        });
        part.model.meshes.push(mesh);
    }
    let leaves: Vec<u32> = part.model.objects.iter().map(|object| object.source_index).collect();
    part.model.hierarchy.groups = groups(file.branches, &leaves);
    if let Some(attributes) = attributes {
        for group in &mut part.model.hierarchy.groups {
            group.attributes = attributes.of(&group.name);
        }
    }
    Ok(part)
}

/// The attributes of a file with the same name but for its ending, if there is one that can be read.
fn attributes_beside(path: &Path, budget: &Budget) -> Option<Attributes> {
    let endings = ["att", "ATT", "txt", "TXT"];
    endings.iter().find_map(|ending| Attributes::parse(&budget.read(&path.with_extension(ending)).ok()?))
}

/// A group as a mesh about `origin`.
struct Placed {
    mesh: Mesh,
    origin: DVec3,
    box_mismatches: u64,
    large_polygons: u64,
}

/// What all groups of a file are placed and cut by.
struct Frame<'a> {
    file_to_world: DAffine3,
    /// Metres.
    chord_tolerance: f64,
    budget: &'a Budget,
}

impl Frame<'_> {
    /// The group's primitives as one mesh; none if they have no surface.
    fn place(&self, group: &Group, colour: Rgba8) -> Result<Option<Placed>, RvmError> {
        let mut positions: Vec<DVec3> = Vec::new();
        let mut indices: Vec<u32> = Vec::new();
        let (mut box_mismatches, mut large_polygons) = (0, 0);
        for primitive in &group.primitives {
            let to_world = self.file_to_world * primitive.matrix;
            let scale = largest_scale(&to_world);
            let tolerance = if scale > 0.0 { self.chord_tolerance / scale } else { f64::MAX };
            let solid = tessellate(&primitive.shape, Chord { tolerance });
            // One primitive is small: a curve has a most number of chords, and facets stand in the file.
            let (triangles, vertices) = (solid.indices.len() / 3, solid.positions.len());
            self.budget.mesh(triangles as u64, vertices as u64, || {
                format!("the primitive at byte {} in group {:?}", primitive.offset, group.name)
            })?;
            large_polygons += solid.large_polygons;
            box_mismatches += u64::from(!fits_stored_box(primitive, &solid, tolerance));

            let first = positions.len() as u32;
            positions.extend(solid.positions.iter().map(|&p| to_world.transform_point3(p)));
            if positions.iter().skip(first as usize).any(|p| !p.as_vec3().is_finite()) {
                return Err(RvmError::Unusable {
                    offset: primitive.offset,
                    group: group.name.clone(),
                    what: "it is too large or too far away for its place to be a number",
                });
            }
            // A mirroring matrix turns the solid inside out.
            let mirrored = to_world.matrix3.determinant() < 0.0;
            let turned = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
            let triangles = solid.indices.as_chunks::<3>().0.iter();
            indices.extend(triangles.flat_map(turned).map(|index| index + first));
        }
        if indices.is_empty() {
            return Ok(None);
        }
        let colours = vec![colour; positions.len()];
        let (mesh, origin) = centred(&positions, colours, indices);
        Ok(Some(Placed { mesh, origin, box_mismatches, large_polygons }))
    }
}

/// An upper bound of how much the map lengthens anything, exact if its axes stay at right angles
/// (Gershgorin's circles about the squares of the singular values).
fn largest_scale(map: &DAffine3) -> f64 {
    let m = map.matrix3;
    let row = |a: DVec3| a.dot(m.x_axis).abs() + a.dot(m.y_axis).abs() + a.dot(m.z_axis).abs();
    row(m.x_axis).max(row(m.y_axis)).max(row(m.z_axis)).sqrt()
}

/// Whether the tessellation fills the box that the file stores with the primitive: no side is off by more
/// than 5 % of the box's diagonal, plus what cutting curves to chords may take away. Lines have no surface
/// and fit any box.
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
    use super::*;
    use crate::import::{ImportLimits, Resource};

    fn tube(radius: f64, matrix: DAffine3) -> Group {
        let shape = Shape::Cylinder { radius, height: 100.0 };
        let stored_box = [DVec3::new(-radius, -radius, -50.0), DVec3::new(radius, radius, 50.0)];
        let primitives = vec![Primitive { offset: 77, matrix, stored_box, shape }];
        Group { index: 0, name: "/TUBE".into(), material: 1, primitives }
    }

    fn place(group: &Group) -> Result<Option<Placed>, RvmError> {
        place_within(group, ImportLimits::default())
    }

    fn place_within(group: &Group, limits: ImportLimits) -> Result<Option<Placed>, RvmError> {
        let budget = Budget::new(limits);
        let frame = Frame { file_to_world: DAffine3::IDENTITY, chord_tolerance: 1e-3, budget: &budget };
        frame.place(group, Rgba8([0; 4]))
    }

    fn volume(mesh: &Mesh) -> f32 {
        let at = |index: u32| mesh.positions[index as usize];
        mesh.indices.as_chunks::<3>().0.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    #[test]
    fn too_many_triangles_are_an_error_that_names_the_primitive() {
        let group = tube(50.0, DAffine3::from_scale(DVec3::splat(1e-3)));
        let limits = ImportLimits { triangles: 50, ..Default::default() };
        let Err(RvmError::Budget(error)) = place_within(&group, limits) else {
            unreachable!("50 are enough")
        };
        assert_eq!((error.resource, error.limit), (Resource::Triangles, 50));
        assert!(error.user.contains("byte 77") && error.user.contains("/TUBE"), "{error}");
    }

    /// One number in a file, made huge.
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
    fn a_place_beyond_single_precision_is_an_error() {
        let group = tube(50.0, DAffine3::from_translation(DVec3::X * 1e39));
        assert!(matches!(place(&group), Err(RvmError::Unusable { offset: 77, .. })));
    }

    #[test]
    fn a_mirroring_matrix_keeps_faces_outward() {
        for side in [1e-3, -1e-3] {
            let group = tube(50.0, DAffine3::from_scale(DVec3::new(side, 1e-3, 1e-3)));
            let placed = place(&group).unwrap().unwrap();
            assert!(volume(&placed.mesh) > 7e-4, "{side}");
            assert_eq!(placed.box_mismatches, 0);
        }
    }

    #[test]
    fn the_tolerance_is_that_of_the_world() {
        let small = place(&tube(50.0, DAffine3::from_scale(DVec3::splat(1e-3)))).unwrap().unwrap();
        let stretched = DAffine3::from_scale(DVec3::new(1e-3, 0.1, 1e-3));
        let large = place(&tube(50.0, stretched)).unwrap().unwrap();
        assert!(large.mesh.triangle_count() > 9 * small.mesh.triangle_count());
    }
}
