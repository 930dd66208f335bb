//! Free space in a scene: rays and clearances against its finest geometry.

use std::{
    cell::{Cell, RefCell},
    collections::HashMap,
    rc::Rc,
};

use glam::{DMat3, DVec3};

use super::triangles::{Triangles, ray_box, ray_triangle, segment_triangle};
use crate::{Node, NodeId, Scene};

/// A walker's queries to a scene: the hit of a ray, and the distance to the nearest surface. Distances are in
/// metres, in the world frame, against the finest level of every leaf.
///
/// The scene's own tree leads to the leaves; a mesh gets a tree of its triangles on the first query near it,
/// once for all its instances. A leaf whose matrix cannot be inverted counts as solid throughout its box.
#[derive(Debug)]
pub struct Space<'a> {
    scene: &'a Scene,
    /// By the number of their geometry.
    meshes: RefCell<HashMap<u32, Rc<Triangles>>>,
}

/// The hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The distance, metres.
    pub distance: f64,
    /// The leaf hit.
    pub leaf: NodeId,
}

impl<'a> Space<'a> {
    /// The space of a scene.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, meshes: RefCell::default() }
    }

    /// The scene.
    #[must_use]
    pub const fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The nearest surface from `origin` along `direction` (any length), at most `limit` metres away. Both
    /// sides of a triangle count.
    #[must_use]
    pub fn ray(&self, origin: DVec3, direction: DVec3, limit: f64) -> Option<Hit> {
        let direction = direction.try_normalize()?;
        let inverse = direction.recip();
        let mut nearest: Option<Hit> = None;
        let mut reach = limit;
        let mut stack = vec![0_u32];
        while let Some(index) = stack.pop() {
            let Some(node) = self.scene.nodes().get(index as usize) else { continue };
            let (min, max) = node.world_box();
            let (near, far) = ray_box(origin, inverse, min, max);
            if near > far || far < 0.0 || near > reach {
                continue;
            }
            if !node.is_leaf() {
                stack.extend(node.children());
                continue;
            }
            let met = self.leaf_ray(node, origin, direction, reach, near.max(0.0));
            if let Some(distance) = met.filter(|&d| d <= reach) {
                reach = distance;
                nearest = Some(Hit { distance, leaf: NodeId(index) });
            }
        }
        nearest
    }

    /// The distance from the segment `from`..`to` to the nearest surface, or `limit` if none is as near. A
    /// segment that goes through a surface is 0 away from it.
    #[must_use]
    pub fn clearance(&self, from: DVec3, to: DVec3, limit: f64) -> f64 {
        let mut least = limit;
        self.visit_leaves(from.min(to) - limit, from.max(to) + limit, |_, node| {
            least = least.min(self.leaf_clearance(node, from, to, least));
            least > 0.0
        });
        least
    }

    /// The number of leaves whose box comes within `radius` of a point, counted up to `most`.
    #[must_use]
    pub fn crowd(&self, centre: DVec3, radius: f64, most: usize) -> usize {
        let mut count = 0;
        self.visit_leaves(centre - radius, centre + radius, |_, _| {
            count += 1;
            count < most
        });
        count
    }

    /// Calls `visit` with each leaf whose box meets the given one, until it returns false.
    fn visit_leaves(&self, min: DVec3, max: DVec3, mut visit: impl FnMut(NodeId, &Node) -> bool) {
        let mut stack = vec![0_u32];
        while let Some(index) = stack.pop() {
            let Some(node) = self.scene.nodes().get(index as usize) else { continue };
            let (low, high) = node.world_box();
            if low.cmpgt(max).any() || high.cmplt(min).any() {
                continue;
            }
            if !node.is_leaf() {
                stack.extend(node.children());
            } else if !visit(NodeId(index), node) {
                return;
            }
        }
    }

    fn leaf_ray(&self, node: &Node, origin: DVec3, direction: DVec3, limit: f64, entry: f64) -> Option<f64> {
        let linear = node.linear().as_dmat3();
        let Some(inverse) = inverse(linear) else { return Some(entry) };
        // An affine map preserves the hit's multiple of the direction.
        let (origin, direction) = (inverse * (origin - node.origin()), inverse * direction);
        let reciprocal = direction.recip();
        let nearest = Cell::new(None);
        let reach = || nearest.get().unwrap_or(limit);
        self.mesh(node)?.visit(
            |min, max| {
                let (near, far) = ray_box(origin, reciprocal, min.as_dvec3(), max.as_dvec3());
                near <= far && far >= 0.0 && near <= reach()
            },
            |triangle| {
                let met = ray_triangle(origin, direction, triangle.map(|corner| corner.as_dvec3()));
                if met.is_some_and(|t| t <= reach()) {
                    nearest.set(met);
                }
            },
        );
        nearest.get()
    }

    fn leaf_clearance(&self, node: &Node, from: DVec3, to: DVec3, limit: f64) -> f64 {
        let linear = node.linear().as_dmat3();
        let Some(inverse) = inverse(linear) else { return 0.0 };
        let (from, to) = (from - node.origin(), to - node.origin());
        // The box, in the local frame, of the segment grown by `limit`: a ball there is an ellipsoid, whose
        // extent along an axis is the length of the inverse's row.
        let (a, b) = (inverse * from, inverse * to);
        let rows = inverse.transpose();
        let reach = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length()) * limit;
        let (low, high) = (a.min(b) - reach, a.max(b) + reach);
        let mut least = limit;
        let Some(mesh) = self.mesh(node) else { return limit };
        mesh.visit(
            |min, max| !(min.as_dvec3().cmpgt(high).any() || max.as_dvec3().cmplt(low).any()),
            |triangle| {
                let corners = triangle.map(|corner| linear * corner.as_dvec3());
                least = least.min(segment_triangle(from, to, corners));
            },
        );
        least
    }

    /// The triangles of a leaf's finest level, in its local frame.
    fn mesh(&self, node: &Node) -> Option<Rc<Triangles>> {
        let drawable = self.scene.drawables().get(node.first_drawable as usize)?;
        let key = drawable.geometry;
        if let Some(mesh) = self.meshes.borrow().get(&key) {
            return Some(Rc::clone(mesh));
        }
        let mesh = Rc::new(Triangles::new(self.scene.triangles(drawable).collect()));
        self.meshes.borrow_mut().insert(key, Rc::clone(&mesh));
        Some(mesh)
    }
}

