//! Measures the surface at a pointer, at full detail: the area of a flat face, or the diameter of a round
//! one.

use std::collections::{HashMap, HashSet};

use glam::{DMat2, DMat3, DVec2, DVec3};
use serde::Serialize;
use trimaran_scene::{Level, Node, ReadError, Scene};

use super::snap::Pointing;

/// The most triangles of an object that is measured.
const MOST: u64 = 1 << 18;
/// Faces that share an edge are of one flat face if their normals differ by less than this sine.
const FLAT: f64 = 1e-3;
/// They are of one round face if they differ by less than this cosine, of 46 degrees: a cylinder has at least
/// eight sides.
const ROUND: f64 = 0.69;
/// The sine of the angle between a normal of a cylinder and the plane across its axis: rounded coordinates.
const ACROSS: f64 = 0.01;
/// A surface is no cylinder if its corners are off by more than this share of the radius.
const OFF: f64 = 0.05;

/// The surface there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Surface {
    /// Square metres of the flat face.
    area: f64,
    cylinder: Option<Cylinder>,
}

/// The cylinder that fits the corners of a round face best. Metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Cylinder {
    diameter: f64,
    /// The largest distance of a corner from it.
    residual: f64,
    /// Of the face along the axis.
    length: f64,
}

/// A mesh whose triangles know their neighbours.
struct Mesh {
    triangles: Vec<[DVec3; 3]>,
    /// The triangles at each edge, by the numbers of its corners' places.
    edges: HashMap<[u32; 2], Vec<u32>>,
    /// The numbers of each triangle's corners.
    corners: Vec<[u32; 3]>,
}

impl Pointing {
    /// The surface at the pointer. `None` if there is none, or too much would have to be read.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub(super) fn surface(&self, scene: &Scene) -> Result<Option<Surface>, ReadError> {
        scene.reading(|| self.measure(scene))?
    }

    fn measure(&self, scene: &Scene) -> Result<Option<Surface>, ReadError> {
        let object = self.object(scene)?.and_then(|id| scene.objects().get(id as usize));
        let node = object.and_then(|object| scene.nodes().get(object.node as usize));
        let Some(object) = node else { return Ok(None) };
        // About the visible point, so that far coordinates cost no digits.
        let Some(triangles) = triangles_below(scene, object, self.at())? else { return Ok(None) };
        let Some((_, face)) = self.about(self.at()).face(&triangles) else { return Ok(None) };
        let mesh = Mesh::new(triangles);
        Ok(mesh.find(&face).map(|from| Surface { area: mesh.area(from), cylinder: mesh.cylinder(from) }))
    }
}

/// The finest triangles of an object, about a place. `None` if they are too many.
fn triangles_below(scene: &Scene, object: &Node, about: DVec3) -> Result<Option<Vec<[DVec3; 3]>>, ReadError> {
    let (mut open, mut found, mut reader) = (vec![*object], Vec::new(), scene.reader());
    while let Some(node) = open.pop() {
        open.extend(node.children().filter_map(|id| scene.nodes().get(id as usize).copied()));
        let finest = scene.levels(&node).next().filter(|_| node.is_leaf());
        for id in finest.into_iter().flat_map(Level::pieces) {
            let Some(drawable) = scene.drawables().get(id.index()) else { continue };
            if found.len() as u64 + u64::from(drawable.triangles) > MOST {
                return Ok(None);
            }
            let geometry = reader.read(drawable.geometry)?;
            let (origin, linear) = (node.origin() - about, node.linear().as_dmat3());
            let place = |index: u32| {
                let vertex = geometry.vertices.get(index as usize)?;
                Some(origin + linear * DVec3::from_array(vertex.position.map(f64::from)))
            };
            let corners = geometry.indices.as_chunks::<3>().0.iter();
            found.extend(corners.filter_map(|&[a, b, c]| Some([place(a)?, place(b)?, place(c)?])));
        }
    }
    Ok(Some(found))
}

