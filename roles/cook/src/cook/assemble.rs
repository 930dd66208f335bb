//! Lays out the arrays of the scene.

use glam::{DVec3, Vec3};

use super::CookError;
use super::gather::{Merged, MergedLevel};
use super::levels::{Level, LeveledMesh};
use super::linear::WorldBox;
use super::placed::Leaf;
use super::solid::mark_solids;
use super::tree::TreeNode;
use crate::Model;
use trimaran_scene::{Drawable, Node, ObjectRecord, SceneArrays, SceneError, Shading, Sides};

/// Where a mesh or merged level went.
#[derive(Debug, Clone, Copy)]
struct Range {
    first_index: u32,
    index_count: u32,
    vertex_offset: u32,
    vertex_count: u32,
}

/// Where the levels of a mesh went.
#[derive(Debug, Default)]
struct MeshRanges {
    levels: Vec<Range>,
    part_levels: Vec<Range>,
}

/// What a node of the scene stands for.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// A node of the tree over objects: an object if it is a leaf there.
    Tree(u32),
    /// A node of the cluster tree of this leaf's mesh, below its root.
    Cluster { leaf: u32, node: u32 },
}

/// Puts the tree, its levels and the objects' names into arrays.
pub(super) fn assemble(
    model: &Model,
    meshes: &[Option<LeveledMesh>],
    leaves: &[Leaf],
    tree: &[TreeNode],
    merged: Vec<Option<Merged>>,
) -> Result<SceneArrays, CookError> {
    let mut arrays = SceneArrays::default();
    record_objects(model, &mut arrays)?;
    let ranges = add_meshes(meshes, &mut arrays)?;
    let parts = Parts { tree, leaves, meshes, ranges };
    let mut merged = merged;
    // Breadth first: a node's children are appended when it is reached.
    let mut queue = vec![(Node::NONE, Place::Tree(0))];
    let mut index = 0;
    while let Some(&(parent, place)) = queue.get(index) {
        let own = number("nodes", index)?;
        let first_child = number("nodes", queue.len())?;
        queue.extend(parts.children(place).map(|child| (own, child)));
        let mut record = Node {
            parent,
            first_child,
            child_count: number("nodes", queue.len())? - first_child,
            first_drawable: number("drawables", arrays.drawables.len())?,
            ..Node::default()
        };
        match place {
            Place::Tree(node) => {
                let merged = merged.get_mut(node as usize).and_then(Option::take);
                parts.place_tree_node(node, merged, own, &mut record, &mut arrays)?;
            }
            Place::Cluster { leaf, node } => parts.place_cluster(leaf, node, own, &mut record, &mut arrays),
        }
        record.drawable_count = number("drawables", arrays.drawables.len())? - record.first_drawable;
        arrays.nodes.push(record);
        index += 1;
    }
    raise_errors(&mut arrays);
    mark_solids(&mut arrays);
    Ok(arrays)
}

/// What the nodes are made of.
struct Parts<'a> {
    tree: &'a [TreeNode],
    leaves: &'a [Leaf],
    meshes: &'a [Option<LeveledMesh>],
    /// Where each mesh's levels went.
    ranges: Vec<MeshRanges>,
}

impl<'a> Parts<'a> {
    fn leaf(&self, leaf: u32) -> Option<(&'a Leaf, &'a LeveledMesh)> {
        let leaf = self.leaves.get(leaf as usize)?;
        Some((leaf, self.meshes.get(leaf.mesh as usize)?.as_ref()?))
    }

    fn children(&self, place: Place) -> impl Iterator<Item = Place> + use<> {
        let tree_node = |node: u32| self.tree.get(node as usize);
        let (below, leaf) = match place {
            Place::Tree(node) => match tree_node(node).and_then(|node| node.item) {
                Some(leaf) => (self.clusters_below(leaf, 0), Some(leaf)),
                None => (tree_node(node).map_or(0..0, |node| node.children.clone()), None),
            },
            Place::Cluster { leaf, node } => (self.clusters_below(leaf, node), Some(leaf)),
        };
        below.map(move |node| match leaf {
            Some(leaf) => Place::Cluster { leaf, node },
            None => Place::Tree(node),
        })
    }

    fn clusters_below(&self, leaf: u32, node: u32) -> std::ops::Range<u32> {
        let cluster = self.leaf(leaf).and_then(|(_, mesh)| mesh.clusters.get(node as usize));
        cluster.map_or(0..0, |cluster| cluster.children.clone())
    }

