//! Traverses the node tree of a document and places every mesh.

use std::borrow::Cow;

use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4};

use super::GltfError;
use super::accessor::Accessors;
use super::faults::Faults;
use super::json::{Document, Instancing, Node, Scene};
use crate::import::budget::Budget;
use crate::import::hierarchy::Branch;
use crate::import::report::WarningKind;
use crate::lists::put;

/// A mesh placed by a node.
pub(super) struct Placement {
    /// Index of the node.
    pub node: u32,
    /// Index of the mesh in the document; it exists.
    pub mesh: u32,
    /// The number of the node's instance.
    pub instance: u32,
    /// The mesh's frame to the world's.
    pub to_world: DAffine3,
}

const NONE: u32 = u32::MAX;

/// All placements of the scene that the document shows, in depth-first order, and the branches of that
/// traversal. Leaves of a branch are numbers of placements. Hidden nodes, and nodes with an invalid place,
/// are left out with all below them.
pub(super) fn place(
    document: &Document,
    accessors: &Accessors<'_>,
    budget: &Budget,
    faults: &mut Faults,
    file_to_world: DAffine3,
) -> Result<(Vec<Placement>, Vec<Branch>), GltfError> {
    let parents = vec![NONE; document.nodes.len()];
    let (placements, branches, left_out) = (Vec::new(), Vec::new(), Vec::new());
    let mut walk = Walk { document, accessors, budget, faults, parents, placements, branches, left_out };
    let mut is_child = vec![false; document.nodes.len()];
    for &child in document.nodes.iter().flat_map(|node| &node.children) {
        put(&mut is_child, child, true);
    }
    let is_child = |root: &u32| is_child.get(*root as usize).is_some_and(|flag| *flag);
    let all = 0..document.nodes.len() as u32;
    let roots = match walk.scene() {
        Some(scene) => Cow::Borrowed(&*scene.nodes),
        None => all.clone().filter(|root| !is_child(root)).collect(),
    };
    // A root that is also a child is placed below its parent, if that one is visited.
    let (below, top): (Vec<u32>, Vec<u32>) = roots.iter().partition(|root| is_child(root));
    for root in top.into_iter().chain(below) {
        walk.place_tree(root, file_to_world)?;
    }
    if walk.placements.is_empty() {
        walk.close_left_out();
        let unmet: Vec<u32> = all.clone().filter(|node| walk.is_unmet(*node)).collect();
        let (below, top): (Vec<u32>, Vec<u32>) = unmet.into_iter().partition(|root| is_child(root));
        for root in top.into_iter().chain(below) {
            if walk.is_unmet(root) {
                walk.place_tree(root, file_to_world)?;
            }
        }
        if !walk.placements.is_empty() {
            let what = "the scene has no mesh: all nodes are read instead";
            walk.faults.note(WarningKind::ReferenceLeftOut, what, "the scene");
        }
    }
    walk.close_left_out();
    for (node, of) in all.zip(&document.nodes) {
        if of.mesh.is_some() && walk.is_unmet(node) {
            walk.faults.note(WarningKind::OutsideScene, "", &label(document, node));
        }
    }
    Ok((walk.placements, walk.branches))
}

struct Walk<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    budget: &'a Budget,
    faults: &'a mut Faults,
    /// A node's parent once it was visited; a root's is itself. Nodes have at most one parent, so there is no
    /// second visit, which also ends cycles.
    parents: Vec<u32>,
    placements: Vec<Placement>,
    branches: Vec<Branch>,
    /// Nodes that are left out with all below them.
    left_out: Vec<u32>,
}

/// A node whose children are being traversed.
struct Open<'a> {
    node: u32,
    to_world: DAffine3,
    children: std::slice::Iter<'a, u32>,
    /// Index of its branch, if it is one.
    branch: Option<u32>,
}

impl<'a> Walk<'a> {
    /// Places a root and all below it.
    fn place_tree(&mut self, root: u32, file_to_world: DAffine3) -> Result<(), GltfError> {
        let mut open = Vec::from_iter(self.visit(root, root, file_to_world, None)?);
        while let Some(last) = open.last_mut() {
            let (parent, to_world, branch) = (last.node, last.to_world, last.branch);
            let Some(&child) = last.children.next() else {
                let end = self.placements.len() as u32;
                if let Some(branch) = branch.and_then(|branch| self.branches.get_mut(branch as usize)) {
                    branch.leaves.end = end;
                }
                open.pop();
                continue;
            };
            self.budget.depth(open.len() + 1, || path(self.document, &self.parents, child, parent))?;
            open.extend(self.visit(child, parent, to_world, branch)?);
        }
        Ok(())
    }

