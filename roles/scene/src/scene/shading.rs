//! Data for flat shading of a triangle, carried by its first corner.
//!
//! A flat attribute of a triangle is that of its first corner (Vulkan's provoking vertex). So a triangle's
//! corners are rotated until the first is one that begins no triangle of another normal or colour; if there
//! is none, a corner is duplicated. Then lighting is computed per vertex and not per pixel. Triangles keep
//! their order, their winding and their corners' positions.

use glam::{DVec3, Vec3};

use super::Vertex;
use crate::Rgba8;

/// A unit vector along the axes of a node's local frame, in octahedral encoding. The vector is scaled so that
/// its absolute coordinates add up to 1. If z is negative, (x, y) is mirrored in the nearest of the four
/// lines |x| + |y| = 1, and z is dropped. 32767 is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Normal(pub [i16; 2]);

impl Normal {
    /// Stands for "no triangle begins here": -1 has two codes, and directions do not use this one.
    pub const NONE: Self = Self([i16::MIN; 2]);

    /// The normal of a triangle, on the side from which its corners run counter-clockwise. Arbitrary for a
    /// triangle without area.
    #[must_use]
    pub fn of(corners: [[f32; 3]; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| Vec3::from_array(corner).as_dvec3());
        let across = (b - a).cross(c - a);
        let length = across.abs().element_sum();
        let flat = if length > 0.0 { across / length } else { DVec3::Z };
        // Avoids -0, so that one direction has one code.
        let flat = flat + DVec3::ZERO;
        let [x, y] = if flat.z < 0.0 {
            [(1.0 - flat.y.abs()).copysign(flat.x), (1.0 - flat.x.abs()).copysign(flat.y)]
        } else {
            [flat.x, flat.y]
        };
        Self([x, y].map(|along| (along * f64::from(i16::MAX)).round() as i16))
    }

    /// The unit vector.
    #[must_use]
    pub fn direction(self) -> DVec3 {
        let [x, y] = self.0.map(|along| f64::from(along) / f64::from(i16::MAX));
        let z = 1.0 - x.abs() - y.abs();
        let under = (-z).max(0.0);
        DVec3::new(x - under.copysign(x), y - under.copysign(y), z).normalize()
    }
}

/// Prepares triangles over one array of vertices for flat shading.
#[derive(Debug, Clone)]
pub struct Shading {
    vertices: Vec<Vertex>,
    /// The vertices' original colours: a triangle's is that of its original first corner.
    given: Vec<Rgba8>,
}

impl Shading {
    /// No triangles yet, and these vertices.
    #[must_use]
    pub fn new(vertices: Vec<Vertex>) -> Self {
        let given = vertices.iter().map(|vertex| vertex.colour).collect();
        Self { vertices, given }
    }

    /// Rotates triangles: three indices each, into the given vertices. Afterwards each triangle's first
    /// corner carries its colour and normal. Another array of triangles over the same vertices may follow.
    /// Indices out of range are left for the scene's check to refuse.
    pub fn turn(&mut self, indices: &mut [u32]) {
        let Some(last) = indices.iter().max().copied().filter(|&last| (last as usize) < self.given.len())
        else {
            return;
        };
        let triangles = indices.as_chunks_mut().0;
        let facets: Vec<Facet> = triangles.iter().map(|corners| self.facet(*corners)).collect();
        let meeting = Meeting::new(last as usize + 1, triangles);
        let mut turned = vec![false; triangles.len()];
        for start in 0..triangles.len() {
            if turned[start] {
                continue;
            }
            let facet = facets[start];
            let alike = |corner: u32| {
                meeting
                    .at(corner)
                    .iter()
                    .map(|&other| other as usize)
                    .filter(|&t| !turned[t] && facets[t] == facet)
            };
            // Prefers a corner that carries the facet already, then a free one, then one to duplicate; among
            // equals one that serves many triangles.
            let rank = |&corner: &u32| (self.readiness(corner, facet), alike(corner).count());
            let Some(shared) = triangles[start].into_iter().max_by_key(rank) else { continue };
            let served: Vec<usize> = alike(shared).collect();
            let carrier = self.carry(shared, facet);
            for triangle in served {
                turned[triangle] = true;
                let [a, b, c] = triangles[triangle];
                triangles[triangle] = match shared {
                    _ if shared == a => [carrier, b, c],
                    _ if shared == b => [carrier, c, a],
                    _ => [carrier, a, b],
                };
            }
        }
    }

