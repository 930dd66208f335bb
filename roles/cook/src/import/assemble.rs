//! Shared by all importers at the end: welds meshes, places them, and joins the files' parts into one model.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3, Vec3};

use super::budget::{Budget, OverBudget};
use super::report::{ImportReport, WarningKind};
use super::{ImportError, ImportOptions, Imported, Part, PlantFrame};
use crate::{Mesh, Model, Object, Source};
use trimaran_scene::{Extent, Group, ObjectAttributes, Rgba8};

/// The colour of a surface without one, in formats that prescribe none: parts of full colour.
pub(super) const GREY: [f64; 3] = [0.6; 3];

/// [`GREY`], opaque.
pub(super) fn grey() -> Rgba8 {
    let [r, g, b] = GREY;
    rgba([r, g, b, 1.0])
}

/// A colour and an opacity of parts from 0 to 1. The casts clamp.
pub(super) fn rgba(parts: [f64; 4]) -> Rgba8 {
    Rgba8(parts.map(|part| (part * 255.0).round() as u8))
}

/// Position and colour as one run of bytes: corners with equal keys are one vertex.
#[derive(Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Key {
    position: [f32; 3],
    colour: [u8; 4],
}

/// Joins vertices of equal position and colour, and drops unused vertices. Files split vertices for normals
/// and textures, which the model lacks. Triangles stay unchanged, flat ones too.
pub(super) fn weld(mesh: &Mesh) -> Mesh {
    let keys: Vec<Key> = mesh
        .positions
        .iter()
        .zip(&mesh.colours)
        // Adding zero turns -0 into 0, which is the same position in other bytes.
        .map(|(&position, &Rgba8(colour))| Key { position: (position + Vec3::ZERO).to_array(), colour })
        .collect();
    if keys.is_empty() || mesh.indices.is_empty() {
        return Mesh::default();
    }
    let (count, remap) = meshopt::generate_vertex_remap(&keys, Some(&mesh.indices));
    let vertices = meshopt::remap_vertex_buffer(&keys, count, &remap);
    let indices = meshopt::remap_index_buffer(Some(&mesh.indices), mesh.indices.len(), &remap);
    Mesh {
        positions: vertices.iter().map(|key| Vec3::from_array(key.position)).collect(),
        colours: vertices.iter().map(|key| Rgba8(key.colour)).collect(),
        indices,
    }
}

/// A mesh centred on the middle of its box, and that middle: this keeps single precision accurate.
pub(super) fn centred(positions: &[DVec3], colours: Vec<Rgba8>, indices: Vec<u32>) -> (Mesh, DVec3) {
    let (low, high) = bounds(positions);
    // Half first: the sum could overflow.
    let origin = if positions.is_empty() { DVec3::ZERO } else { low / 2.0 + high / 2.0 };
    let positions = positions.iter().map(|p| (p - origin).as_vec3()).collect();
    (weld(&Mesh { positions, colours, indices }), origin)
}

/// Whether each triangle has two corners in one place, so that nothing of it would be in the scene.
pub(super) fn draws_nothing(mesh: &Mesh) -> bool {
    let at = |corner: u32| mesh.positions.get(corner as usize);
    let is_flat = |&[a, b, c]: &[u32; 3]| at(a) == at(b) || at(b) == at(c) || at(c) == at(a);
    mesh.indices.as_chunks::<3>().0.iter().all(is_flat)
}

/// The largest coordinate, metres: single precision is 100 km coarse there, and squares and volumes are still
/// finite.
pub(super) const FARTHEST: f64 = 1e15;

/// Whether a point is within [`FARTHEST`].
pub(super) fn is_in_reach(place: DVec3) -> bool {
    place.abs().max_element() <= FARTHEST && !place.is_nan()
}

/// Whether a box of these lower and upper corners is within [`FARTHEST`], before and after placing.
pub(super) fn is_near((low, high): (DVec3, DVec3), to_world: &DAffine3) -> bool {
    let corners = [low, high].map(|a| [low, high].map(|b| [low, high].map(|c| DVec3::new(a.x, b.y, c.z))));
    let is_near = |&place: &DVec3| is_in_reach(place) && is_in_reach(to_world.transform_point3(place));
    corners.as_flattened().as_flattened().iter().all(is_near)
}