    /// An object, or what is merged of several.
    fn place_tree_node(
        &self,
        node: u32,
        merged: Option<Merged>,
        index: u32,
        record: &mut Node,
        arrays: &mut SceneArrays,
    ) -> Result<(), CookError> {
        let item = self.tree.get(node as usize).and_then(|node| node.item);
        if let Some((leaf, mesh)) = item.and_then(|item| self.leaf(item)) {
            place_leaf(record, leaf, mesh);
            let ranges = self.ranges.get(leaf.mesh as usize).map_or(&[][..], |ranges| &ranges.levels);
            // Where there are clusters, the finest level is theirs.
            let clustered = usize::from(!mesh.clusters.is_empty());
            for (level, range) in mesh.levels.iter().zip(ranges).skip(clustered) {
                arrays.drawables.push(drawable(index, leaf.world_error(level.error), *range));
            }
        } else if let Some(merged) = merged {
            place_inner(record, merged.origin, merged.bounds);
            for level in merged.levels {
                let error = level.error;
                let range = add_merged(level, arrays)?;
                arrays.drawables.push(drawable(index, error, range));
            }
        }
        Ok(())
    }

    /// A part of an object, in the object's frame: of its finest level, and of a large mesh's coarser ones.
    fn place_cluster(&self, leaf: u32, node: u32, index: u32, record: &mut Node, arrays: &mut SceneArrays) {
        let Some((leaf, mesh)) = self.leaf(leaf) else { return };
        let Some(cluster) = mesh.clusters.get(node as usize) else { return };
        place_leaf(record, leaf, mesh);
        record.local_min = cluster.min.to_array();
        record.local_max = cluster.max.to_array();
        // Both boxes hold the cluster, so what they share does, and it lies within the parent's.
        let (parent_min, parent_max) = arrays.nodes.get(record.parent as usize).map_or_else(
            || (leaf.world.min, leaf.world.max),
            |parent| (DVec3::from_array(parent.world_min), DVec3::from_array(parent.world_max)),
        );
        let world = leaf.world_box(cluster.min, cluster.max);
        record.world_min = world.min.max(parent_min).to_array();
        record.world_max = world.max.min(parent_max).to_array();
        let Some(ranges) = self.ranges.get(leaf.mesh as usize) else { return };
        if let Some(&finest) = ranges.levels.first().filter(|_| cluster.children.is_empty()) {
            let range = Range {
                first_index: finest.first_index + cluster.indices.start,
                index_count: cluster.indices.len() as u32,
                ..finest
            };
            arrays.drawables.push(drawable(index, 0.0, range));
        }
        let levels = mesh.part_levels.iter().zip(&ranges.part_levels);
        for (level, range) in levels.skip(cluster.levels.start as usize).take(cluster.levels.len()) {
            arrays.drawables.push(drawable(index, leaf.world_error(level.error), *range));
        }
    }
}

fn place_leaf(record: &mut Node, leaf: &Leaf, mesh: &LeveledMesh) {
    record.world_min = leaf.world.min.to_array();
    record.world_max = leaf.world.max.to_array();
    record.origin = leaf.origin.to_array();
    record.linear = leaf.linear.to_cols_array();
    record.local_min = mesh.min.to_array();
    record.local_max = mesh.max.to_array();
    record.object = leaf.object;
}

fn place_inner(record: &mut Node, origin: DVec3, bounds: WorldBox) {
    record.world_min = bounds.min.to_array();
    record.world_max = bounds.max.to_array();
    record.origin = origin.to_array();
    // One step outwards covers the rounding of the difference and of the conversion.
    let low = (bounds.min - origin).as_vec3();
    let high = (bounds.max - origin).as_vec3();
    record.local_min = Vec3::new(low.x.next_down(), low.y.next_down(), low.z.next_down()).to_array();
    record.local_max = Vec3::new(high.x.next_up(), high.y.next_up(), high.z.next_up()).to_array();
}

fn drawable(node: u32, error: f32, range: Range) -> Drawable {
    let Range { first_index, index_count, vertex_offset, vertex_count } = range;
    let sides = Sides::BOTH; // until all triangles are there
    Drawable { error, node, first_index, index_count, vertex_offset, vertex_count, sides }
}

fn record_objects(model: &Model, arrays: &mut SceneArrays) -> Result<(), CookError> {
    arrays.sources = model.sources.iter().map(|source| source.name.clone()).collect();
    for object in &model.objects {
        arrays.objects.push(ObjectRecord {
            source: object.source,
            source_index: object.source_index,
            name_start: number("bytes of names", arrays.names.len())?,
            name_length: number("bytes of names", object.name.len())?,
        });
        arrays.names.push_str(&object.name);
    }
    Ok(())
}

