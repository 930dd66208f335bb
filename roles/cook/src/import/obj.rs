//! Wavefront OBJ, with the diffuse colours of its material libraries.
//!
//! Each run of faces under one `o` or `g` name becomes an object.

use std::cell::RefCell;
use std::path::Path;

use glam::{DAffine3, DVec3};
use thiserror::Error;
use tobj::{LoadError, LoadOptions, Material};

use super::assemble::centred;
use super::budget::Budget;
use super::neighbours::Neighbours;
use super::polygon::Triangulator;
use super::report::{ImportReport, WarningKind};
use super::{ImportOptions, OverBudget, Part, UpAxis};
use crate::{Model, Object};
use trimaran_scene::Rgba8;

/// What is wrong with an OBJ file, and where.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ObjError {
    /// A line does not parse, or an object up to that line refers to a vertex that is not there.
    #[error("it is malformed at line {line}, or in the object that ends there: {source}")]
    Malformed {
        /// Line in the file, from 1 on.
        line: usize,
        /// What is wrong there.
        source: LoadError,
    },
    /// A vertex is not a place.
    #[error(
        "object {object:?} has a vertex that is not finite, or too far away; repair the model where it was made"
    )]
    NotFinite {
        /// The object's name.
        object: String,
    },
    /// It asks for more than is allowed.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

/// What a face without a material is drawn in.
const GREY: [f64; 3] = [0.6; 3];

