//! Snaps a pointer to a vertex, an edge or a face of the finest geometry, independent of the level of detail
//! shown.

use std::{borrow::Cow, collections::BTreeMap};

use glam::DVec3;
use serde::Serialize;
use trimaran_scene::{Geometry, Level, Node, ReadError, Scene};

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
    /// The face at the pointer, unless only an edge is near.
    face: Option<Face>,
}

/// A point of a flat face.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Face {
    /// Metres in the world.
    point: [f64; 3],
    /// A unit vector.
    normal: [f64; 3],
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
        let off = |point: &DVec3| point.distance(self.at);
        let face = self.face(&near.triangles);
        let surface = face.map(|(point, _)| point);
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
        let face = face.and_then(|(point, [a, b, c])| {
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some(Face { point: point.to_array(), normal: normal.to_array() })
        });
        Ok(Some(Snapped { to, point: point.to_array(), error: near.rounding, face }))
    }

    /// The triangle that the ray of the pointer meets nearest to the visible point, and where: sections may
    /// have cut nearer ones to the eye away.
    pub(super) fn face(&self, triangles: &[[DVec3; 3]]) -> Option<(DVec3, [DVec3; 3])> {
        let direction = (self.at - self.eye).normalize();
        let met =
            triangles.iter().filter_map(|triangle| Some((met(self.eye, direction, triangle)?, *triangle)));
        met.min_by(|(a, _), (b, _)| a.distance(self.at).total_cmp(&b.distance(self.at)))
    }

    /// The same place from another origin.
    pub(super) fn about(&self, origin: DVec3) -> Self {
        Self { eye: self.eye - origin, at: self.at - origin, ..*self }
    }

    /// How far from the visible point a surface of full detail may be, if the level there is off by `error`.
    fn radius(&self, error: f32) -> f64 {
        f64::from(error) + (1.0 + NEARBY) * self.reach
    }

    /// The visible point.
    pub(super) const fn at(&self) -> DVec3 {
        self.at
    }

    /// The candidates.
    fn near(&self, scene: &Scene) -> Result<Option<Near>, ReadError> {
        let mut near = Near::default();
        let has_read =
            self.visit(scene, |node, geometry, radius| near.add(node, geometry, self.at, radius))?;
        Ok(has_read.then_some(near))
    }

    /// The object there: the one whose surface of full detail the ray of the pointer meets nearest to the
    /// visible point, or else comes nearest to it. `None` as for [`Self::snap`].
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub(super) fn object(&self, scene: &Scene) -> Result<Option<u32>, ReadError> {
        let mut objects: BTreeMap<u32, Near> = BTreeMap::new();
        let has_read = self.visit(scene, |node, geometry, radius| {
            objects.entry(node.object).or_default().add(node, geometry, self.at, radius);
        })?;
        if !has_read {
            return Ok(None);
        }
        let off = |point: DVec3| point.distance(self.at);
        let found = objects.iter().filter_map(|(object, near)| {
            let met = self.face(&near.triangles).map(|(point, _)| off(point));
            let beside = near.edges().map(|[a, b]| off(nearest(a, b, self.at))).min_by(f64::total_cmp);
            // One that is met comes before all others.
            Some((*object, met.is_none(), met.or(beside)?))
        });
        let first = found.min_by(|(_, a, near), (_, b, far)| a.cmp(b).then(near.total_cmp(far)));
        Ok(first.map(|(object, ..)| object))
    }

    /// Passes on all geometry of full detail near the visible point, with its node and the radius that counts
    /// as near. Returns whether the scene has the drawable and not too much was to be read.
    fn visit(&self, scene: &Scene, mut found: impl FnMut(&Node, &Geometry, f64)) -> Result<bool, ReadError> {
        scene.reading(|| {
            let Some(shown) = scene.drawables().get(self.drawable as usize).copied() else {
                return Ok(false);
            };
            // The visible point is within its level's error of the finest geometry.
            let radius = self.radius(shown.error);
            let (mut reader, mut read) = (scene.reader(), 0);
            let mut open = vec![shown.node];
            while let Some(node) = open.pop().and_then(|id| scene.nodes().get(id as usize)) {
                if node.distance_squared(self.at) > radius * radius {
                    continue;
                }
                open.extend(node.children());
                let finest = scene.levels(node).next().filter(|_| node.is_leaf());
                let pieces = finest.into_iter().flat_map(Level::pieces);
                for (piece, part) in pieces.filter_map(|id| scene.part(id)) {
                    if part.distance_squared(self.at) > radius * radius {
                        continue;
                    }
                    read += u64::from(piece.triangles);
                    if read > MOST {
                        return Ok(false);
                    }
                    found(node, &reader.read(piece.geometry)?, radius);
                }
            }
            Ok(true)
        })?
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
    fn add(&mut self, node: &Node, geometry: &Geometry, at: DVec3, radius: f64) {
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

    /// A ball of 1 m radius.
    fn ball_mesh(rings: u32) -> Mesh {
        let mut positions = Vec::new();
        for ring in 0..=rings {
            for column in 0..rings {
                let angle = |part: u32, turn: f32| part as f32 / rings as f32 * turn;
                let (up, round) = (angle(ring, std::f32::consts::PI), angle(column, std::f32::consts::TAU));
                positions.push(Vec3::new(up.sin() * round.cos(), up.cos(), up.sin() * round.sin()));
            }
        }
        let mut indices = Vec::new();
        for ring in 0..rings {
            for column in 0..rings {
                let at = |ring, column| ring * rings + column % rings;
                let [a, b] = [at(ring, column), at(ring, column + 1)];
                let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
                indices.extend([a, b, c, b, d, c]);
            }
        }
        Mesh { colours: vec![Rgba8([200; 4]); positions.len()], positions, indices }
    }

    /// A scene of a mesh at these places, with all its levels of detail.
    fn cooked(mesh: Mesh, places: impl IntoIterator<Item = DAffine3>) -> Scene {
        let object = |(to_world, source_index)| Object {
            mesh: 0,
            to_world,
            name: String::new(),
            source: 0,
            source_index,
        };
        let model = Model {
            meshes: vec![mesh],
            objects: places.into_iter().zip(0..).map(object).collect(),
            sources: vec![Source { name: "balls".to_owned() }],
            ..Model::default()
        };
        cook(&model, &CookOptions::default(), &()).unwrap()
    }

    /// A ball at `to_world`, and its vertices.
    fn ball(to_world: DAffine3) -> (Scene, Vec<Vec3>) {
        let mesh = ball_mesh(96);
        let positions = mesh.positions.clone();
        (cooked(mesh, [to_world]), positions)
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
                let Some(Snapped { to: Feature::Vertex, point, error: rounding, .. }) =
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
            let Snapped { to, point, error, face } = pointing.snap(&scene).unwrap().unwrap();
            assert!(error < 1e-6, "{error}");
            // Beside the square there is no face.
            assert_eq!(face.map(|face| face.normal[2].abs()), (x < 2.0).then_some(1.0));
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
    fn one_of_several_objects_drawn_as_one_is_told() {
        // Balls that nearly touch.
        let place = |at: u32| DVec3::new(2.1 * f64::from(at % 20), 0.0, 2.1 * f64::from(at / 20));
        let scene = cooked(ball_mesh(24), (0..400).map(|at| DAffine3::from_translation(place(at))));
        let is_merged = |node: &&Node| node.object == Node::NONE && node.drawable_count > 0;
        let merged: Vec<&Node> = scene.nodes().iter().filter(is_merged).collect();
        let mut told = 0;
        for node in &merged {
            for (id, object) in (0..).zip(scene.objects()).step_by(23) {
                let (min, max) = scene.nodes()[object.node as usize].world_box();
                let middle = (min + max) / 2.0;
                if node.distance_squared(middle) > 0.0 {
                    continue;
                }
                let (eye, top) = (middle + DVec3::Y * 9.0, middle + DVec3::Y);
                // The visible point is one of the coarse level, a little off.
                for off in [0.0, 0.02, -0.02] {
                    let drawable = node.first_drawable;
                    let at = top + DVec3::Y * off;
                    let pointing = Pointing { drawable, eye, at, reach: 0.05 };
                    assert_eq!(pointing.object(&scene).unwrap(), Some(id), "{at}");
                    told += 1;
                }
                // Beside all balls the nearest one counts.
                let pointing = Pointing { drawable: node.first_drawable, eye, at: middle, reach: 1.0 };
                let aside = Pointing { eye: eye + DVec3::X, at: middle + DVec3::X * 1.01, ..pointing };
                assert_eq!(aside.object(&scene).unwrap(), Some(id), "{middle}");
            }
        }
        assert!(told >= 54, "{} levels of several objects: {told}", merged.len());
        let nowhere = Pointing { drawable: 0, eye: DVec3::Y * 99.0, at: DVec3::Y * 50.0, reach: 0.01 };
        assert_eq!(nowhere.object(&scene).unwrap(), None, "nothing is near");
        assert_eq!(Pointing { drawable: u32::MAX, ..nowhere }.object(&scene).unwrap(), None);
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