/// Adds all levels of all meshes; returns where each went.
fn add_meshes(
    meshes: &[Option<LeveledMesh>],
    arrays: &mut SceneArrays,
) -> Result<Vec<MeshRanges>, CookError> {
    let present = || meshes.iter().flatten();
    arrays.vertices.reserve(present().map(|mesh| mesh.vertices.len()).sum());
    let levels = present().flat_map(|mesh| mesh.levels.iter().chain(&mesh.part_levels));
    arrays.indices.reserve(levels.map(|level| level.indices.len()).sum());
    let add = |mesh: &Option<LeveledMesh>| {
        let Some(mesh) = mesh else { return Ok(MeshRanges::default()) };
        let vertex_offset = number("vertices", arrays.vertices.len())?;
        let mut shading = Shading::new(mesh.vertices.clone());
        let mut add_level =
            |level: &Level| add_triangles(&level.indices, vertex_offset, &mut shading, arrays);
        let levels = mesh.levels.iter().map(&mut add_level).collect::<Result<_, _>>()?;
        let part_levels = add_parts(&mesh.part_levels, vertex_offset, &mut shading, arrays)?;
        arrays.vertices.extend(shading.into_vertices());
        Ok(MeshRanges { levels, part_levels })
    };
    meshes.iter().map(add).collect()
}

/// Adds the levels of a mesh's parts. All at once: each turn of triangles looks at all of the mesh's
/// vertices.
fn add_parts(
    levels: &[Level],
    vertex_offset: u32,
    shading: &mut Shading,
    arrays: &mut SceneArrays,
) -> Result<Vec<Range>, CookError> {
    let triangles: Vec<u32> = levels.iter().flat_map(|level| &level.indices).copied().collect();
    let all = add_triangles(&triangles, vertex_offset, shading, arrays)?;
    let place = |first_index: &mut u32, level: &Level| {
        let range = Range { first_index: *first_index, index_count: level.indices.len() as u32, ..all };
        *first_index += range.index_count;
        Some(range)
    };
    Ok(levels.iter().scan(all.first_index, place).collect())
}

fn add_merged(level: MergedLevel, arrays: &mut SceneArrays) -> Result<Range, CookError> {
    let vertex_offset = number("vertices", arrays.vertices.len())?;
    let mut shading = Shading::new(level.vertices);
    let range = add_triangles(&level.indices, vertex_offset, &mut shading, arrays);
    arrays.vertices.extend(shading.into_vertices());
    range
}

/// Adds triangles, ready for flat shading. Their vertices go to `vertex_offset` when all that share them are
/// there.
fn add_triangles(
    triangles: &[u32],
    vertex_offset: u32,
    shading: &mut Shading,
    arrays: &mut SceneArrays,
) -> Result<Range, CookError> {
    let first = arrays.indices.len();
    arrays.indices.extend_from_slice(triangles);
    let added = arrays.indices.get_mut(first..).unwrap_or_default();
    shading.turn(added);
    Ok(Range {
        first_index: number("indices", first)?,
        index_count: number("indices", added.len())?,
        vertex_offset,
        vertex_count: added.iter().max().map_or(0, |last| last + 1),
    })
}

/// Makes errors monotone: no level of a node may have a smaller error than one of a node below it. Merging
/// adds to the errors of what it merges, so this changes nothing but what rounding left.
fn raise_errors(arrays: &mut SceneArrays) {
    let mut coarsest = vec![0.0_f32; arrays.nodes.len()];
    for (index, node) in arrays.nodes.iter().enumerate().rev() {
        let below = node.children().filter_map(|c| coarsest.get(c as usize)).fold(0.0, |m: f32, &e| m.max(e));
        let (first, count) = (node.first_drawable as usize, node.drawable_count as usize);
        let mut error = below;
        for drawable in arrays.drawables.iter_mut().skip(first).take(count) {
            error = error.max(drawable.error);
            drawable.error = error;
        }
        if let Some(slot) = coarsest.get_mut(index) {
            *slot = error;
        }
    }
}

/// A count or position as the format's `u32`.
fn number(what: &'static str, count: usize) -> Result<u32, CookError> {
    u32::try_from(count).map_err(|_| CookError::Scene(SceneError::TooMany { what, count }))
}
