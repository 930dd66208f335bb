//! Snaps a pointer to a vertex, an edge or a face of the finest geometry, independent of the level of detail
//! shown.

use std::borrow::Cow;

use glam::DVec3;
use serde::Serialize;
use trimaran_scene::{Level, Node, ReadError, Scene};

/// The most triangles that are read for an answer.
const MOST: u64 = 1 << 21;
/// A point farther from the surface than this many reaches lies behind it, or in front of it.
const NEARBY: f64 = 3.0;

/// A pointed-at place in the world. All numbers are finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pointing {
    /// The visible drawable there, at any level of detail.
    drawable: u32,
    eye: DVec3,
    /// The visible point of the drawable.
    at: DVec3,
    /// The snapping distance to a vertex or an edge as seen from the eye: metres at that point.
    reach: f64,
}

/// None of its numbers is NaN.
impl Eq for Pointing {}

/// The point snapped to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Snapped {
    to: Feature,
    /// Metres in the world.
    point: [f64; 3],
    /// The error of the point due to rounded coordinates, metres.
    error: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Feature {
    Vertex,
    Edge,
    Face,
}

impl Pointing {
    /// Parses a query: `drawable=7&eye=1,2,3&at=1,2,8&reach=0.1`. `None` if it is not valid.
    pub(super) fn parse<'v>(value: impl Fn(&str) -> Option<Cow<'v, str>>) -> Option<Self> {
        let point = |name| {
            let text = value(name)?;
            let numbers: Vec<f64> = text.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
            let point = DVec3::from_array(numbers.try_into().ok()?);
            point.is_finite().then_some(point)
        };
        let (eye, at) = (point("eye")?, point("at")?);
        let reach: f64 = value("reach")?.parse().ok()?;
        let is_sound = reach.is_finite() && reach > 0.0 && eye.distance(at).is_normal();
        let drawable = value("drawable")?.parse().ok()?;
        is_sound.then_some(Self { drawable, eye, at, reach })
    }

    /// Snaps: a vertex before an edge, and an edge before a face. `None` if the scene has no such drawable,
    /// nothing of it is near, or too much would have to be read.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub(super) fn snap(&self, scene: &Scene) -> Result<Option<Snapped>, ReadError> {
        let Some(near) = self.near(scene)? else { return Ok(None) };
        let direction = (self.at - self.eye).normalize();
        let met = near.triangles.iter().filter_map(|triangle| met(self.eye, direction, triangle));
        // The visible surface along the ray: sections may cut nearer ones away.
        let off = |point: &DVec3| point.distance(self.at);
        let surface = met.min_by(|a, b| off(a).total_cmp(&off(b)));
        // A coarse level may show a surface beyond the finest one's edge: then this snaps to the edge.
        let edge =
            || near.edges().map(|[a, b]| nearest(a, b, self.at)).min_by(|a, b| off(a).total_cmp(&off(b)));
        let Some(middle) = surface.or_else(edge) else { return Ok(None) };
        let to = if surface.is_some() { Feature::Face } else { Feature::Edge };
        let vertices = near.triangles.iter().flatten().copied();
        let edges = near.edges().map(|[a, b]| nearest(a, b, middle));
        let (to, point) = self
            .nearest_of(vertices, middle)
            .map(|vertex| (Feature::Vertex, vertex))
            .or_else(|| self.nearest_of(edges, middle).map(|edge| (Feature::Edge, edge)))
            .unwrap_or((to, middle));
        Ok(Some(Snapped { to, point: point.to_array(), error: near.rounding }))
    }

    /// The candidates.
    fn near(&self, scene: &Scene) -> Result<Option<Near>, ReadError> {
        scene.reading(|| self.find_near(scene))?
    }

    fn find_near(&self, scene: &Scene) -> Result<Option<Near>, ReadError> {
        let Some(shown) = scene.drawables().get(self.drawable as usize).copied() else { return Ok(None) };
        // The visible point is within its level's error of the finest geometry.
        let radius = f64::from(shown.error) + (1.0 + NEARBY) * self.reach;
        let (mut near, mut reader, mut read) = (Near::default(), scene.reader(), 0);
        let mut open = vec![shown.node];
        while let Some(node) = open.pop().and_then(|id| scene.nodes().get(id as usize)) {
            if node.distance_squared(self.at) > radius * radius {
                continue;
            }
            open.extend(node.children());
            let finest = scene.levels(node).next().filter(|_| node.is_leaf());
            for (piece, part) in finest.into_iter().flat_map(Level::pieces).filter_map(|id| scene.part(id)) {
                if part.distance_squared(self.at) > radius * radius {
                    continue;
                }
                read += u64::from(piece.triangles);
                if read > MOST {
                    return Ok(None);
                }
                near.add(node, &reader.read(piece.geometry)?, self.at, radius);
            }
        }
        Ok(Some(near))
    }

    /// The point that looks nearest to the pointer, among those within its reach and near `surface`.
    fn nearest_of(&self, points: impl Iterator<Item = DVec3>, surface: DVec3) -> Option<DVec3> {
        let direction = (self.at - self.eye).normalize();
        let looks_off = |point: DVec3| {
            let along = (point - self.eye).dot(direction);
            let beside = (point - self.eye - direction * along).length();
            beside * self.eye.distance(self.at) / along
        };
        points
            .filter(|point| point.distance(surface) <= NEARBY * self.reach)
            .map(|point| (point, looks_off(point)))
            .filter(|(_, off)| (0.0..self.reach).contains(off))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
            .map(|(point, _)| point)
    }
}