/// The lower and the upper corner of the box around all positions; infinite and inverted if there are none.
pub(super) fn bounds(positions: &[DVec3]) -> (DVec3, DVec3) {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    positions.iter().fold(empty, |(low, high), &p| (low.min(p), high.max(p)))
}

/// Places `mesh` in the part. If the matrix is singular, flattens the mesh itself: an object must keep an
/// invertible matrix, and a flattened one is still visible. Each of those is a mesh of its own, which counts
/// against the budget.
pub(super) fn place(
    part: &mut Part,
    budget: &Budget,
    mesh: u32,
    to_world: DAffine3,
    name: String,
    source_index: u32,
) -> Result<(), OverBudget> {
    let (mut mesh, mut to_world) = (mesh, to_world);
    let Some(shape) = part.model.meshes.get(mesh as usize) else { return Ok(()) };
    if to_world.is_finite() && to_world.matrix3.determinant() == 0.0 {
        let (triangles, vertices) = (shape.triangle_count() as u64, shape.positions.len() as u64);
        budget.mesh(triangles, vertices, || format!("object {name:?}, which its matrix flattens,"))?;
        let positions = shape.positions.iter().map(|p| (to_world.matrix3 * p.as_dvec3()).as_vec3()).collect();
        let flat = Mesh { positions, ..shape.clone() };
        mesh = part.model.meshes.len() as u32;
        to_world = DAffine3::from_translation(to_world.translation);
        part.model.meshes.push(flat);
        part.report.warn_of(WarningKind::FlattenedObject, "", &name);
    }
    part.model.objects.push(Object { mesh, to_world, name, source: 0, source_index });
    Ok(())
}

/// Adds an object with a mesh of its own, about a point in the world.
pub(super) fn place_own(model: &mut Model, mesh: Mesh, origin: DVec3, name: &str, source_index: u32) {
    let (number, to_world) = (model.meshes.len() as u32, DAffine3::from_translation(origin));
    model.meshes.push(mesh);
    model.objects.push(Object { mesh: number, to_world, name: name.to_owned(), source: 0, source_index });
}

/// Joins the files' parts, in order, into one checked model.
pub(super) fn merge<'a>(
    budget: &Budget,
    options: &ImportOptions,
    parts: impl IntoIterator<Item = (&'a Path, Result<Part, ImportError>)>,
) -> Result<Imported, ImportError> {
    let mut model = Model::default();
    let mut report = ImportReport::default();
    let mut without = Vec::new();
    let mut plant = options.plant;
    for (path, part) in parts {
        let Part { model: mut part, report: mut met } = part?;
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        part.sources = vec![Source { name: file.clone() }];
        within_file(&mut part, file.clone());
        part.check().map_err(|source| ImportError::Model { path: path.to_owned(), source })?;
        let said = part.coordinates.plant;
        if options.plant.is_none() && said != PlantFrame::default() && *plant.get_or_insert(said) != said {
            met.warn(WarningKind::ElsewhereOnMap, 1);
        }
        report.absorb(met, &file);
        if part.objects.is_empty() {
            without.push(file);
        }
        append(&mut model, part)?;
    }
    // Without any object, no file is listed as lacking objects.
    if !model.objects.is_empty() {
        for file in without {
            let mut of_file = ImportReport::default();
            of_file.warn(WarningKind::FileWithoutObject, 1);
            report.absorb(of_file, &file);
        }
    }
    model.coordinates.plant = plant.unwrap_or_default();
    report.looked_for = budget.looked_for();
    report.files = model.sources.len() as u64;
    report.objects = model.objects.len() as u64;
    report.meshes = model.meshes.len() as u64;
    report.triangles = model.triangle_count() as u64;
    report.unique_triangles = model.meshes.iter().map(Mesh::triangle_count).sum::<usize>() as u64;
    Ok(Imported { model, report })
}

