//! Lays out the arrays of the scene.

use std::{collections::HashMap, ops::Range};

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::clusters::{self, ClusterNode};
use super::gather::{Merged, MergedLevel};
use super::levels::{Level, LeveledMesh};
use super::linear::WorldBox;
use super::placed::Leaf;
use super::solid::{Solid, Solids};
use super::tree::TreeNode;
use super::{CookError, see_through};
use crate::Model;
use crate::lists::put;
use trimaran_scene::{
    Drawable, Geometry, Node, ObjectRecord, SceneArrays, SceneError, Shading, Sides, Vertex,
};

/// The numbers of a mesh's pieces of geometry.
#[derive(Debug, Default)]
struct MeshNumbers {
    /// Of each level its pieces. If there are clusters, the finest level consists of them and has none.
    levels: Vec<Vec<u32>>,
    /// One per node of the cluster tree that is a cluster.
    clusters: Vec<Option<u32>>,
    part_levels: Vec<Vec<u32>>,
}

/// The origin of a scene's node.
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
    mut meshes: Vec<Option<LeveledMesh>>,
    leaves: &[Leaf],
    tree: &[TreeNode],
    merged: Vec<Option<Merged>>,
) -> Result<SceneArrays, CookError> {
    let mut arrays = SceneArrays::default();
    record_objects(model, &mut arrays)?;
    let (numbers, solids) = add_meshes(&mut meshes, &mut arrays)?;
    let parts = Parts { tree, leaves, meshes: &meshes, numbers, solids };
    let mut merged: Vec<_> = merged.into_par_iter().map(|merged| merged.map(MergedPieces::of)).collect();
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
            Place::Cluster { leaf, node } => {
                parts.place_cluster(leaf, node, own, &mut record, &mut arrays)?;
            }
        }
        record.drawable_count = number("drawables", arrays.drawables.len())? - record.first_drawable;
        arrays.nodes.push(record);
        index += 1;
    }
    raise_errors(&mut arrays);
    Ok(arrays)
}

