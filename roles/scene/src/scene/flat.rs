//! Scenes without a hierarchy, made by hand.

use glam::{DVec3, Mat3, Vec3};

use super::{Drawable, Geometry, Node, ObjectRecord, Rgba8, SceneArrays, Shading, Sides, Vertex};

/// An object of a flat scene: triangles of one colour in a local frame, and the frame's place.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatObject {
    /// Corners, in the local frame.
    pub positions: Vec<Vec3>,
    /// Three indices per triangle.
    pub indices: Vec<u32>,
    /// Of all triangles.
    pub colour: Rgba8,
    /// The local frame's axes in the world.
    pub linear: Mat3,
    /// Where the local frame's origin is, metres.
    pub origin: DVec3,
}

impl SceneArrays {
    /// A root with one leaf per object, only at its finest level: object `i` is drawable `i` and node `i +
    /// 1`.
    #[must_use]
    pub fn flat(objects: &[FlatObject]) -> Self {
        let mut arrays =
            Self { sources: vec!["flat".to_owned()], nodes: vec![Node::default()], ..Self::default() };
        for (index, object) in (0..).zip(objects) {
            arrays.nodes.push(Node {
                object: index,
                first_drawable: index,
                drawable_count: 1,
                ..object.leaf()
            });
            arrays.objects.push(ObjectRecord {
                source: 0,
                source_index: index,
                name_start: 0,
                name_length: 0,
                node: index + 1,
            });
            let vertices = object.positions.iter().map(|at| Vertex::new(at.to_array(), object.colour));
            let mut shading = Shading::new(vertices.collect());
            let mut indices = object.indices.clone();
            shading.turn(&mut indices);
            arrays.add_level(index + 1, 0.0, Geometry { vertices: shading.into_vertices(), indices });
        }
        let boxes = arrays.nodes.iter().skip(1).map(Node::world_box);
        if let Some((min, max)) = boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            && let Some(root) = arrays.nodes.first_mut()
        {
            let origin = (min + max) / 2.0;
            let half = (max - origin).as_vec3() * 1.001;
            *root = Node {
                origin: origin.to_array(),
                local_min: (-half).to_array(),
                local_max: half.to_array(),
                world_min: min.to_array(),
                world_max: max.to_array(),
                first_child: 1,
                child_count: objects.len() as u32,
                ..*root
            };
        }
        arrays
    }

    /// Appends a level of the node in one piece, with triangles of its own.
    pub fn add_level(&mut self, node: u32, error: f32, geometry: Geometry) {
        self.drawables.push(Drawable {
            error,
            node,
            geometry: self.geometries.len() as u32,
            triangles: geometry.triangles() as u32,
            sides: Sides::BOTH,
            piece: 0,
            pieces: 1,
        });
        self.geometries.push(geometry);
    }
}

impl FlatObject {
    /// A leaf with the object's frame and boxes.
    fn leaf(&self) -> Node {
        let local = self.positions.iter().copied();
        let linear = self.linear.as_dmat3();
        let world = || local.clone().map(|at| self.origin + linear * at.as_dvec3());
        let (min, max) = (world().fold(DVec3::MAX, DVec3::min), world().fold(DVec3::MIN, DVec3::max));
        // More than the rounding of sums in any order.
        let rounding = 1e-12 * (min.abs().max(max.abs()));
        Node {
            parent: 0,
            origin: self.origin.to_array(),
            linear: self.linear.to_cols_array(),
            local_min: local.clone().fold(Vec3::MAX, Vec3::min).to_array(),
            local_max: local.fold(Vec3::MIN, Vec3::max).to_array(),
            world_min: (min - rounding).to_array(),
            world_max: (max + rounding).to_array(),
            ..Node::default()
        }
    }
}