    /// The vertices: those given, the colour of each that of the triangles that begin there, and after them
    /// the doubled ones.
    #[must_use]
    pub fn into_vertices(self) -> Vec<Vertex> {
        self.vertices
    }

    fn facet(&self, corners: [u32; 3]) -> Facet {
        let positions = corners.map(|corner| self.vertices[corner as usize].position);
        Facet { normal: Normal::of(positions), colour: self.given[corners[0] as usize] }
    }

    /// The cost of beginning a facet at a vertex: 2 if it carries the facet, 1 if it is free, 0 if it must be
    /// duplicated.
    fn readiness(&self, vertex: u32, Facet { normal, colour }: Facet) -> u8 {
        match self.vertices[vertex as usize] {
            vertex if vertex.normal == normal && vertex.colour == colour => 2,
            vertex if vertex.normal == Normal::NONE => 1,
            _ => 0,
        }
    }

    /// The vertex, or its duplicate, that carries the facet from now on.
    fn carry(&mut self, vertex: u32, facet: Facet) -> u32 {
        let Facet { normal, colour } = facet;
        let carrier = Vertex { normal, colour, ..self.vertices[vertex as usize] };
        if self.readiness(vertex, facet) > 0 {
            self.vertices[vertex as usize] = carrier;
            return vertex;
        }
        self.vertices.push(carrier);
        self.vertices.len() as u32 - 1
    }
}

/// The data of a triangle's first corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Facet {
    normal: Normal,
    colour: Rgba8,
}

