//! Builds scenes by hand: a tree with boxes and levels from objects.

use glam::{DVec3, Mat3, Vec3};
use trimaran_scene::{Geometry, Node, ObjectRecord, Rgba8, Scene, SceneArrays, SceneError, Vertex};

/// Triangles in a local frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Corners, metres.
    pub positions: Vec<Vec3>,
    /// Three indices per triangle.
    pub indices: Vec<u32>,
}

/// One object: a leaf of the tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// The finest level.
    pub mesh: Mesh,
    /// Coarser levels, finer first, each with a bound of its distance to the finest in the local frame,
    /// metres.
    pub coarser: Vec<(f32, Mesh)>,
    /// Where the local frame's origin is, metres.
    pub origin: DVec3,
    /// The local frame's axes in the world.
    pub linear: Mat3,
    /// The most triangles of a piece of a level; 0 counts as 1.
    pub most: usize,
}

impl Mesh {
    /// A box with `cuts` x `cuts` squares on each face; flat or thinner ones are fine.
    #[must_use]
    pub fn cuboid(min: Vec3, max: Vec3, cuts: u32) -> Self {
        let (middle, half) = ((min + max) * 0.5, (max - min) * 0.5);
        let mut mesh = Self::default();
        for axis in 0..3 {
            let [along, a, b] = [0, 1, 2].map(|turn| Vec3::AXES[(axis + turn) % 3]);
            for side in [along, -along] {
                mesh.grid(middle + half * side, half * a, half * b, cuts);
            }
        }
        mesh
    }

    /// A rectangle about `middle` with half-edges `a` and `b`, of `cuts` x `cuts` squares.
    #[must_use]
    pub fn rectangle(middle: Vec3, a: Vec3, b: Vec3, cuts: u32) -> Self {
        let mut mesh = Self::default();
        mesh.grid(middle, a, b, cuts);
        mesh
    }

    /// A closed cylinder along x about the origin.
    #[must_use]
    pub fn cylinder(radius: f32, half_length: f32, sides: u16) -> Self {
        let mut mesh = Self::default();
        for end in [-half_length, half_length] {
            mesh.positions.push(Vec3::new(end, 0.0, 0.0));
            mesh.positions.extend((0..sides).map(|side| {
                let (sin, cos) = (std::f32::consts::TAU * f32::from(side) / f32::from(sides)).sin_cos();
                Vec3::new(end, radius * cos, radius * sin)
            }));
        }
        let sides = u32::from(sides);
        for side in 0..sides {
            let (a, b) = (1 + side, 1 + (side + 1) % sides);
            let (c, d) = (a + sides + 1, b + sides + 1);
            mesh.indices.extend([0, b, a, sides + 1, c, d, a, b, d, a, d, c]);
        }
        mesh
    }

    /// Adds another mesh.
    pub fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.indices.extend(other.indices.iter().map(|corner| first + corner));
    }

    fn grid(&mut self, middle: Vec3, a: Vec3, b: Vec3, cuts: u32) {
        let first = self.positions.len() as u32;
        let at = |step: u32| 2.0 * step as f32 / cuts as f32 - 1.0;
        for row in 0..=cuts {
            self.positions.extend((0..=cuts).map(|column| middle + a * at(column) + b * at(row)));
        }
        for (row, column) in (0..cuts).flat_map(|row| (0..cuts).map(move |column| (row, column))) {
            let corner = first + row * (cuts + 1) + column;
            let above = corner + cuts + 1;
            self.indices.extend([corner, corner + 1, above + 1, corner, above + 1, above]);
        }
    }

    /// Lower and upper corner; a point at the origin for an empty mesh.
    fn bounds(&self) -> (Vec3, Vec3) {
        let low = self.positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
        (low, self.positions.iter().copied().reduce(Vec3::max).unwrap_or_default())
    }
}

impl Object {
    /// A mesh at the origin, without coarser levels.
    #[must_use]
    pub const fn new(mesh: Mesh) -> Self {
        Self { mesh, coarser: Vec::new(), origin: DVec3::ZERO, linear: Mat3::IDENTITY, most: usize::MAX }
    }

    /// The same object elsewhere.
    #[must_use]
    pub fn at(self, origin: DVec3) -> Self {
        Self { origin, ..self }
    }

