//! Finds see-through objects by the alpha of their colours.
//!
//! An object is see-through as a whole or not at all, since a view state names objects. It is if more than
//! half of its surface is. Its opacity is the alpha of its vertices.

use glam::Vec3;
use rayon::prelude::*;
use trimaran_proto::ObjectSet;
use trimaran_scene::Rgba8;

use crate::lists::at;
use crate::{Mesh, Model};

/// A colour with at least this alpha is opaque: rounding takes some.
const OPAQUE: u8 = 250;

/// The see-through objects.
pub(super) fn objects(model: &Model) -> ObjectSet {
    let meshes: Vec<bool> = model.meshes.par_iter().map(is_see_through).collect();
    (0..).zip(&model.objects).filter(|(_, of)| at(&meshes, of.mesh)).map(|(number, _)| number).collect()
}

/// The colour with full alpha, for an object that is not see-through.
pub(super) const fn solid(Rgba8([red, green, blue, _]): Rgba8) -> Rgba8 {
    Rgba8([red, green, blue, 255])
}

/// Whether more than half of the surface is see-through.
pub(super) fn is_see_through(mesh: &Mesh) -> bool {
    if mesh.colours.iter().all(|&colour| is_opaque(colour)) {
        return false;
    }
    let (mut opaque, mut through) = (0.0, 0.0);
    for &[a, b, c] in mesh.indices.as_chunks::<3>().0 {
        let places: [Vec3; 3] = [a, b, c].map(|corner| at(&mesh.positions, corner));
        let area = f64::from((places[1] - places[0]).cross(places[2] - places[0]).length());
        let corners = [a, b, c].map(|corner| mesh.colours.get(corner as usize).copied());
        let solid = corners.into_iter().flatten().filter(|&colour| is_opaque(colour)).count();
        *(if solid >= 2 { &mut opaque } else { &mut through }) += area;
    }
    through > opaque
}

const fn is_opaque(Rgba8([_, _, _, alpha]): Rgba8) -> bool {
    alpha >= OPAQUE
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::{CookOptions, Object, Source, cook};

    /// A square of two triangles with this side, and the alphas of its corners.
    fn square(side: f32, alpha: [u8; 4]) -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        Mesh {
            positions: corners.map(|[x, y]| Vec3::new(x, y, 0.0) * side).to_vec(),
            colours: alpha.map(|alpha| Rgba8([200, 0, 0, alpha])).to_vec(),
            indices: vec![0, 1, 2, 0, 2, 3],
        }
    }

    fn model(meshes: Vec<Mesh>) -> Model {
        let object = |mesh: u32| Object {
            mesh,
            to_world: DAffine3::from_translation(glam::DVec3::X * f64::from(mesh) * 9.0),
            name: format!("square {mesh}"),
            source: 0,
            source_index: mesh,
        };
        let objects = (0..meshes.len() as u32).map(object).collect();
        let sources = vec![Source { name: "squares".to_owned() }];
        Model { meshes, objects, sources, ..Model::default() }
    }

    #[test]
    fn an_object_is_see_through_where_most_of_its_surface_is() {
        let mut frame = square(1.0, [255; 4]);
        let glass = square(2.0, [64; 4]);
        let first = frame.positions.len() as u32;
        frame.positions.extend(glass.positions);
        frame.colours.extend(glass.colours);
        frame.indices.extend(glass.indices.iter().map(|index| first + index));
        let meshes = vec![
            square(1.0, [255; 4]),
            square(1.0, [0; 4]),
            square(1.0, [254; 4]),
            frame,
            square(1.0, [255, 255, 255, 10]),
        ];
        assert_eq!(objects(&model(meshes)).iter().collect::<Vec<_>>(), [1, 3]);
    }

    #[test]
    fn a_cooked_scene_says_so_after_it_was_saved_and_its_vertices_say_how_much() {
        let model = model(vec![square(1.0, [255, 255, 255, 3]), square(1.0, [100; 4])]);
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("glass.scene");
        scene.save(&path).unwrap();
        let opened = trimaran_scene::Scene::open(&path).unwrap();
        assert_eq!(opened.see_through().iter().collect::<Vec<_>>(), [1]);
        for (object, alpha) in [(0, 255), (1, 100)] {
            let of_it = |node: &&trimaran_scene::Node| node.object == object;
            let node = opened.nodes().iter().find(of_it).unwrap();
            let drawable = opened.drawables().get(node.first_drawable as usize).unwrap();
            let geometry = opened.geometry(drawable.geometry).unwrap();
            assert!(geometry.vertices.iter().all(|vertex| vertex.colour.0[3] == alpha), "{object}");
        }
    }
}