/// The triangles at each vertex.
struct Meeting {
    /// The start of each vertex's triangles, and the end of the last one's.
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Meeting {
    /// Of triangles over `count` vertices.
    fn new(count: usize, triangles: &[[u32; 3]]) -> Self {
        let mut starts = vec![0_u32; count + 1];
        for &corner in triangles.as_flattened() {
            starts[corner as usize] += 1;
        }
        // The end of each vertex's triangles; filling from behind moves it to the start.
        let mut end = 0;
        for start in &mut starts {
            end += *start;
            *start = end;
        }
        let mut meeting = vec![0; 3 * triangles.len()];
        for (triangle, corners) in triangles.iter().enumerate().rev() {
            for &corner in corners {
                let slot = &mut starts[corner as usize];
                *slot -= 1;
                meeting[*slot as usize] = triangle as u32;
            }
        }
        Self { starts, triangles: meeting }
    }

    fn at(&self, vertex: u32) -> &[u32] {
        let [start, end] = [0, 1].map(|next| self.starts[vertex as usize + next] as usize);
        &self.triangles[start..end]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RED: Rgba8 = Rgba8([255, 0, 0, 255]);
    const BLUE: Rgba8 = Rgba8([0, 0, 255, 255]);

    /// The corners of the unit cube: bit i of a corner's number is its coordinate along axis i.
    fn cube_corners(colour: impl Fn(u32) -> Rgba8) -> Vec<Vertex> {
        let position = |corner: u32| [0, 1, 2].map(|axis| (corner >> axis & 1) as f32);
        (0..8).map(|corner| Vertex::new(position(corner), colour(corner))).collect()
    }

    /// Two triangles a face, outward.
    const CUBE: [u32; 36] = [
        0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3,
        7, 5,
    ];

    /// Rotates the triangles, and checks that each is at most a rotation of the given one, and begins with
    /// its colour and normal.
    fn turned(vertices: &[Vertex], levels: &[&[u32]]) -> (Vec<Vertex>, Vec<Vec<u32>>) {
        let mut shading = Shading::new(vertices.to_vec());
        let mut after = Vec::new();
        for level in levels {
            let mut indices = level.to_vec();
            shading.turn(&mut indices);
            after.push(indices);
        }
        let shaded = shading.into_vertices();
        for (before, after) in levels.iter().zip(&after) {
            assert_eq!(before.len(), after.len());
            for (&before, &after) in before.as_chunks::<3>().0.iter().zip(after.as_chunks::<3>().0) {
                let places = after.map(|at| shaded[at as usize].position);
                let [a, b, c] = before.map(|at| vertices[at as usize].position);
                assert!([[a, b, c], [b, c, a], [c, a, b]].contains(&places), "{before:?} became {after:?}");
                let first = shaded[after[0] as usize];
                assert_eq!(first.colour, vertices[before[0] as usize].colour);
                let [a, b, c] = [a, b, c].map(|p| Vec3::from_array(p).as_dvec3());
                let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
                assert!(first.normal.direction().distance(normal) < 1e-4, "{before:?} faces {normal}");
            }
        }
        (shaded, after)
    }

    #[test]
    fn a_cube_has_a_corner_for_each_face_and_needs_no_more_than_its_own() {
        let (shaded, _) = turned(&cube_corners(|_| RED), &[&CUBE]);
        assert_eq!(shaded.iter().filter(|vertex| vertex.normal != Normal::NONE).count(), 6);
        assert_eq!(shaded.len(), 8);
    }

    #[test]
    fn triangles_of_two_colours_do_not_share_a_corner() {
        // Corner 0 is blue and taken by a red triangle before the blue one that begins there comes.
        let vertices = cube_corners(|corner| if corner == 0 { BLUE } else { RED });
        turned(&vertices, &[&[1, 0, 2, 1, 0, 4, 2, 1, 4, 0, 2, 1]]);
        turned(&cube_corners(|corner| if corner % 3 == 0 { RED } else { BLUE }), &[&CUBE]);
    }

    #[test]
    fn triangles_alike_share_a_corner() {
        let (shaded, indices) = turned(&cube_corners(|_| RED), &[&[0, 2, 1, 3, 0, 2]]);
        // The second is no half of a face, but level with the first, and begins with the corner that carries
        // their normal.
        assert_eq!(indices, [[2, 1, 0, 2, 3, 0]]);
        assert_eq!(shaded.len(), 8);
        assert_eq!(shaded.iter().filter(|vertex| vertex.normal != Normal::NONE).count(), 1);
    }

    #[test]
    fn levels_share_vertices_and_keep_off_each_others_corners() {
        let (shaded, _) =
            turned(&cube_corners(|_| RED), &[&CUBE, &[0, 3, 5, 0, 5, 6, 0, 6, 3, 3, 6, 5], &CUBE]);
        assert!(shaded.len() <= 8 + 4, "four new normals at most need a corner, not {}", shaded.len() - 8);
    }

    #[test]
    fn a_corner_is_doubled_where_all_are_taken() {
        let at = |x: f32, y: f32, z: f32| Vertex::new([x, y, z], RED);
        let vertices = [at(0.0, 0.0, 1.0), at(1.0, 0.0, 0.0), at(0.0, 1.0, 0.0), at(-1.0, 0.0, 0.0)];
        let (shaded, _) = turned(&vertices, &[&[0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 3, 2, 1, 3, 2]]);
        assert_eq!(shaded.len(), 5);
    }

    #[test]
    fn a_triangle_without_area_has_some_normal() {
        let (shaded, indices) = turned(&[Vertex::new([1.0; 3], RED); 3], &[&[0, 1, 2]]);
        assert_eq!(shaded[indices[0][0] as usize].normal.direction(), DVec3::Z);
    }

    #[test]
    fn triangles_of_no_vertices_are_left_alone() {
        let mut shading = Shading::new(vec![Vertex::new([0.0; 3], RED)]);
        let mut indices = [0, 0, 7];
        shading.turn(&mut indices);
        assert_eq!(indices, [0, 0, 7]);
    }

    proptest! {
        #[test]
        fn a_direction_and_its_code_differ_by_less_than_the_eye_sees(
            a in prop::array::uniform3(-9.0_f32..9.0),
            b in prop::array::uniform3(-9.0_f32..9.0),
            c in prop::array::uniform3(-9.0_f32..9.0),
        ) {
            let [p, q, r] = [a, b, c].map(|p| Vec3::from_array(p).as_dvec3());
            let normal = (q - p).cross(r - p);
            prop_assume!(normal.length() > 1e-9);
            let code = Normal::of([a, b, c]);
            prop_assert!(code != Normal::NONE);
            prop_assert!(code.direction().distance(normal.normalize()) < 1e-4);
            // The same triangle has the same code from whichever corner it begins, or one beside it.
            let turned = Normal::of([b, c, a]);
            prop_assert!(code.direction().distance(turned.direction()) < 1e-4);
        }
    }
}
