//! The triangles of a drawable: their packing, and their place in a file.
//!
//! A piece is packed by meshoptimizer's codecs, without loss, so that it can be read alone: a vertex codec
//! over whole [`Vertex`]es, and an index codec. The index codec may turn a triangle's corners; as the first
//! one carries colour and normal, two bits a triangle say how to turn it back.
//!
//! | bytes | what |
//! |---|---|
//! | 4 | number of vertices, little-endian as all numbers |
//! | 4 | number of triangles |
//! | 4 | length of the packed vertices |
//! | .. | the packed vertices |
//! | .. | the turns, 4 triangles a byte, the first in the low bits: how far the first corner has moved on |
//! | .. | the packed indices, to the end |

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use thiserror::Error;

use super::{Node, Vertex};

/// The triangles of a drawable, in its node's local frame. Instances share them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// The corners.
    pub vertices: Vec<Vertex>,
    /// Three per triangle, into `vertices`. The first of the three carries the triangle's colour and normal.
    pub indices: Vec<u32>,
}

/// The place and size of a piece of geometry.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GeometryPlace {
    /// The page, counted among those of geometry.
    pub(super) page: u32,
    /// Its first byte in the page.
    pub(super) offset: u32,
    /// Its length, packed.
    pub length: u32,
    /// How many vertices it has.
    pub vertices: u32,
    /// How many triangles.
    pub triangles: u32,
    /// The box around its vertices, in the frame of a node that shows it: lower corner.
    pub local_min: [f32; 3],
    /// Upper corner.
    pub local_max: [f32; 3],
}

impl GeometryPlace {
    /// A piece outside of any page, with this many bytes packed.
    pub(super) fn alone(geometry: &Geometry, length: usize) -> Self {
        let count = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        let (vertices, triangles) = (count(geometry.vertices.len()), count(geometry.triangles()));
        let [local_min, local_max] = geometry.local_box().map(|corner| corner.to_array());
        Self { page: 0, offset: 0, length: count(length), vertices, triangles, local_min, local_max }
    }

    /// Whether it is the place of this geometry.
    pub(super) fn fits(&self, geometry: &Geometry) -> bool {
        let Self { page, offset, length, .. } = *self;
        *self == Self { page, offset, ..Self::alone(geometry, length as usize) }
    }

    /// The box around its vertices: lower and upper corner.
    #[must_use]
    pub const fn local_box(&self) -> (Vec3, Vec3) {
        (Vec3::from_array(self.local_min), Vec3::from_array(self.local_max))
    }
}

/// Why bytes are not valid geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// The counts at its start do not match its length.
    #[error("it is {0} bytes long, too short for what it says it holds")]
    Length(usize),
    /// The codec cannot unpack its vertices.
    #[error("its vertices cannot be unpacked")]
    Vertices,
    /// The codec cannot unpack its indices, or one is out of range.
    #[error("its indices cannot be unpacked")]
    Indices,
    /// A position is NaN or infinite.
    #[error("the position of its vertex {0} is not finite")]
    Position(usize),
}

/// The most triangles per byte of packed indices, and vertices per triangle. They bound the unpacked size by
/// the packed one.
const TRIANGLES_A_BYTE: usize = 1;
const VERTICES_A_TRIANGLE: usize = 3;

impl Geometry {
    /// How many triangles it has.
    #[must_use]
    pub const fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// The box around its vertices: lower and upper corner. Infinite and inside out if there are none.
    fn local_box(&self) -> [Vec3; 2] {
        let points = self.vertices.iter().map(|vertex| Vec3::from_array(vertex.position));
        let empty = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        points.fold(empty, |[low, high], at| [low.min(at), high.max(at)])
    }

    /// The node with the boxes of this geometry alone, which is a part of it.
    #[must_use]
    pub fn part_of(&self, node: &Node) -> Node {
        let [min, max] = self.local_box();
        node.part(min, max)
    }

    /// The first vertex whose position is not finite, or the first index without a vertex, if any.
    #[must_use]
    pub fn check(&self) -> Option<GeometryError> {
        let finite = |vertex: &Vertex| vertex.position.iter().all(|x| x.is_finite());
        if let Some(index) = self.vertices.iter().position(|vertex| !finite(vertex)) {
            return Some(GeometryError::Position(index));
        }
        let inside = self.indices.iter().all(|&index| (index as usize) < self.vertices.len());
        (!inside).then_some(GeometryError::Indices)
    }

    /// Packs it. `None` if it has no triangles, an index has no vertex, or vertices are more than three a
    /// triangle.
    #[must_use]
    pub fn pack(&self) -> Option<Vec<u8>> {
        let (triangles, count) = (self.triangles(), self.vertices.len());
        let sound = triangles > 0 && self.indices.len().is_multiple_of(3) && self.check().is_none();
        if !sound || count > VERTICES_A_TRIANGLE * triangles {
            return None;
        }
        let vertices = meshopt::encode_vertex_buffer(&self.vertices).ok()?;
        let indices = meshopt::encode_index_buffer(&self.indices, count).ok()?;
        let unpacked = meshopt::decode_index_buffer::<u32>(&indices, self.indices.len()).ok()?;
        let mut turns = vec![0_u8; triangles.div_ceil(4)];
        let corners = self.indices.as_chunks::<3>().0.iter().zip(unpacked.as_chunks::<3>().0);
        for (triangle, (given, unpacked)) in corners.enumerate() {
            let turn = (0..3_u8).find(|&turn| turned(*unpacked, turn) == *given)?;
            *turns.get_mut(triangle / 4)? |= turn << (2 * (triangle % 4));
        }
        let sizes = [count as u32, triangles as u32, vertices.len() as u32];
        Some([bytemuck::cast_slice(&sizes), &vertices, &turns, &indices].concat())
    }