impl Mesh {
    fn new(triangles: Vec<[DVec3; 3]>) -> Self {
        // Pieces and colours have corners of their own at one place: they differ by rounding at most.
        let size = triangles.iter().flatten().fold(0.0, |size: f64, at| size.max(at.abs().max_element()));
        let grid = (size * 4.0 * f64::from(f32::EPSILON)).max(f64::MIN_POSITIVE);
        let mut places: HashMap<[i64; 3], u32> = HashMap::new();
        let mut number = |at: DVec3| {
            let cell = (at / grid).round().to_array().map(|x| x as i64);
            let next = places.len() as u32;
            *places.entry(cell).or_insert(next)
        };
        let corners: Vec<[u32; 3]> = triangles.iter().map(|corners| corners.map(&mut number)).collect();
        let mut edges: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        for (triangle, &[a, b, c]) in (0..).zip(&corners) {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                edges.entry([from.min(to), from.max(to)]).or_default().push(triangle);
            }
        }
        Self { triangles, edges, corners }
    }

    fn find(&self, face: &[DVec3; 3]) -> Option<u32> {
        self.triangles.iter().position(|triangle| triangle == face).map(|at| at as u32)
    }

    /// The triangles that are joined to one by edges, as far as `is_joined` says of two neighbours.
    fn flood(&self, from: u32, is_joined: impl Fn(u32, u32) -> bool) -> Vec<u32> {
        let mut found = vec![from];
        let mut seen = HashSet::from([from]);
        let mut next = 0;
        while let Some(&triangle) = found.get(next) {
            next += 1;
            for other in self.neighbours(triangle) {
                if !seen.contains(&other) && is_joined(triangle, other) {
                    seen.insert(other);
                    found.push(other);
                }
            }
        }
        found
    }

    fn neighbours(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let [a, b, c] = self.corners.get(triangle as usize).copied().unwrap_or_default();
        let edges = [[a, b], [b, c], [c, a]].map(|[from, to]| [from.min(to), from.max(to)]);
        let others = edges.into_iter().filter_map(|edge| self.edges.get(&edge)).flatten().copied();
        others.filter(move |other| *other != triangle)
    }

    /// Twice the area, in the direction of the normal.
    fn across(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.triangles.get(triangle as usize).copied().unwrap_or_default();
        (b - a).cross(c - a)
    }

    fn normal(&self, triangle: u32) -> DVec3 {
        self.across(triangle).normalize_or_zero()
    }

    /// The area of the flat face around a triangle.
    fn area(&self, from: u32) -> f64 {
        let normal = self.normal(from);
        let is_flat = |_, other| normal.cross(self.normal(other)).length() < FLAT;
        self.flood(from, is_flat).into_iter().map(|triangle| self.across(triangle).length() / 2.0).sum()
    }

    /// The cylinder whose face a triangle is of. `None` if it is flat, or not round enough.
    fn cylinder(&self, from: u32) -> Option<Cylinder> {
        let bends = |a: u32, b: u32| {
            let (cos, sin) =
                (self.normal(a).dot(self.normal(b)), self.normal(a).cross(self.normal(b)).length());
            cos > ROUND && sin > FLAT
        };
        // The nearest face that bends away: the axis is across both normals.
        let flat = self.flood(from, |a, b| self.normal(a).cross(self.normal(b)).length() < FLAT);
        let bent = flat.iter().find_map(|&a| self.neighbours(a).find(|&b| bends(a, b)))?;
        let mut axis = self.normal(from).cross(self.normal(bent)).try_normalize()?;
        let mut round = Vec::new();
        for _ in 0..2 {
            let is_round = |a: u32, b: u32| {
                self.normal(b).dot(axis).abs() < ACROSS && self.normal(a).dot(self.normal(b)) > ROUND
            };
            round = self.flood(from, is_round);
            axis = self.axis(&round, axis)?;
        }
        let corners: Vec<DVec3> =
            round.iter().filter_map(|&at| self.triangles.get(at as usize)).flatten().copied().collect();
        fit(&corners, axis)
    }

    /// The axis to which normals are most nearly at right angles: each turns a guess a little (a step of the
    /// inverse iteration).
    fn axis(&self, triangles: &[u32], guess: DVec3) -> Option<DVec3> {
        let square = |n: DVec3| DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        let sum = triangles.iter().fold(DMat3::ZERO, |sum, &at| sum + square(self.normal(at)));
        // Not singular, though all normals may be exactly across the axis.
        let sum = sum + DMat3::from_diagonal(DVec3::splat(1e-12 * triangles.len() as f64));
        (sum.inverse() * guess).try_normalize()
    }
}

