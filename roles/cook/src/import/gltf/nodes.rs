//! Walks the node tree of a document and places every mesh it meets.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4};

use super::GltfError;
use super::accessor::Accessors;
use super::json::{Document, Instancing, Node};
use crate::import::budget::Budget;
use crate::import::hierarchy::Branch;
use crate::import::report::{ImportReport, WarningKind};

/// A mesh placed by a node.
pub(super) struct Placement {
    /// Index of the node.
    pub node: u32,
    /// Index of the mesh in the document; it exists.
    pub mesh: u32,
    /// Which of the node's instances it is.
    pub instance: u32,
    /// The mesh's frame to the world's.
    pub to_world: DAffine3,
}

const NONE: u32 = u32::MAX;

/// All placements of the scene that the document shows, in the order of a walk from parents to children, and
/// the branches of that walk. Leaves of a branch are numbers of placements. Nodes that are hidden, or whose
/// place cannot be told, are left out with all below them.
pub(super) fn place(
    document: &Document,
    accessors: &Accessors<'_>,
    budget: &Budget,
    report: &mut ImportReport,
    file_to_world: DAffine3,
) -> Result<(Vec<Placement>, Vec<Branch>), GltfError> {
    let parents = vec![NONE; document.nodes.len()];
    let (placements, branches) = (Vec::new(), Vec::new());
    let mut walk = Walk { document, accessors, budget, report, parents, placements, branches };
    for &root in walk.roots()?.iter() {
        walk.place_tree(root, file_to_world)?;
    }
    Ok((walk.placements, walk.branches))
}

struct Walk<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    budget: &'a Budget,
    report: &'a mut ImportReport,
    /// A node's parent once it was met; a root's is itself. Nodes have one parent at most, so a second visit
    /// is an error, which also ends cycles.
    parents: Vec<u32>,
    placements: Vec<Placement>,
    branches: Vec<Branch>,
}

/// A node whose children are being walked.
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

    /// Places the mesh of a node, if it has one. Nothing if the node is left out.
    fn visit(
        &mut self,
        index: u32,
        parent: u32,
        parent_to_world: DAffine3,
        within: Option<u32>,
    ) -> Result<Option<Open<'a>>, GltfError> {
        let document = self.document;
        let malformed = |walk: &Self, what| GltfError::Node { node: walk.path(index, parent), what };
        let (Some(node), Some(&met)) = (document.nodes.get(index as usize), self.parents.get(index as usize))
        else {
            return Err(malformed(self, "it does not exist"));
        };
        if met != NONE {
            return Err(malformed(self, "it has two parents, or is its own ancestor"));
        }
        if let Some(slot) = self.parents.get_mut(index as usize) {
            *slot = parent;
        }
        let name = || label(document, index);
        if node.is_hidden() {
            self.report.warn_of(WarningKind::HiddenNode, "", &name());
            return Ok(None);
        }
        let to_world = match local(node).and_then(|local| usable(parent_to_world * local)) {
            Ok(to_world) => to_world,
            Err(why) => {
                self.report.warn_of(WarningKind::NodeLeftOut, why, &name());
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
            if mesh as usize >= document.meshes.len() {
                return Err(malformed(self, "its mesh does not exist"));
            }
            self.place_mesh(index, parent, node, mesh, to_world)?;
        }
        Ok(Some(Open { node: index, to_world, children: node.children.iter(), branch }))
    }

    /// Places the mesh of a node: once, or once an instance.
    fn place_mesh(
        &mut self,
        index: u32,
        parent: u32,
        node: &Node,
        mesh: u32,
        to_world: DAffine3,
    ) -> Result<(), GltfError> {
        let place = || self.path(index, parent);
        let name_length = self.document.object_name(index, mesh).len();
        self.budget.attributes(self.document.text_of_mesh(mesh), place)?;
        let Some(instancing) = node.instancing() else {
            self.budget.objects(1, name_length, place)?;
            self.placements.push(Placement { node: index, mesh, instance: 0, to_world });
            return Ok(());
        };
        self.budget.objects(instance_count(self.accessors, index, instancing)?, name_length, place)?;
        for (instance, local) in (0..).zip(instances(self.accessors, index, instancing)?) {
            match local.map(|local| to_world * local).filter(|to_world| usable(*to_world).is_ok()) {
                Some(to_world) => self.placements.push(Placement { node: index, mesh, instance, to_world }),
                None => {
                    let name = self.document.object_name(index, mesh);
                    self.report.warn_of(WarningKind::NodeLeftOut, "an instance's matrix is not finite", name);
                }
            }
        }
        Ok(())
    }

    /// A node as a reader of the file finds it: "node 7 (pump/shaft)".
    fn path(&self, index: u32, parent: u32) -> String {
        path(self.document, &self.parents, index, parent)
    }

    /// The roots of the scene to show: the default one, else the first, else every node that is nobody's
    /// child.
    fn roots(&self) -> Result<Cow<'a, [u32]>, GltfError> {
        let Document { scene, scenes, nodes, .. } = self.document;
        match (scene, scenes.first()) {
            (Some(index), _) => scenes
                .get(*index as usize)
                .map(|scene| Cow::Borrowed(scene.nodes.as_slice()))
                .ok_or(GltfError::Scene { scene: *index, what: "it does not exist" }),
            (None, Some(first)) => Ok(Cow::Borrowed(&first.nodes)),
            (None, None) => {
                let mut is_child = vec![false; nodes.len()];
                for &child in nodes.iter().flat_map(|node| &node.children) {
                    if let Some(flag) = is_child.get_mut(child as usize) {
                        *flag = true;
                    }
                }
                Ok((0..).zip(is_child).filter(|(_, is_child)| !is_child).map(|(root, _)| root).collect())
            }
        }
    }
}