    /// Unpacks the output of [`pack`](Self::pack). Its allocation is bounded by the length of `bytes`.
    ///
    /// # Errors
    /// If the bytes are invalid.
    pub fn unpack(bytes: &[u8]) -> Result<Self, GeometryError> {
        let short = GeometryError::Length(bytes.len());
        let (sizes, rest) = bytes.split_first_chunk::<12>().ok_or(short)?;
        let [count, triangles, packed]: [u32; 3] = bytemuck::pod_read_unaligned(sizes);
        let (count, triangles) = (count as usize, triangles as usize);
        let (vertices, rest) = rest.split_at_checked(packed as usize).ok_or(short)?;
        if triangles > TRIANGLES_A_BYTE * rest.len() || count > VERTICES_A_TRIANGLE * triangles {
            return Err(short);
        }
        let (turns, indices) = rest.split_at_checked(triangles.div_ceil(4)).ok_or(short)?;
        let vertices = meshopt::decode_vertex_buffer::<[u32; size_of::<Vertex>() / 4]>(vertices, count)
            .map_err(|_| GeometryError::Vertices)?;
        let vertices = bytemuck::cast_vec(vertices);
        let mut indices = meshopt::decode_index_buffer::<u32>(indices, 3 * triangles)
            .map_err(|_| GeometryError::Indices)?;
        for (triangle, corners) in indices.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let turns = turns.get(triangle / 4).copied().unwrap_or_default();
            *corners = turned(*corners, (turns >> (2 * (triangle % 4))) & 3);
        }
        let unpacked = Self { vertices, indices };
        unpacked.check().map_or(Ok(unpacked), Err)
    }
}

/// The corners rotated so that the one of this number is first. 3 stands for 0.
const fn turned([a, b, c]: [u32; 3], first: u8) -> [u32; 3] {
    match first {
        1 => [b, c, a],
        2 => [c, a, b],
        _ => [a, b, c],
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Rgba8;

    fn any_geometry() -> impl Strategy<Value = Geometry> {
        (1_usize..80).prop_flat_map(|triangles| {
            let vertex = (prop::array::uniform3(-1e6_f32..1e6), any::<[u8; 4]>())
                .prop_map(|(position, colour)| Vertex::new(position, Rgba8(colour)));
            prop::collection::vec(vertex, 1..=3 * triangles).prop_flat_map(move |vertices| {
                let corner = 0..vertices.len() as u32;
                let indices = prop::collection::vec(corner, 3 * triangles);
                indices.prop_map(move |indices| Geometry { vertices: vertices.clone(), indices })
            })
        })
    }

    proptest! {
        #[test]
        fn what_is_packed_unpacks_to_the_bit(geometry in any_geometry()) {
            let unpacked = Geometry::unpack(&geometry.pack().unwrap()).unwrap();
            prop_assert_eq!(unpacked, geometry);
        }

        #[test]
        fn damaged_bytes_are_refused_or_are_sound(
            geometry in any_geometry(), at in any::<prop::sample::Index>(), change in 1_u8..=255
        ) {
            let mut bytes = geometry.pack().unwrap();
            *at.get_mut(&mut bytes) ^= change;
            if let Ok(unpacked) = Geometry::unpack(&bytes) {
                prop_assert_eq!(unpacked.check(), None);
            }
        }

        #[test]
        fn any_bytes_are_refused_or_are_sound(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            if let Ok(unpacked) = Geometry::unpack(&bytes) {
                prop_assert_eq!(unpacked.check(), None);
            }
        }
    }

    #[test]
    fn counts_far_beyond_the_bytes_are_refused_before_memory_is_taken() {
        let huge = [u32::MAX, u32::MAX, 0];
        assert_eq!(Geometry::unpack(bytemuck::cast_slice(&huge)), Err(GeometryError::Length(12)));
        assert_eq!(Geometry::unpack(&[]), Err(GeometryError::Length(0)));
    }

    #[test]
    fn what_is_no_geometry_is_not_packed() {
        let vertex = Vertex::new([0.0; 3], Rgba8([0; 4]));
        assert_eq!(Geometry::default().pack(), None);
        assert_eq!(Geometry { vertices: vec![vertex], indices: vec![0, 0, 1] }.pack(), None);
        assert_eq!(Geometry { vertices: vec![vertex; 4], indices: vec![0, 1, 2] }.pack(), None);
        let far = Vertex::new([f32::NAN, 0.0, 0.0], Rgba8([0; 4]));
        assert_eq!(Geometry { vertices: vec![far], indices: vec![0, 0, 0] }.pack(), None);
    }
}