/// Puts all groups of a file into one with the file's name.
fn within_file(part: &mut Model, name: String) {
    let groups = std::mem::take(&mut part.hierarchy.groups);
    let objects = 0..part.objects.len() as u32;
    let extent = Extent::default();
    let file = Group { name: name.into(), parent: None, objects, attributes: Vec::new(), extent };
    let below =
        groups.into_iter().map(|group| Group { parent: Some(group.parent.map_or(0, |p| p + 1)), ..group });
    part.hierarchy.groups = std::iter::once(file).chain(below).collect();
}

fn append(model: &mut Model, part: Model) -> Result<(), ImportError> {
    let first_mesh = index(model.meshes.len(), part.meshes.len(), "meshes")?;
    let first_source = index(model.sources.len(), part.sources.len(), "files")?;
    let first_object = index(model.objects.len(), part.objects.len(), "objects")?;
    let first_group = index(model.hierarchy.groups.len(), part.hierarchy.groups.len(), "groups")?;
    model.meshes.extend(part.meshes);
    model.sources.extend(part.sources);
    model.coordinates.files.extend(part.coordinates.files);
    model.objects.extend(part.objects.into_iter().map(|object| Object {
        mesh: object.mesh + first_mesh,
        source: object.source + first_source,
        ..object
    }));
    model.hierarchy.groups.extend(part.hierarchy.groups.into_iter().map(|group| Group {
        parent: group.parent.map(|parent| parent + first_group),
        objects: group.objects.start + first_object..group.objects.end + first_object,
        ..group
    }));
    model.hierarchy.attributes.extend(
        part.hierarchy
            .attributes
            .into_iter()
            .map(|of| ObjectAttributes { object: of.object + first_object, ..of }),
    );
    Ok(())
}

/// The index of the first of `more` items behind `present` ones, if all of them fit 32 bits.
fn index(present: usize, more: usize, what: &'static str) -> Result<u32, ImportError> {
    match (u32::try_from(present), u32::try_from(present.saturating_add(more))) {
        (Ok(first), Ok(_)) => Ok(first),
        _ => Err(ImportError::TooLarge { what }),
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::import::ImportLimits;

    const RED: Rgba8 = Rgba8([255, 0, 0, 255]);
    const BLUE: Rgba8 = Rgba8([0, 0, 255, 255]);

    fn triangle_soup() -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [-0.0, 1.0]];
        Mesh {
            positions: corners.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect(),
            colours: vec![RED; 6],
            indices: (0..6).collect(),
        }
    }

    #[test]
    fn welding_joins_equal_vertices_and_zeros_of_either_sign() {
        let mesh = weld(&triangle_soup());
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.indices.len(), 6);
    }

    #[test]
    fn welding_keeps_colours_apart() {
        let mut soup = triangle_soup();
        soup.colours[3..].fill(BLUE);
        assert_eq!(weld(&soup).positions.len(), 6);
    }

    #[test]
    fn welding_drops_vertices_without_a_triangle() {
        let mut soup = triangle_soup();
        soup.indices.truncate(3);
        let mesh = weld(&soup);
        assert_eq!((mesh.positions.len(), mesh.indices), (3, vec![0, 1, 2]));
        soup.indices.clear();
        assert!(weld(&soup).positions.is_empty());
    }

    #[test]
    fn a_singular_matrix_flattens_the_mesh_and_not_the_object() {
        let mut part = Part { model: Model::default(), report: ImportReport::default() };
        part.model.meshes.push(triangle_soup());
        let squash = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(2.0, 0.0, 1.0)),
            DVec3::new(5.0, 6.0, 7.0),
        );
        let limits = ImportLimits { triangles: 2, ..Default::default() };
        let budget = Budget::new(limits);
        place(&mut part, &budget, 0, squash, String::from("flat"), 9).unwrap();
        let error = place(&mut part, &budget, 0, squash, String::from("again"), 9).unwrap_err();
        assert!(error.to_string().contains("\"again\""), "{error}");
        let object = &part.model.objects[0];
        assert_eq!((object.mesh, object.source_index), (1, 9));
        assert_eq!(object.to_world, DAffine3::from_translation(DVec3::new(5.0, 6.0, 7.0)));
        assert_eq!(part.model.meshes[1].positions[4], Vec3::new(2.0, 0.0, 0.0));
        assert_eq!(part.report.counts(), [(WarningKind::FlattenedObject, 1)]);
    }
}