/// The inputs of the nodes.
struct Parts<'a> {
    tree: &'a [TreeNode],
    leaves: &'a [Leaf],
    meshes: &'a [Option<LeveledMesh>],
    /// One per mesh.
    numbers: Vec<MeshNumbers>,
    /// One per piece of geometry of the meshes.
    solids: Vec<Option<Solid>>,
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

    fn clusters_below(&self, leaf: u32, node: u32) -> Range<u32> {
        let cluster = self.leaf(leaf).and_then(|(_, mesh)| mesh.clusters.get(node as usize));
        cluster.map_or(0..0, |cluster| cluster.children.clone())
    }

    /// An object, or a merged node of several.
    fn place_tree_node(
        &self,
        node: u32,
        merged: Option<MergedPieces>,
        index: u32,
        record: &mut Node,
        arrays: &mut SceneArrays,
    ) -> Result<(), CookError> {
        let item = self.tree.get(node as usize).and_then(|node| node.item);
        if let Some((leaf, mesh)) = item.and_then(|item| self.leaf(item)) {
            place_leaf(record, leaf, mesh);
            let numbers = self.numbers.get(leaf.mesh as usize).map_or(&[][..], |numbers| &numbers.levels);
            let levels = mesh.levels.iter().skip(mesh.levels.len().saturating_sub(numbers.len()));
            for (level, pieces) in levels.zip(numbers) {
                self.add_level(leaf, level, pieces, index, record, arrays)?;
            }
        } else if let Some(merged) = merged {
            place_inner(record, merged.origin, merged.bounds);
            for (error, pieces) in merged.levels {
                let count = piece_count(&pieces)?;
                for (number, Piece { geometry, solid }) in (0..).zip(pieces) {
                    let (min, max) = if count > 1 { geometry.part_of(record) } else { *record }.world_box();
                    let bounds = WorldBox { min, max };
                    let sides =
                        solid.map_or(Sides::BOTH, |s| s.sides(DMat3::IDENTITY, merged.origin, bounds));
                    let geometry = add_geometry(geometry, arrays)?;
                    add_drawable(index, error, geometry, sides, [number, count], arrays);
                }
            }
        }
        Ok(())
    }

    /// The pieces of a level of a placed mesh.
    fn add_level(
        &self,
        leaf: &Leaf,
        level: &Level,
        pieces: &[u32],
        index: u32,
        record: &Node,
        arrays: &mut SceneArrays,
    ) -> Result<(), CookError> {
        let count = piece_count(pieces)?;
        for (number, &geometry) in (0..).zip(pieces) {
            let sides = self.sides(leaf, geometry, count, record, arrays);
            add_drawable(index, leaf.world_error(level.error), geometry, sides, [number, count], arrays);
        }
        Ok(())
    }

    /// A part of an object, in the object's frame: of its finest level, and of a large mesh's coarser ones.
    fn place_cluster(
        &self,
        leaf: u32,
        node: u32,
        index: u32,
        record: &mut Node,
        arrays: &mut SceneArrays,
    ) -> Result<(), CookError> {
        let Some((leaf, mesh)) = self.leaf(leaf) else { return Ok(()) };
        let Some(cluster) = mesh.clusters.get(node as usize) else { return Ok(()) };
        place_leaf(record, leaf, mesh);
        if let Some(parent) = arrays.nodes.get(record.parent as usize) {
            (record.world_min, record.world_max) = (parent.world_min, parent.world_max);
        }
        *record = record.part(cluster.min, cluster.max);
        let Some(numbers) = self.numbers.get(leaf.mesh as usize) else { return Ok(()) };
        if let Some(&Some(finest)) = numbers.clusters.get(node as usize) {
            let sides = self.sides(leaf, finest, 1, record, arrays);
            add_drawable(index, 0.0, finest, sides, [0, 1], arrays);
        }
        let levels = mesh.part_levels.iter().zip(&numbers.part_levels);
        for (level, pieces) in levels.skip(cluster.levels.start as usize).take(cluster.levels.len()) {
            self.add_level(leaf, level, pieces, index, record, arrays)?;
        }
        Ok(())
    }

    /// The visible sides of a piece of a placed mesh, one of so many of a level of this node.
    fn sides(&self, leaf: &Leaf, number: u32, pieces: u16, node: &Node, arrays: &SceneArrays) -> Sides {
        let (min, max) = match arrays.geometries.get(number as usize) {
            Some(geometry) if pieces > 1 => geometry.part_of(node).world_box(),
            _ => node.world_box(),
        };
        let solid = self.solids.get(number as usize).copied().flatten();
        solid.map_or(Sides::BOTH, |solid| {
            solid.sides(leaf.linear.as_dmat3(), leaf.origin, WorldBox { min, max })
        })
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

/// Adds the piece of this number, of so many.
fn add_drawable(
    node: u32,
    error: f32,
    geometry: u32,
    sides: Sides,
    [piece, pieces]: [u16; 2],
    arrays: &mut SceneArrays,
) {
    let triangles = arrays.geometries.get(geometry as usize).map_or(0, Geometry::triangles) as u32;
    arrays.drawables.push(Drawable { error, node, geometry, triangles, sides, piece, pieces });
}

/// How many pieces a level has.
fn piece_count<T>(pieces: &[T]) -> Result<u16, CookError> {
    let count = pieces.len();
    u16::try_from(count)
        .map_err(|_| CookError::Scene(SceneError::TooMany { what: "pieces of a level", count }))
}

fn record_objects(model: &Model, arrays: &mut SceneArrays) -> Result<(), CookError> {
    arrays.sources = model.sources.iter().map(|source| source.name.clone()).collect();
    arrays.see_through = see_through::objects(model);
    arrays.hierarchy = model.hierarchy.clone();
    arrays.coordinates = model.coordinates.clone();
    for object in &model.objects {
        arrays.objects.push(ObjectRecord {
            source: object.source,
            source_index: object.source_index,
            name_start: number("bytes of names", arrays.names.len())?,
            name_length: number("bytes of names", object.name.len())?,
            node: Node::NONE, // until the nodes are there
        });
        arrays.names.push_str(&object.name);
    }
    Ok(())
}

/// Moves the triangles of all meshes into pieces; returns their numbers, and the solid of each piece.
fn add_meshes(
    meshes: &mut [Option<LeveledMesh>],
    arrays: &mut SceneArrays,
) -> Result<(Vec<MeshNumbers>, Vec<Option<Solid>>), CookError> {
    let pieces: Vec<Pieces> =
        meshes.par_iter_mut().map(|mesh| mesh.as_mut().map(Pieces::take).unwrap_or_default()).collect();
    let mut solids = Vec::new();
    let numbers =
        pieces.into_iter().map(|pieces| pieces.add(arrays, &mut solids)).collect::<Result<_, _>>()?;
    Ok((numbers, solids))
}

/// The geometry of a mesh: as [`MeshNumbers`].
#[derive(Default)]
struct Pieces {
    levels: Vec<Vec<Piece>>,
    clusters: Vec<Option<Piece>>,
    part_levels: Vec<Vec<Piece>>,
}

/// A piece of geometry, and the solids to which it belongs.
struct Piece {
    geometry: Geometry,
    solid: Option<Solid>,
}

/// A merged node's levels in pieces.
struct MergedPieces {
    origin: DVec3,
    bounds: WorldBox,
    /// Of each its error and its pieces.
    levels: Vec<(f32, Vec<Piece>)>,
}

impl MergedPieces {
    fn of(merged: Merged) -> Self {
        let cut = |MergedLevel { vertices, mut indices, error }| {
            let pieces = clusters::pieces(&vertices, &mut indices);
            let solids = Solids::new(&vertices, &indices);
            let piece = |(range, _)| cut_out(&vertices, &indices, &solids, range);
            (error, pieces.into_iter().map(piece).collect())
        };
        let Merged { origin, bounds, levels } = merged;
        Self { origin, bounds, levels: levels.into_iter().map(cut).collect() }
    }
}

impl Pieces {
    fn take(mesh: &mut LeveledMesh) -> Self {
        let pieces = Self::of(mesh);
        mesh.vertices = Vec::new();
        mesh.levels.iter_mut().chain(&mut mesh.part_levels).for_each(|level| level.indices = Vec::new());
        pieces
    }

    fn of(mesh: &LeveledMesh) -> Self {
        let alone = |indices: &[u32]| Piece {
            geometry: piece(&mesh.vertices, indices),
            solid: Solids::new(&mesh.vertices, indices).of_all(),
        };
        let level = |level: &Level| -> Vec<Piece> {
            let solids = Solids::new(&mesh.vertices, &level.indices);
            let cut = |range: &Range<u32>| cut_out(&mesh.vertices, &level.indices, &solids, range.clone());
            level.pieces.iter().map(cut).collect()
        };
        let clustered = usize::from(!mesh.clusters.is_empty());
        let finest = mesh.levels.first().map(|level| level.indices.as_slice()).unwrap_or_default();
        // Clusters are drawn with all others of their mesh, unless parts of it have levels of their own.
        let together =
            (clustered == 1 && mesh.part_levels.is_empty()).then(|| Solids::new(&mesh.vertices, finest));
        let cluster = |node: &ClusterNode| {
            let range = node.indices.start as usize..node.indices.end as usize;
            let own = finest.get(range.clone()).filter(|own| !own.is_empty())?;
            Some(match &together {
                Some(solids) => Piece {
                    geometry: piece(&mesh.vertices, own),
                    solid: solids.of(range.start / 3..range.end / 3),
                },
                None => alone(own),
            })
        };
        Self {
            levels: mesh.levels.iter().skip(clustered).map(level).collect(),
            clusters: mesh.clusters.iter().map(cluster).collect(),
            part_levels: mesh.part_levels.iter().map(level).collect(),
        }
    }

    fn add(
        self,
        arrays: &mut SceneArrays,
        solids: &mut Vec<Option<Solid>>,
    ) -> Result<MeshNumbers, CookError> {
        let mut add = |Piece { geometry, solid }| {
            solids.push(solid);
            add_geometry(geometry, arrays)
        };
        let mut add_all =
            |pieces: Vec<Piece>| pieces.into_iter().map(&mut add).collect::<Result<Vec<u32>, _>>();
        let levels = self.levels.into_iter().map(&mut add_all).collect::<Result<_, _>>()?;
        let part_levels = self.part_levels.into_iter().map(&mut add_all).collect::<Result<_, _>>()?;
        Ok(MeshNumbers {
            levels,
            part_levels,
            clusters: self
                .clusters
                .into_iter()
                .map(|piece| piece.map(&mut add).transpose())
                .collect::<Result<_, _>>()?,
        })
    }
}

/// A piece of a level.
fn cut_out(vertices: &[Vertex], level: &[u32], solids: &Solids, range: Range<u32>) -> Piece {
    let range = range.start as usize..range.end as usize;
    let own = level.get(range.clone()).unwrap_or_default();
    Piece { geometry: piece(vertices, own), solid: solids.of(range.start / 3..range.end / 3) }
}

/// Some triangles, prepared for flat shading, with only the vertices that they use.
fn piece(vertices: &[Vertex], triangles: &[u32]) -> Geometry {
    let mut numbers: HashMap<u32, u32> = HashMap::new();
    let mut own = Vec::new();
    let mut indices: Vec<u32> = triangles
        .iter()
        .filter_map(|&index| {
            let vertex = *vertices.get(index as usize)?;
            Some(*numbers.entry(index).or_insert_with(|| {
                own.push(vertex);
                own.len() as u32 - 1
            }))
        })
        .collect();
    let mut shading = Shading::new(own);
    shading.turn(&mut indices);
    let mut vertices = shading.into_vertices();
    // There are many pieces, and all stay until the scene is encoded.
    vertices.shrink_to_fit();
    indices.shrink_to_fit();
    Geometry { vertices, indices }
}

fn add_geometry(geometry: Geometry, arrays: &mut SceneArrays) -> Result<u32, CookError> {
    arrays.geometries.push(geometry);
    number("pieces of geometry", arrays.geometries.len() - 1)
}

/// Makes errors monotone: no level of a node may have a smaller error than one of a node below it. Merging
/// adds the errors of its inputs, so this only corrects rounding.
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
        put(&mut coarsest, index, error);
    }
}

/// A count or position as the format's `u32`.
fn number(what: &'static str, count: usize) -> Result<u32, CookError> {
    u32::try_from(count).map_err(|_| CookError::Scene(SceneError::TooMany { what, count }))
}