    /// Places the mesh of a node, if it has one. Returns none if the node is left out.
    fn visit(
        &mut self,
        index: u32,
        parent: u32,
        parent_to_world: DAffine3,
        within: Option<u32>,
    ) -> Result<Option<Open<'a>>, GltfError> {
        let document = self.document;
        let (Some(node), Some(&met)) = (document.nodes.get(index as usize), self.parents.get(index as usize))
        else {
            self.no_reference(index, parent, "it does not exist");
            return Ok(None);
        };
        if met != NONE {
            self.no_reference(index, parent, "it has two parents, or is its own ancestor");
            return Ok(None);
        }
        put(&mut self.parents, index, parent);
        let name = || label(document, index);
        if node.is_hidden() {
            self.faults.note(WarningKind::HiddenNode, "", &name());
            self.left_out.push(index);
            return Ok(None);
        }
        let to_world = match local(node).and_then(|local| usable(parent_to_world * local)) {
            Ok(to_world) => to_world,
            Err(why) => {
                self.faults.note(WarningKind::NodeLeftOut, why, &name());
                let path = || path(document, &self.parents, index, parent);
                self.faults.cause(|| GltfError::Malformed { part: path(), what: why.into() });
                self.left_out.push(index);
                return Ok(None);
            }
        };
        let branch = document.is_group(node).then_some(self.branches.len() as u32);
        if branch.is_some() {
            let first = self.placements.len() as u32;
            let (name, attributes) = (node.name.clone().unwrap_or_default(), document.attributes(node));
            self.branches.push(Branch { name, parent: within, leaves: first..first, attributes });
        }
        if let Some(mesh) = node.mesh {
            if (mesh as usize) < document.meshes.len() {
                self.place_mesh(index, parent, node, mesh, to_world)?;
            } else {
                self.no_reference(index, parent, "its mesh does not exist");
            }
        }
        Ok(Some(Open { node: index, to_world, children: node.children.iter(), branch }))
    }

    /// Places the mesh of a node: once, or once per instance.
    fn place_mesh(
        &mut self,
        index: u32,
        parent: u32,
        node: &Node,
        mesh: u32,
        to_world: DAffine3,
    ) -> Result<(), GltfError> {
        let name = self.document.object_name(index, mesh);
        let allow = |walk: &Self, count| {
            walk.budget.objects(count, name.len(), || path(walk.document, &walk.parents, index, parent))
        };
        let place = || path(self.document, &self.parents, index, parent);
        self.budget.attributes(self.document.text_of_mesh(mesh), place)?;
        let once = Placement { node: index, mesh, instance: 0, to_world };
        let Some(instancing) = node.instancing() else {
            allow(self, 1)?;
            self.placements.push(once);
            return Ok(());
        };
        let count = match instance_count(self.accessors, index, instancing) {
            Ok(Some(count)) => count,
            Ok(None) => {
                let what = "instances without attributes: placed once";
                self.faults.note(WarningKind::FieldLeftOut, what, name);
                allow(self, 1)?;
                self.placements.push(once);
                return Ok(());
            }
            Err(why) => {
                self.lose_instances(name, why);
                return Ok(());
            }
        };
        allow(self, count)?;
        let locals = match instances(self.accessors, index, instancing, count) {
            Ok(locals) => locals,
            Err(why) => {
                self.lose_instances(name, why);
                return Ok(());
            }
        };
        for (instance, local) in (0..).zip(locals) {
            match local.map(|local| to_world * local).filter(|to_world| usable(*to_world).is_ok()) {
                Some(to_world) => self.placements.push(Placement { node: index, mesh, instance, to_world }),
                None => {
                    self.faults.note(WarningKind::NodeLeftOut, "an instance's matrix is not finite", name);
                }
            }
        }
        Ok(())
    }

    /// Leaves out instances with invalid places.
    fn lose_instances(&mut self, name: &str, why: GltfError) {
        self.faults.note(WarningKind::NodeLeftOut, &format!("instances: {}", why.what()), name);
        self.faults.cause(|| why);
    }

    /// Leaves out a reference to a node, or from one.
    fn no_reference(&mut self, index: u32, parent: u32, what: &'static str) {
        self.faults.note(WarningKind::ReferenceLeftOut, what, &label(self.document, index));
        let path = || path(self.document, &self.parents, index, parent);
        self.faults.cause(|| GltfError::Malformed { part: path(), what: what.into() });
    }

    fn is_unmet(&self, node: u32) -> bool {
        self.parents.get(node as usize) == Some(&NONE)
    }

    /// Counts everything below omitted nodes as visited.
    fn close_left_out(&mut self) {
        while let Some(node) = self.left_out.pop() {
            let children = self.document.nodes.get(node as usize).map(|node| &*node.children);
            for &child in children.unwrap_or_default() {
                if self.is_unmet(child) {
                    self.left_out.push(child);
                    put(&mut self.parents, child, node);
                }
            }
        }
    }

    /// The scene to show: the default one, else the first. Without any, every node without a parent is shown.
    fn scene(&mut self) -> Option<&'a Scene> {
        let Document { scene, scenes, .. } = self.document;
        let named = scene.and_then(|index| scenes.get(index as usize));
        if let (Some(index), None) = (*scene, named) {
            let told = "it does not exist: the first one is read instead, or without any all nodes";
            let part = format!("scene {index}");
            self.faults.note(WarningKind::ReferenceLeftOut, told, &part);
            self.faults.cause(|| GltfError::Malformed { part, what: "it does not exist".into() });
        }
        named.or(scenes.first())
    }
}