/// The inverse of a leaf's matrix, if it has one.
fn inverse(linear: DMat3) -> Option<DMat3> {
    let inverse = linear.inverse();
    (linear.determinant() != 0.0 && inverse.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;
    use proptest::prelude::*;

    use super::*;
    use crate::path::testing::{boxes, uncooked};

    #[test]
    fn a_ray_finds_the_nearest_of_two_boxes() {
        let scene =
            uncooked(&boxes(&[([5.0, -1.0, -1.0], [6.0, 1.0, 1.0]), ([2.0, -1.0, -1.0], [3.0, 1.0, 1.0])]));
        let space = Space::new(&scene);
        let hit = space.ray(DVec3::ZERO, DVec3::X * 0.1, 100.0).unwrap();
        assert!((hit.distance - 2.0).abs() < 1e-9);
        assert_eq!(hit.leaf, NodeId(2));
        assert_eq!(space.ray(DVec3::ZERO, DVec3::X, 1.5), None);
        assert_eq!(space.ray(DVec3::ZERO, DVec3::Y, 100.0), None);
        assert_eq!(space.ray(DVec3::ZERO, DVec3::ZERO, 100.0), None);
    }

    #[test]
    fn clearance_is_capped_and_zero_through_a_wall() {
        let scene = uncooked(&boxes(&[([2.0, -1.0, -1.0], [3.0, 1.0, 1.0])]));
        let space = Space::new(&scene);
        assert_eq!(space.clearance(DVec3::ZERO, DVec3::ZERO, 1.5), 1.5);
        assert!((space.clearance(DVec3::ZERO, DVec3::X * 0.5, 9.0) - 1.5).abs() < 1e-9);
        assert_eq!(space.clearance(DVec3::ZERO, DVec3::X * 9.0, 9.0), 0.0);
        assert_eq!((space.crowd(DVec3::ZERO, 1.0, 9), space.crowd(DVec3::ZERO, 2.5, 9)), (0, 1));
    }

    #[test]
    fn a_singular_leaf_is_solid() {
        let mut model = boxes(&[([2.0, -1.0, -1.0], [3.0, 1.0, 1.0])]);
        // Invertible in f64, as a model must be, but not in the scene's f32.
        model.objects[0].to_world = DAffine3::from_scale(DVec3::new(1e-60, 1e-60, 1.0));
        let scene = uncooked(&model);
        let space = Space::new(&scene);
        assert_eq!(space.clearance(DVec3::Z * 0.5, DVec3::Z * 0.5, 1.0), 0.0);
        assert!(space.ray(DVec3::new(-1.0, 0.0, 0.5), DVec3::X, 9.0).is_some());
    }

    proptest! {
        #[test]
        fn sheared_and_scaled_instances_keep_world_distances(
            columns in prop::array::uniform9(-3.0f64..3.0), at in prop::array::uniform3(-5.0f64..5.0),
            from in prop::array::uniform3(-5.0f64..5.0), to in prop::array::uniform3(-5.0f64..5.0)
        ) {
            let matrix = DMat3::from_cols_array(&columns).as_mat3().as_dmat3();
            prop_assume!(matrix.determinant().abs() > 0.05);
            let mut model = boxes(&[([0.0; 3], [1.0; 3])]);
            model.objects[0].to_world = DAffine3 { matrix3: matrix, translation: DVec3::from_array(at) };
            let scene = uncooked(&model);
            let (from, to) = (DVec3::from_array(from), DVec3::from_array(to));
            let mesh = &model.meshes[0];
            let exact = mesh.indices.chunks(3).map(|t| {
                let corner = |i: u32| model.objects[0].to_world.transform_point3(mesh.positions[i as usize].as_dvec3());
                segment_triangle(from, to, [corner(t[0]), corner(t[1]), corner(t[2])])
            }).fold(2.0, f64::min);
            prop_assert!((Space::new(&scene).clearance(from, to, 2.0) - exact).abs() < 1e-9);
        }
    }
}
