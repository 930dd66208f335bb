//! The triangles of drawables, each mesh under a tree of its own.

use std::{
    collections::{HashMap, hash_map::Entry},
    sync::Arc,
};

use glam::{DMat3, Mat3, Vec3A, Vec4};
use obvhs::rt_triangle::RtTriangle;
use rayon::prelude::*;
use trimaran_scene::{Drawable, Node, Scene};

use super::{packet::Packet, tree::Tree};

/// Triangles in a frame of their own.
pub(crate) struct Mesh {
    tree: Tree,
    /// In the tree's order.
    triangles: Box<[RtTriangle]>,
}

/// The identity of a mesh: drawables that agree in this share one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Shape {
    geometry: u32,
    /// The bits of the node's matrix, if the mesh is transformed by it.
    turned: Option<[u32; 9]>,
}

/// All meshes made so far.
#[derive(Default)]
pub(crate) struct Meshes {
    made: HashMap<Shape, Option<Arc<Mesh>>>,
}

/// The most triangles of a leaf.
const LEAF: u32 = 8;

/// The largest coordinate, metres: products of three are still finite.
pub(crate) const LARGEST: f32 = 1e12;

/// The limits of a matrix's anisotropy and of its scale for transforming rays into its node's frame: beyond
/// them f32 is too imprecise. In Frobenius norms, whose least anisotropy is 3.
const MOST_STRETCH: f64 = 100.0;
const MOST_SCALE: f64 = 1e4;

impl Shape {
    /// The shape of a drawable, and the map of directions from the world to its mesh's frame.
    pub(crate) fn of(drawable: &Drawable, node: &Node) -> (Self, DMat3) {
        let shape = |turned| Self { geometry: drawable.geometry, turned };
        let to_world = node.linear().as_dmat3();
        let to_node = to_world.inverse();
        let (grows, shrinks) = (norm(&to_world), norm(&to_node));
        if grows * shrinks <= MOST_STRETCH && grows.max(shrinks) <= MOST_SCALE {
            (shape(None), to_node)
        } else {
            (shape(Some(node.linear.map(f32::to_bits))), DMat3::IDENTITY)
        }
    }
}

fn norm(matrix: &DMat3) -> f64 {
    matrix.to_cols_array().iter().map(|entry| entry * entry).sum::<f64>().sqrt()
}

impl Meshes {
    /// Makes the missing meshes of these drawables' shapes.
    pub(crate) fn make(&mut self, scene: &Scene, wanted: impl Iterator<Item = (Shape, Drawable)>) {
        let mut missing = Vec::new();
        for (shape, drawable) in wanted {
            if let Entry::Vacant(vacant) = self.made.entry(shape) {
                vacant.insert(None);
                missing.push((shape, drawable));
            }
        }
        let make = |(shape, drawable): (Shape, Drawable)| {
            (shape, Mesh::new(scene, &drawable, shape.turned).map(Arc::new))
        };
        self.made.par_extend(missing.into_par_iter().map(make));
    }

    /// The mesh of this shape; `None` if it is not made, or cannot be.
    pub(crate) fn get(&self, shape: Shape) -> Option<&Arc<Mesh>> {
        self.made.get(&shape)?.as_ref()
    }
}

impl Mesh {
    /// The drawable's triangles, perhaps transformed. `None` if a coordinate is too large.
    fn new(scene: &Scene, drawable: &Drawable, turned: Option<[u32; 9]>) -> Option<Self> {
        let turn = turned
            .map_or(DMat3::IDENTITY, |bits| Mat3::from_cols_array(&bits.map(f32::from_bits)).as_dmat3());
        let mirrors = turn.determinant() < 0.0;
        let mut triangles = Vec::with_capacity(drawable.triangles as usize);
        for corners in scene.triangles(drawable) {
            let [a, b, c] = corners.map(|corner| (turn * corner.as_dvec3()).as_vec3a());
            if ![a, b, c].iter().all(|corner| corner.abs().max_element() <= LARGEST) {
                return None;
            }
            let triangle = if mirrors { RtTriangle::new(a, c, b) } else { RtTriangle::new(a, b, c) };
            // Without an area it covers nothing.
            if triangle.ng != Vec3A::ZERO {
                triangles.push(triangle);
            }
        }
        let (tree, order) = Tree::over(&triangles, LEAF);
        let triangles = order.iter().filter_map(|&index| triangles.get(index as usize).copied()).collect();
        Some(Self { tree, triangles })
    }

    /// The distance to the first triangle along each ray; infinite without a hit by `end`, or without a hit
    /// of a front if only `front`s count.
    #[inline]
    pub(crate) fn first(&self, packet: &Packet, end: Vec4, front: bool, stack: &mut Vec<u32>) -> Vec4 {
        let mut end = end;
        let mut first = Vec4::INFINITY;
        self.tree.visit(packet, &mut end, stack, |leaf, end| {
            for triangle in self.triangles.get(leaf).unwrap_or_default() {
                let distance = packet.meets(triangle, front, *end);
                first = first.min(distance);
                *end = end.min(distance);
            }
        });
        first
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use trimaran_audit::cases::{Object, build, with_records};

    use super::*;

    fn shapes(linears: &[Mat3]) -> Vec<Shape> {
        let square = trimaran_audit::cases::Mesh::rectangle(Vec3::ZERO, Vec3::X, Vec3::Y, 1);
        let objects = linears.iter().map(|linear| Object::new(square.clone()).turned(*linear));
        let own = build(&objects.collect::<Vec<_>>(), false).unwrap();
        // They all draw the first one's triangles.
        let first = own.drawables()[0];
        let shared = own.drawables().iter().map(|drawable| Drawable { node: drawable.node, ..first });
        let scene = with_records(&own, own.nodes().to_vec(), shared.collect()).unwrap();
        let shape = |drawable: &Drawable| Shape::of(drawable, &scene.nodes()[drawable.node as usize]).0;
        let shapes: Vec<Shape> = scene.drawables().iter().map(shape).collect();
        let mut meshes = Meshes::default();
        meshes.make(&scene, shapes.iter().copied().zip(scene.drawables().iter().copied()));
        assert!(shapes.iter().all(|shape| meshes.get(*shape).is_some()));
        meshes.make(&scene, shapes.iter().copied().zip(scene.drawables().iter().copied()));
        let mut made: Vec<Shape> = meshes.made.into_keys().collect();
        made.sort_unstable_by_key(|shape| shape.turned);
        made
    }

    #[test]
    fn instances_share_a_mesh_however_they_are_turned() {
        let turned = |angle: f32| Mat3::from_rotation_y(angle) * Mat3::from_rotation_x(2.0 * angle);
        let turns = [Mat3::IDENTITY, turned(1.0) * 1e-3, turned(2.0) * -1.0];
        assert_eq!(shapes(&turns).len(), 1);
    }

    #[test]
    fn what_is_stretched_much_has_a_mesh_for_each_way_it_is_stretched() {
        let stretched = |by: f32| Mat3::from_diagonal(Vec3::new(1.0, by, 1.0));
        let shapes = shapes(&[0.0, 1e3, 1e3, -1e3, 1.5, 1.0].map(stretched));
        assert_eq!(
            shapes.iter().map(|shape| shape.turned.is_some()).collect::<Vec<_>>(),
            [false, true, true, true]
        );
    }
}