/// Reads an OBJ file. `source_index` of its objects is their running number in the file, from 0 on.
pub(super) fn import(
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, ObjError> {
    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    let (text, lines_left_out) = essence(&String::from_utf8_lossy(bytes));
    part.report.warn(WarningKind::PointsOrLines, lines_left_out);

    let mut rest = text.as_bytes();
    let load_options = LoadOptions::default();
    let neighbours = RefCell::new(Neighbours::of(path, budget));
    let library = |name: &Path| match neighbours.borrow_mut().read(name) {
        Ok((bytes, false)) => tobj::load_mtl_buf(&mut String::from_utf8_lossy(&bytes).as_bytes()),
        // Its materials are known by now.
        Ok((_, true)) => Ok((Vec::new(), Default::default())),
        Err(_) => Err(LoadError::OpenFileFailed),
    };
    let loaded = tobj::load_obj_buf(&mut rest, &load_options, library);
    let read = text.len() - rest.len();
    let (models, materials) = loaded.map_err(|source| {
        let line = text.as_bytes().iter().take(read).filter(|&&byte| byte == b'\n').count();
        ObjError::Malformed { line: line.max(1), source }
    })?;
    part.report.warn(WarningKind::MaterialsMissing, u64::from(materials.is_err()));
    let materials = materials.unwrap_or_default();
    let textured = materials.iter().filter(|material| material.diffuse_texture.is_some());
    part.report.warn(WarningKind::TexturedMaterial, textured.count() as u64);

    let file_to_world =
        options.file_to_world(UpAxis::Y) * DAffine3::from_scale(DVec3::splat(options.unit.unwrap_or(1.0)));
    let mut triangulator = Triangulator::new();
    // A change of material splits an object in the reader; here it is one again.
    for (index, run) in (0..).zip(models.chunk_by(|a, b| a.name == b.name)) {
        let mut shape = Shape::default();
        let name = run.first().map(|model| model.name.clone()).unwrap_or_default();
        let user = || format!("object {name:?}");
        budget.objects(1, name.len(), user)?;
        for model in run {
            let mesh = &model.mesh;
            budget.mesh(most_triangles(mesh), (mesh.positions.len() / 3) as u64, user)?;
            let material = model.mesh.material_id.and_then(|material| materials.get(material));
            shape.append(&model.mesh, material, &file_to_world, &mut triangulator);
        }
        if shape.indices.is_empty() {
            part.report.warn(WarningKind::EmptyObject, 1);
            continue;
        }
        if shape.positions.iter().any(|p| !p.as_vec3().is_finite()) {
            return Err(ObjError::NotFinite { object: name });
        }
        let (mesh, origin) = centred(&shape.positions, shape.colours, shape.indices);
        part.model.objects.push(Object {
            mesh: part.model.meshes.len() as u32,
            to_world: DAffine3::from_translation(origin),
            name,
            source: 0,
            source_index: index,
        });
        part.model.meshes.push(mesh);
    }
    part.report.warn(WarningKind::LargePolygon, triangulator.large_polygons());
    Ok(part)
}

/// The most triangles that a mesh's faces make.
fn most_triangles(mesh: &tobj::Mesh) -> u64 {
    let faces = if mesh.face_arities.is_empty() { mesh.indices.len() / 3 } else { mesh.face_arities.len() };
    (mesh.indices.len() as u64).saturating_sub(2 * faces as u64)
}

/// The lines that make surfaces, the others empty so that numbers of lines stay; and the number of elements
/// of points or lines. The reader would take a line of three points for a triangle, and a hostile number of a
/// normal can overflow in it: it gets neither to see.
fn essence(text: &str) -> (String, u64) {
    let mut left_out = 0;
    let mut kept = String::with_capacity(text.len());
    // Colours of some vertices only would be taken for those of others.
    let is_vertex = |line: &&str| line.split_whitespace().next() == Some("v");
    let all_coloured = text.lines().filter(is_vertex).all(|line| line.split_whitespace().nth(6).is_some());
    for line in text.lines() {
        match line.split_whitespace().next() {
            Some("v") if !all_coloured => {
                let place = line.split_whitespace().take(if line.split_whitespace().nth(6).is_some() {
                    4
                } else {
                    8
                });
                kept.extend(place.flat_map(|word| [word, " "]));
            }
            // A face of two corners is a line by another name.
            Some("f") if line.split_whitespace().nth(3).is_none() => left_out += 1,
            Some("v" | "f" | "o" | "g" | "usemtl" | "mtllib") => kept.push_str(line),
            Some("l" | "p") => left_out += 1,
            _ => {}
        }
        kept.push('\n');
    }
    (kept, left_out)
}

/// An object in the making, in the world frame.
#[derive(Default)]
struct Shape {
    positions: Vec<DVec3>,
    colours: Vec<Rgba8>,
    indices: Vec<u32>,
}

impl Shape {
    fn append(
        &mut self,
        mesh: &tobj::Mesh,
        material: Option<&Material>,
        to_world: &DAffine3,
        triangulator: &mut Triangulator,
    ) {
        let first = self.positions.len() as u32;
        let corners = mesh.positions.as_chunks::<3>().0;
        self.positions.extend(corners.iter().map(|&p| to_world.transform_point3(DVec3::from_array(p))));

        let alpha = material.and_then(|material| material.dissolve).unwrap_or(1.0);
        match material.and_then(|material| material.diffuse) {
            None if mesh.vertex_color.len() == mesh.positions.len() => {
                let colours = mesh.vertex_color.as_chunks::<3>().0;
                self.colours.extend(colours.iter().map(|&rgb| colour(rgb, alpha)));
            }
            diffuse => {
                let colour = colour(diffuse.unwrap_or(GREY), alpha);
                self.colours.extend(std::iter::repeat_n(colour, corners.len()));
            }
        }

        let mut rest = mesh.indices.as_slice();
        let arities = mesh.face_arities.iter().map(|&arity| arity as usize);
        let triangles_only =
            std::iter::repeat_n(3, if mesh.face_arities.is_empty() { rest.len() / 3 } else { 0 });
        for arity in arities.chain(triangles_only) {
            let Some((face, behind)) = rest.split_at_checked(arity) else { break };
            rest = behind;
            let place = |&index: &u32| self.positions.get((first + index) as usize).copied();
            let contour: Vec<DVec3> = face.iter().filter_map(place).collect();
            for triangle in triangulator.triangulate(&[contour]) {
                let corners = triangle.map(|corner| face.get(corner as usize));
                if let [Some(&a), Some(&b), Some(&c)] = corners {
                    self.indices.extend([first + a, first + b, first + c]);
                }
            }
        }
    }
}

/// Material libraries keep colours as they are to be shown. The casts clamp.
fn colour(rgb: [f64; 3], alpha: f64) -> Rgba8 {
    let byte = |value: f64| (value * 255.0).round() as u8;
    let [r, g, b] = rgb.map(byte);
    Rgba8([r, g, b, byte(alpha)])
}

#[cfg(test)]
mod tests {
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
        assert_eq!(report.warnings, []);
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
    fn errors_name_the_line_or_the_object() {
        let line = |text: &str| match parse(text) {
            Err(ObjError::Malformed { line, .. }) => line,
            other => panic!("{:?}", other.map(|part| part.model)),
        };
        assert_eq!(line("v 0 0 0\n\nv 1 x 0\n"), 3);
        assert_eq!(line(&format!("{SQUARE}vn 0 0 1\nf 1 2 9\n")), 6);
        assert_eq!(line("f 0 0 0\n"), 1);
        let vertex = "v 0 0 0\nv inf 0 0\nv 0 1 0\no bad\nf 1 2 3\n";
        assert_eq!(parse(vertex).err(), Some(ObjError::NotFinite { object: "bad".into() }));
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
        // Unless some vertices have none.
        let Part { model, .. } = parse(&text.replacen(" 1 0 0\n", "\n", 1)).unwrap();
        assert_eq!(model.meshes[0].colours[1], Rgba8([153, 153, 153, 255]));
    }
}