/// How many instances a node has: as many as each of its instance attributes has elements. Nothing is read
/// yet.
fn instance_count(accessors: &Accessors<'_>, node: u32, instancing: &Instancing) -> Result<u64, GltfError> {
    let mut first = None;
    for &accessor in PLACING.iter().filter_map(|name| instancing.attributes.get(*name)) {
        let count = accessors.count(accessor).map_err(broken(node, accessor))?;
        if *first.get_or_insert(count) != count {
            return Err(broken(node, accessor)("its count is not that of the other instance attributes"));
        }
    }
    Ok(first.unwrap_or(0))
}

/// The instance attributes that say where an instance is.
const PLACING: [&str; 3] = ["TRANSLATION", "ROTATION", "SCALE"];

/// The placements of EXT_mesh_gpu_instancing, relative to the node: translation, rotation and scale an
/// instance; none of an instance where they make no map. All attributes have equal counts.
fn instances(
    accessors: &Accessors<'_>,
    node: u32,
    instancing: &Instancing,
) -> Result<Vec<Option<DAffine3>>, GltfError> {
    let attributes: &BTreeMap<String, u32> = &instancing.attributes;
    let mut all = Vec::new();
    if let Some(&index) = attributes.get("TRANSLATION") {
        let values = accessors.vectors::<3>(index).map_err(broken(node, index))?;
        spread(&mut all, values, |trs, v| trs.translation = DVec3::from_array(v.map(f64::from)));
    }
    if let Some(&index) = attributes.get("ROTATION") {
        let values = accessors.vectors::<4>(index).map_err(broken(node, index))?;
        spread(&mut all, values, |trs, v| trs.rotation = DQuat::from_array(v.map(f64::from)));
    }
    if let Some(&index) = attributes.get("SCALE") {
        let values = accessors.vectors::<3>(index).map_err(broken(node, index))?;
        spread(&mut all, values, |trs, v| trs.scale = DVec3::from_array(v.map(f64::from)));
    }
    Ok(all.iter().map(Trs::matrix).collect())
}

fn user(node: u32) -> String {
    format!("the instances of node {node}")
}

fn broken(node: u32, accessor: u32) -> impl Fn(&'static str) -> GltfError {
    move |what| GltfError::Accessor { accessor, user: user(node), what }
}

/// Sets one property of every instance.
fn spread<const N: usize>(all: &mut Vec<Trs>, values: Vec<[f32; N]>, set: impl Fn(&mut Trs, [f32; N])) {
    all.resize(values.len(), Trs::default());
    all.iter_mut().zip(values).for_each(|(trs, value)| set(trs, value));
}

#[derive(Clone, Copy)]
struct Trs {
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
}

impl Default for Trs {
    fn default() -> Self {
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }
}

impl Trs {
    /// The map, or nothing if the rotation has no direction. Files keep rotations as rounded numbers:
    /// normalize.
    fn matrix(&self) -> Option<DAffine3> {
        let length = self.rotation.length();
        (length.is_normal()).then(|| {
            DAffine3::from_scale_rotation_translation(self.scale, self.rotation / length, self.translation)
        })
    }
}

/// How far the last row of a matrix may be from 0 0 0 1: exporters multiply matrices in single precision.
const ROUNDING: f64 = 1e-5;

/// A map to the world, if it is one that shapes and their volumes can be followed by.
fn usable(to_world: DAffine3) -> Result<DAffine3, &'static str> {
    if to_world.is_finite() && to_world.matrix3.determinant().is_finite() {
        Ok(to_world)
    } else {
        Err("its matrix overflows")
    }
}

/// A node's own matrix, exactly as it stands: it may shear and mirror, so it is never taken apart.
fn local(node: &Node) -> Result<DAffine3, &'static str> {
    if let Some(columns) = &node.matrix {
        let matrix = DMat4::from_cols_array(columns);
        return if matrix.row(3).abs_diff_eq(DVec4::W, ROUNDING) {
            Ok(DAffine3::from_mat4(matrix))
        } else {
            Err("the last row of its matrix is not 0 0 0 1")
        };
    }
    let trs = Trs {
        translation: node.translation.as_deref().map_or(DVec3::ZERO, |&v| DVec3::from_array(v)),
        rotation: node.rotation.as_deref().map_or(DQuat::IDENTITY, |&v| DQuat::from_array(v)),
        scale: node.scale.as_deref().map_or(DVec3::ONE, |&v| DVec3::from_array(v)),
    };
    trs.matrix().ok_or("its rotation is not a quaternion")
}

/// A node as a reader of the file finds it: "node 7 (pump/shaft)".
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