/// Triangles of the finest geometry near a point, in the world.
#[derive(Debug, Default)]
struct Near {
    triangles: Vec<[DVec3; 3]>,
    /// The error of their corners, metres.
    rounding: f64,
}

impl Near {
    /// Adds the triangles of a node whose boxes come within `radius` of `at`.
    fn add(&mut self, node: &Node, geometry: &trimaran_scene::Geometry, at: DVec3, radius: f64) {
        let (origin, linear) = (node.origin(), node.linear().as_dmat3());
        let corners: Vec<DVec3> = geometry
            .vertices
            .iter()
            .map(|vertex| origin + linear * DVec3::from_array(vertex.position.map(f64::from)))
            .collect();
        // A coordinate and the matrix are each off by half a unit in the last place of an f32.
        self.rounding = self.rounding.max(f64::from(node.own_reach()) * f64::from(f32::EPSILON));
        for triangle in geometry.indices.as_chunks::<3>().0 {
            let [Some(a), Some(b), Some(c)] = triangle.map(|index| corners.get(index as usize)) else {
                continue;
            };
            let (min, max) = (a.min(*b).min(*c), a.max(*b).max(*c));
            if at.clamp(min, max).distance(at) <= radius {
                self.triangles.push([*a, *b, *c]);
            }
        }
    }

    fn edges(&self) -> impl Iterator<Item = [DVec3; 2]> + '_ {
        self.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
    }
}