    /// The same object turned, scaled, mirrored or sheared.
    #[must_use]
    pub fn turned(self, linear: Mat3) -> Self {
        Self { linear, ..self }
    }

    /// The same object with its bounding box as its coarsest level. The error is at most the box's diagonal,
    /// in both directions.
    #[must_use]
    pub fn with_box_level(mut self) -> Self {
        let (min, max) = self.mesh.bounds();
        self.coarser.push(((max - min).length(), Mesh::cuboid(min, max, 1)));
        self
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let all = || self.coarser.iter().map(|(_, mesh)| mesh).chain([&self.mesh]).map(Mesh::bounds);
        (
            all().map(|(min, _)| min).reduce(Vec3::min).unwrap_or_default(),
            all().map(|(_, max)| max).reduce(Vec3::max).unwrap_or_default(),
        )
    }
}

/// A node before it has a number.
struct Draft<'o> {
    min: DVec3,
    max: DVec3,
    /// The greatest error at or below the node.
    error: f32,
    object: Option<(usize, &'o Object)>,
    children: Vec<Self>,
}

/// A scene of `objects` under a tree that halves them by position, four children per node. With `merged` each
/// interior node has one level, its own box, whose error is the box's diagonal.
///
/// # Errors
/// If the scene's own rules do not hold: with no objects, say.
pub fn build(objects: &[Object], merged: bool) -> Result<Scene, SceneError> {
    let mut arrays = SceneArrays { sources: vec!["cases".into()], ..SceneArrays::default() };
    let leaves: Vec<Draft<'_>> =
        objects.iter().enumerate().map(|(index, object)| leaf(index, object)).collect();
    arrays.objects = (0..objects.len() as u32)
        .map(|index| ObjectRecord {
            source: 0,
            source_index: index,
            name_start: 0,
            name_length: 0,
            node: Node::NONE,
        })
        .collect();
    if let Some(root) = group(leaves) {
        let mut level = vec![(root, Node::NONE)];
        let mut numbered = 0;
        while !level.is_empty() {
            let mut next = Vec::new();
            let first_below = numbered + level.len() as u32;
            for (draft, parent) in level {
                let (record, children) =
                    place(&mut arrays, draft, parent, first_below + next.len() as u32, merged);
                arrays.nodes.push(record);
                next.extend(children.into_iter().map(|child| (child, numbered)));
                numbered += 1;
            }
            level = next;
        }
    }
    Scene::from_arrays(arrays)
}

fn leaf(index: usize, object: &Object) -> Draft<'_> {
    let (min, max) = object.bounds();
    let linear = object.linear.as_dmat3();
    let (middle, half) = ((min.as_dvec3() + max.as_dvec3()) * 0.5, (max.as_dvec3() - min.as_dvec3()) * 0.5);
    let centre = object.origin + linear * middle;
    let reach = linear.x_axis.abs() * half.x + linear.y_axis.abs() * half.y + linear.z_axis.abs() * half.z;
    // A few ulp more than the rounding of the f64 sums above.
    let reach = reach + (centre.abs() + reach) * 1e-15;
    let stretch = stretch(object.linear);
    let error = object.coarser.iter().map(|(error, _)| error * stretch).fold(0.0, f32::max);
    Draft {
        min: centre - reach,
        max: centre + reach,
        error,
        object: Some((index, object)),
        children: Vec::new(),
    }
}