/// The cylinder about this axis whose radius the corners have: a circle across it by least squares (Kåsa
/// 1976).
fn fit(corners: &[DVec3], axis: DVec3) -> Option<Cylinder> {
    let (u, v) = axis.any_orthonormal_pair();
    let flat: Vec<DVec2> = corners.iter().map(|at| DVec2::new(at.dot(u), at.dot(v))).collect();
    let count = flat.len() as f64;
    let middle = flat.iter().sum::<DVec2>() / count;
    let (mut matrix, mut right) = (DMat2::ZERO, DVec2::ZERO);
    for at in flat.iter().map(|at| at - middle) {
        matrix += DMat2::from_cols(at * at.x, at * at.y);
        right += at * at.length_squared() / 2.0;
    }
    let centre = matrix.inverse() * right;
    let radius = (centre.length_squared()
        + flat.iter().map(|at| (at - middle).length_squared()).sum::<f64>() / count)
        .sqrt();
    let off = flat.iter().map(|at| ((at - middle).distance(centre) - radius).abs());
    let residual = off.fold(0.0, f64::max);
    let along = corners.iter().map(|at| at.dot(axis));
    let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at), high.max(at)));
    let is_sound = radius.is_finite() && residual <= OFF * radius;
    is_sound.then_some(Cylinder { diameter: 2.0 * radius, residual, length: high - low })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use glam::{DAffine3, DQuat};
    use trimaran_cook::{CookOptions, Mesh as CookMesh, Model, Object, Source, cook};
    use trimaran_scene::Rgba8;

    use super::*;

    const SIDES: u32 = 24;
    const RADIUS: f64 = 0.1095;
    const LENGTH: f64 = 6.0;

    /// A closed pipe along z, of sides that are split along it as often as `rings` says.
    fn pipe(rings: u32) -> CookMesh {
        let mut positions = Vec::new();
        for ring in 0..=rings {
            for side in 0..SIDES {
                let (sin, cos) = (f64::from(side) / f64::from(SIDES) * TAU).sin_cos();
                let z = LENGTH * f64::from(ring) / f64::from(rings);
                positions.push(DVec3::new(RADIUS * cos, RADIUS * sin, z).as_vec3());
            }
        }
        let mut indices = Vec::new();
        for ring in 0..rings {
            for side in 0..SIDES {
                let at = |ring: u32, side: u32| ring * SIDES + side % SIDES;
                let [a, b] = [at(ring, side), at(ring, side + 1)];
                let [c, d] = [at(ring + 1, side), at(ring + 1, side + 1)];
                indices.extend([a, b, d, a, d, c]);
            }
        }
        for cap in [0, rings] {
            let first = positions.len() as u32;
            positions.extend_from_within(cap as usize * SIDES as usize..(cap + 1) as usize * SIDES as usize);
            for side in 1..SIDES - 1 {
                let [b, c] = [first + side, first + side + 1];
                indices.extend(if cap == 0 { [first, c, b] } else { [first, b, c] });
            }
        }
        CookMesh { colours: vec![Rgba8([200; 4]); positions.len()], positions, indices }
    }

    fn cooked(mesh: CookMesh, to_world: DAffine3) -> Scene {
        let model = Model {
            meshes: vec![mesh],
            objects: vec![Object { mesh: 0, to_world, name: String::new(), source: 0, source_index: 0 }],
            sources: vec![Source { name: String::new() }],
            ..Model::default()
        };
        cook(&model, &CookOptions::default(), &()).unwrap()
    }

    /// The surface where a ray from outside along `towards` meets a place of an object, at each level.
    fn surfaces(scene: &Scene, to_world: DAffine3, at: DVec3, outwards: DVec3) -> Vec<Surface> {
        let (at, outwards) = (to_world.transform_point3(at), to_world.transform_vector3(outwards));
        let of = |drawable: u32| {
            let text = |point: DVec3| point.to_array().map(|x| x.to_string()).join(",");
            let eye = at + outwards * 3.0;
            let query = [
                ("drawable", drawable.to_string()),
                ("eye", text(eye)),
                ("at", text(at)),
                ("reach", "0.02".to_owned()),
            ];
            let value = |name: &str| {
                query.iter().find(|(known, _)| *known == name).map(|(_, value)| value.as_str().into())
            };
            Pointing::parse(value).unwrap().surface(scene).unwrap()
        };
        (0..scene.drawables().len() as u32).filter_map(of).collect()
    }

    #[test]
    fn a_pipe_has_the_diameter_of_its_corners_wherever_it_lies() {
        let turned = DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(0.3);
        for (rings, place) in [
            (1, DAffine3::IDENTITY),
            (60, DAffine3::from_rotation_translation(turned, DVec3::new(4.3e5, -5.5, 6.8e6))),
        ] {
            let scene = cooked(pipe(rings), place);
            // In the middle of a side.
            let (sin, cos) = (TAU * 2.5 / f64::from(SIDES)).sin_cos();
            let outwards = DVec3::new(cos, sin, 0.0);
            let at = outwards * RADIUS * (PI / f64::from(SIDES)).cos() + DVec3::Z * 2.03;
            let found = surfaces(&scene, place, at, outwards);
            assert!(!found.is_empty(), "{rings}");
            for surface in found {
                let Cylinder { diameter, residual, length } = surface.cylinder.unwrap();
                assert!((diameter - 2.0 * RADIUS).abs() < 2e-6 && residual < 2e-6, "{surface:?}");
                assert!((length - LENGTH).abs() < 1e-5, "{surface:?}");
                let side = 2.0 * RADIUS * (PI / f64::from(SIDES)).sin();
                assert!((surface.area - side * LENGTH).abs() < 1e-4, "one flat side: {surface:?}");
            }
        }
    }

    #[test]
    fn a_flat_face_has_an_area_and_no_diameter() {
        let scene = cooked(pipe(60), DAffine3::IDENTITY);
        let cap = DVec3::new(0.01, 0.02, LENGTH);
        let found = surfaces(&scene, DAffine3::IDENTITY, cap, DVec3::Z);
        assert!(!found.is_empty());
        for Surface { area, cylinder } in found {
            let polygon = f64::from(SIDES) / 2.0 * RADIUS * RADIUS * (TAU / f64::from(SIDES)).sin();
            assert!(cylinder.is_none() && (area - polygon).abs() < 1e-7, "{area} {cylinder:?}");
        }
        // A sphere is round, and no cylinder.
        let mut ball = pipe(12);
        for position in &mut ball.positions {
            let up = f64::from(position.z) / LENGTH * PI;
            let around = DVec2::new(position.x.into(), position.y.into()) / RADIUS;
            *position = DVec3::new(up.sin() * around.x, up.sin() * around.y, up.cos()).as_vec3();
        }
        let scene = cooked(ball, DAffine3::IDENTITY);
        let outwards = DVec3::new((TAU / 48.0).cos(), (TAU / 48.0).sin(), 0.13).normalize();
        let found = surfaces(&scene, DAffine3::IDENTITY, outwards * 0.985, outwards);
        assert!(!found.is_empty() && found.iter().all(|one| one.cylinder.is_none_or(|of| of.length < 0.6)));
    }

    #[test]
    fn corners_of_no_circle_fit_none() {
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        assert_eq!(fit(&[corner(0.0, 0.0), corner(1.0, 0.0), corner(2.0, 0.0)], DVec3::Z), None);
        assert_eq!(fit(&[], DVec3::Z), None);
        let square = [corner(0.0, 0.0), corner(2.0, 0.0), corner(2.0, 2.0), corner(0.0, 2.0)];
        let found = fit(&square, DVec3::Z).unwrap();
        assert!((found.diameter - 8_f64.sqrt()).abs() < 1e-12 && found.residual < 1e-12, "{found:?}");
        let lens = [corner(-4.0, 0.0), corner(4.0, 0.0), corner(0.0, 1.0), corner(0.0, -1.0)];
        assert_eq!(fit(&lens, DVec3::Z), None);
    }
}