/// The intersection of a ray and a triangle, from either side (Möller and Trumbore 1997).
fn met(eye: DVec3, direction: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<DVec3> {
    let (ab, ac, from) = (b - a, c - a, eye - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    let u = from.dot(across) / determinant;
    let beside = from.cross(ab);
    let v = direction.dot(beside) / determinant;
    let along = ac.dot(beside) / determinant;
    // A ray in the triangle's plane gives NaN or infinity, and no intersection.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && along > 0.0 && along.is_finite())
        .then(|| eye + direction * along)
}

/// The point of a segment nearest to a point.
fn nearest(from: DVec3, to: DVec3, point: DVec3) -> DVec3 {
    let way = to - from;
    let square = way.length_squared();
    let share = if square > 0.0 { ((point - from).dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
    from + way * share
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat, Vec3};
    use proptest::prelude::*;
    use trimaran_cook::{CookOptions, Mesh, Model, Object, Source, cook};
    use trimaran_scene::Rgba8;

    use super::*;

    /// A ball of 1 m at `to_world`, with all its levels of detail, and its vertices.
    fn ball(to_world: DAffine3) -> (Scene, Vec<Vec3>) {
        const RINGS: u32 = 96;
        let mut positions = Vec::new();
        for ring in 0..=RINGS {
            for column in 0..RINGS {
                let angle = |part: u32, turn: f32| part as f32 / RINGS as f32 * turn;
                let (up, round) = (angle(ring, std::f32::consts::PI), angle(column, std::f32::consts::TAU));
                positions.push(Vec3::new(up.sin() * round.cos(), up.cos(), up.sin() * round.sin()));
            }
        }
        let mut indices = Vec::new();
        for ring in 0..RINGS {
            for column in 0..RINGS {
                let at = |ring, column| ring * RINGS + column % RINGS;
                let [a, b] = [at(ring, column), at(ring, column + 1)];
                let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
                indices.extend([a, b, c, b, d, c]);
            }
        }
        let colours = vec![Rgba8([200; 4]); positions.len()];
        let model = Model {
            meshes: vec![Mesh { positions: positions.clone(), colours, indices }],
            objects: vec![Object { mesh: 0, to_world, name: "ball".to_owned(), source: 0, source_index: 0 }],
            sources: vec![Source { name: "ball".to_owned() }],
            ..Model::default()
        };
        (cook(&model, &CookOptions::default(), &()).unwrap(), positions)
    }

    fn far_away() -> DAffine3 {
        let turned = DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(0.3);
        DAffine3::from_rotation_translation(turned, DVec3::new(432_100.123, -5.5, 6_789_012.345))
    }

    #[test]
    fn each_level_of_detail_gives_the_vertex_of_the_finest() {
        let place = far_away();
        let (scene, positions) = ball(place);
        let world = |vertex: &Vec3| place.transform_point3(vertex.as_dvec3());
        // Near the poles vertices are too dense to point at.
        for vertex in positions.iter().filter(|vertex| vertex.y.abs() < 0.7).step_by(611) {
            let exact = world(vertex);
            let normal = place.transform_vector3(vertex.as_dvec3());
            let aside = normal.any_orthonormal_vector() * 0.004;
            let (mut fine, mut coarse) = (0, 0);
            for (id, shown) in (0..).zip(scene.drawables().iter()) {
                let node = scene.nodes().get(shown.node as usize).unwrap();
                if node.distance_squared(exact) > 1e-12 {
                    continue;
                }
                // The level is off by nearly as much as it may be.
                let error = f64::from(shown.error);
                let at = exact + normal * 0.9 * error + aside;
                let pointing = Pointing { drawable: id, eye: exact + normal * 30.0, at, reach: 0.02 };
                let Some(Snapped { to: Feature::Vertex, point, error: rounding }) =
                    pointing.snap(&scene).unwrap()
                else {
                    continue;
                };
                let off = positions.iter().map(|vertex| world(vertex).distance(point.into()));
                assert!(off.fold(f64::INFINITY, f64::min) <= rounding && rounding < 1e-6);
                let is_exact = exact.distance(point.into()) <= rounding;
                coarse += u32::from(is_exact && error > 0.005);
                fine += u32::from(is_exact && error == 0.0);
            }
            assert!(fine > 0 && coarse > 0, "{vertex}: {fine} fine, {coarse} coarse");
        }
    }

    #[test]
    fn a_vertex_an_edge_and_a_face_are_met_to_the_micrometre() {
        // A square of two triangles, far from the origin of the world.
        let corner = DVec3::new(5e6, 1e3, -7e6);
        let positions = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let model = Model {
            meshes: vec![Mesh {
                positions: positions.to_vec(),
                colours: vec![Rgba8([200; 4]); 4],
                indices: vec![0, 1, 2, 0, 2, 3],
            }],
            objects: vec![Object {
                mesh: 0,
                to_world: DAffine3::from_translation(corner),
                name: String::new(),
                source: 0,
                source_index: 0,
            }],
            sources: vec![Source { name: String::new() }],
            ..Model::default()
        };
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let meant = |x: f64, y: f64| {
            let eye = corner + DVec3::new(1.0, 1.0, 20.0);
            let pointing = Pointing { drawable: 0, eye, at: corner + DVec3::new(x, y, 1e-4), reach: 0.1 };
            let Snapped { to, point, error } = pointing.snap(&scene).unwrap().unwrap();
            assert!(error < 1e-6, "{error}");
            (to, DVec3::from_array(point) - corner)
        };
        for (place, to, expected) in [
            ((1.95, 1.96), Feature::Vertex, (2.0, 2.0)),
            ((1.95, 0.6), Feature::Edge, (2.0, 0.6)),
            // Beside the square, where a coarser level may have shown.
            ((2.15, 0.6), Feature::Edge, (2.0, 0.6)),
            ((1.5, 0.5), Feature::Face, (1.5, 0.5)),
        ] {
            let (kind, point) = meant(place.0, place.1);
            assert_eq!(kind, to, "{place:?}");
            assert!(point.distance(DVec3::new(expected.0, expected.1, 0.0)) < 2e-5, "{place:?}: {point}");
        }
        let far = Pointing { drawable: 0, eye: corner, at: corner + DVec3::Z * 9.0, reach: 0.1 };
        assert_eq!(far.snap(&scene).unwrap(), None);
        assert_eq!(Pointing { drawable: 9, ..far }.snap(&scene).unwrap(), None);
    }

    fn parse(query: &str) -> Option<Pointing> {
        let find = |name: &str| {
            form_urlencoded::parse(query.as_bytes()).find(|(known, _)| known == name).map(|(_, value)| value)
        };
        Pointing::parse(find)
    }

    #[test]
    fn a_query_without_sense_points_nowhere() {
        let sound = "drawable=7&eye=1,2,3&at=1,2,8.5&reach=0.1";
        let (eye, at) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 8.5));
        assert_eq!(parse(sound), Some(Pointing { drawable: 7, eye, at, reach: 0.1 }));
        for (whole, broken) in [
            ("1,2,3", "1,2"),
            ("1,2,3", "1,2,3,4"),
            ("1,2,3", "NaN,2,3"),
            ("1,2,3", "inf,2,3"),
            ("1,2,8.5", "1,2,3"),
            ("=0.1", "=0"),
            ("=0.1", "=-1"),
            ("=0.1", "=inf"),
            ("=7", "=-7"),
            ("drawable", "object"),
        ] {
            assert_eq!(parse(&sound.replacen(whole, broken, 1)), None, "{broken}");
        }
    }

    proptest! {
        #[test]
        fn any_numbers_are_borne(
            eye in prop::array::uniform3(any::<f64>()),
            at in prop::array::uniform3(-2.0..2.0_f64),
            reach in any::<f64>(),
            drawable in 0..20_u32,
        ) {
            let text = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
            let query = format!("drawable={drawable}&eye={}&at={}&reach={reach}", text(eye), text(at));
            if let Some(pointing) = parse(&query) {
                let (scene, _) = SMALL.get_or_init(|| ball(DAffine3::IDENTITY));
                if let Some(Snapped { point, error, .. }) = pointing.snap(scene).unwrap() {
                    prop_assert!(point.iter().all(|number| number.is_finite()) && error.is_finite());
                }
            }
        }
    }

    static SMALL: std::sync::OnceLock<(Scene, Vec<Vec3>)> = std::sync::OnceLock::new();
}