/// Groups by halving twice along the longest axis of the centres' box.
fn group(mut drafts: Vec<Draft<'_>>) -> Option<Draft<'_>> {
    if drafts.len() <= 1 {
        return drafts.pop();
    }
    let (left, right) = halve(drafts);
    let quarters = [left, right].into_iter().flat_map(|half| {
        if half.len() <= 1 {
            vec![half]
        } else {
            let (a, b) = halve(half);
            vec![a, b]
        }
    });
    let children: Vec<Draft<'_>> = quarters.filter_map(group).collect();
    let min = children.iter().map(|child| child.min).reduce(DVec3::min)?;
    let max = children.iter().map(|child| child.max).reduce(DVec3::max)?;
    let error =
        children.iter().map(|child| child.error).fold(0.0, f32::max).max(f32_above((max - min).length()));
    Some(Draft { min, max, error, object: None, children })
}

fn halve(mut drafts: Vec<Draft<'_>>) -> (Vec<Draft<'_>>, Vec<Draft<'_>>) {
    let centre = |draft: &Draft<'_>| (draft.min + draft.max) * 0.5;
    let low = drafts.iter().map(centre).reduce(DVec3::min).unwrap_or_default();
    let high = drafts.iter().map(centre).reduce(DVec3::max).unwrap_or_default();
    let axis = (high - low).max_position();
    drafts.sort_by(|a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
    let right = drafts.split_off(drafts.len() / 2);
    (drafts, right)
}

/// Writes a node's levels and gives its record.
fn place<'o>(
    arrays: &mut SceneArrays,
    draft: Draft<'o>,
    parent: u32,
    first_child: u32,
    merged: bool,
) -> (Node, Vec<Draft<'o>>) {
    let first_drawable = arrays.drawables.len() as u32;
    let node = arrays.nodes.len() as u32;
    let (origin, linear, (local_min, local_max)) = match draft.object {
        Some((_, object)) => {
            let stretch = stretch(object.linear);
            add_level(arrays, node, 0.0, &object.mesh, object.most);
            for (error, mesh) in &object.coarser {
                add_level(arrays, node, error * stretch, mesh, object.most);
            }
            (object.origin, object.linear, object.bounds())
        }
        None => {
            let origin = (draft.min + draft.max) * 0.5;
            let half = (draft.max - origin).max(origin - draft.min).as_vec3();
            let half = Vec3::from_array(half.to_array().map(f32::next_up));
            if merged {
                add_level(arrays, node, draft.error, &Mesh::cuboid(-half, half, 1), usize::MAX);
            }
            (origin, Mat3::IDENTITY, (-half, half))
        }
    };
    let object = draft.object.map_or(Node::NONE, |(index, _)| index as u32);
    let record = Node {
        world_min: draft.min.to_array(),
        world_max: draft.max.to_array(),
        origin: origin.to_array(),
        linear: linear.to_cols_array(),
        local_min: local_min.to_array(),
        local_max: local_max.to_array(),
        parent,
        first_child: if draft.children.is_empty() { 0 } else { first_child },
        child_count: draft.children.len() as u32,
        first_drawable,
        drawable_count: arrays.drawables.len() as u32 - first_drawable,
        object,
        ..Node::default()
    };
    (record, draft.children)
}

/// Adds a level in pieces of at most `most` triangles, or in one without any.
fn add_level(arrays: &mut SceneArrays, node: u32, error: f32, mesh: &Mesh, most: usize) {
    let first = arrays.drawables.len();
    if mesh.indices.is_empty() {
        add_piece(arrays, node, error, mesh, &[]);
    }
    for triangles in mesh.indices.chunks(most.max(1).saturating_mul(3)) {
        add_piece(arrays, node, error, mesh, triangles);
    }
    let level = arrays.drawables.get_mut(first..).unwrap_or_default();
    let pieces = level.len() as u16;
    for (piece, drawable) in (0..).zip(level) {
        (drawable.piece, drawable.pieces) = (piece, pieces);
    }
}

/// Adds some triangles of a mesh, with the corners that they use.
fn add_piece(arrays: &mut SceneArrays, node: u32, error: f32, mesh: &Mesh, triangles: &[u32]) {
    let colour = Rgba8([(node * 37) as u8, (node * 91) as u8, 200, 255]);
    let mut used = triangles.to_vec();
    used.sort_unstable();
    used.dedup();
    let corners = used.iter().filter_map(|&corner| mesh.positions.get(corner as usize));
    let vertices = corners.map(|p| Vertex::new(p.to_array(), colour)).collect();
    let indices = triangles.iter().map(|corner| used.partition_point(|other| other < corner) as u32);
    let indices = indices.collect();
    arrays.add_level(node, error, Geometry { vertices, indices });
}

/// At least the largest singular value: the geometric mean of the greatest column sum and the greatest row
/// sum.
fn stretch(linear: Mat3) -> f32 {
    let sum = |v: Vec3| v.abs().as_dvec3().element_sum();
    let greatest = |m: Mat3| sum(m.x_axis).max(sum(m.y_axis)).max(sum(m.z_axis));
    f32_above((greatest(linear) * greatest(linear.transpose())).sqrt())
}

fn f32_above(value: f64) -> f32 {
    (value as f32).next_up()
}