/// How many instances a node has: the elements of each of its placing attributes, or else of any other.
/// Nothing is read yet.
fn instance_count(
    accessors: &Accessors<'_>,
    node: u32,
    instancing: &Instancing,
) -> Result<Option<u64>, GltfError> {
    let mut first = None;
    for &accessor in PLACING.iter().filter_map(|name| instancing.attributes.get(*name)) {
        let count = accessors.count(accessor).map_err(broken(node, accessor))?;
        if *first.get_or_insert(count) != count {
            return Err(broken(node, accessor)("its count is not that of the other instance attributes"));
        }
    }
    let other = instancing.attributes.values().next().filter(|_| first.is_none());
    match other {
        Some(&other) => accessors.count(other).map(Some).map_err(broken(node, other)),
        None => Ok(first),
    }
}

/// The instance attributes that place an instance.
const PLACING: [&str; 3] = ["TRANSLATION", "ROTATION", "SCALE"];

/// The placements of EXT_mesh_gpu_instancing, relative to the node: translation, rotation and scale per
/// instance; none for an invalid map. All attributes have equal counts.
fn instances(
    accessors: &Accessors<'_>,
    node: u32,
    instancing: &Instancing,
    count: u64,
) -> Result<Vec<Option<DAffine3>>, GltfError> {
    let translations = placing::<3>(accessors, node, instancing, "TRANSLATION")?;
    let rotations = placing::<4>(accessors, node, instancing, "ROTATION")?;
    let scales = placing::<3>(accessors, node, instancing, "SCALE")?;
    // The budget has room for this many.
    let place = |index| matrix(nth(&translations, index), nth(&rotations, index), nth(&scales, index));
    Ok((0..count as usize).map(place).collect())
}

/// The values of an attribute that places instances, if there is one.
fn placing<const N: usize>(
    accessors: &Accessors<'_>,
    node: u32,
    instancing: &Instancing,
    name: &str,
) -> Result<Option<Vec<[f32; N]>>, GltfError> {
    let read = |&index: &u32| accessors.vectors(index).map_err(broken(node, index));
    instancing.attributes.get(name).map(read).transpose()
}

fn nth<const N: usize>(values: &Option<Vec<[f32; N]>>, index: usize) -> Option<[f64; N]> {
    Some(values.as_ref()?.get(index)?.map(f64::from))
}

fn broken(node: u32, accessor: u32) -> impl Fn(&'static str) -> GltfError {
    move |what| GltfError::Accessor { accessor, user: format!("the instances of node {node}"), what }
}

/// A map without the parts that are left out, or none if the rotation has no direction. Files contain rounded
/// rotations, so it is normalized.
fn matrix(
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
) -> Option<DAffine3> {
    let translation = translation.map_or(DVec3::ZERO, DVec3::from_array);
    let rotation = rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    let scale = scale.map_or(DVec3::ONE, DVec3::from_array);
    let length = rotation.length();
    length
        .is_normal()
        .then(|| DAffine3::from_scale_rotation_translation(scale, rotation / length, translation))
}

/// The tolerance of a matrix's last row against 0 0 0 1: exporters multiply matrices in single precision.
const ROUNDING: f64 = 1e-5;

/// A map to the world, if it is invertible enough for shapes and their volumes.
fn usable(to_world: DAffine3) -> Result<DAffine3, &'static str> {
    if to_world.is_finite() && to_world.matrix3.determinant().is_finite() {
        Ok(to_world)
    } else {
        Err("its matrix is not finite")
    }
}

/// A node's own matrix, unchanged: it may shear and mirror, so it is never decomposed.
fn local(node: &Node) -> Result<DAffine3, &'static str> {
    if let Some(columns) = &node.matrix {
        let matrix = DMat4::from_cols_array(columns);
        return if matrix.is_nan() {
            Err("its matrix is not 16 numbers")
        } else if matrix.row(3).abs_diff_eq(DVec4::W, ROUNDING) {
            Ok(DAffine3::from_mat4(matrix))
        } else {
            Err("the last row of its matrix is not 0 0 0 1")
        };
    }
    let (translation, scale) = (node.translation.as_deref().copied(), node.scale.as_deref().copied());
    let whole = matrix(translation, node.rotation.as_deref().copied(), scale);
    whole.ok_or("its rotation is not a quaternion")
}

/// A node's name in messages: "node 7 (pump/shaft)".
fn path(document: &Document, parents: &[u32], index: u32, parent: u32) -> String {
    let mut names = vec![label(document, index)];
    let (mut at, mut above) = (index, parent);
    while above != at && above != NONE && names.len() < 16 {
        names.push(label(document, above));
        at = above;
        above = parents.get(at as usize).copied().unwrap_or(NONE);
    }
    names.reverse();
    format!("node {index} ({})", names.join("/"))
}

fn label(document: &Document, index: u32) -> String {
    let name = document.nodes.get(index as usize).and_then(|node| node.name.clone());
    name.unwrap_or_else(|| format!("#{index}"))
}
