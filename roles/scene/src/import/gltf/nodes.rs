//! Walks the node tree of a document and places every mesh it meets.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::GltfError;
use super::accessor::Accessors;
use super::json::{Document, Instancing, Node};

/// A mesh placed by a node.
pub(super) struct Placement {
    /// Index of the node.
    pub node: u32,
    /// Index of the mesh in the document; it exists.
    pub mesh: u32,
    /// The mesh's frame to the world's.
    pub to_world: DAffine3,
}

const NONE: u32 = u32::MAX;

/// All placements of the scene that the document shows, in the order of a walk from parents to children.
pub(super) fn place(
    document: &Document,
    accessors: &Accessors<'_>,
    file_to_world: DAffine3,
) -> Result<Vec<Placement>, GltfError> {
    let walk = Walk { document, accessors };
    // A node's parent once it was met; a root's is itself. Nodes have one parent at most, so a second visit is an error,
    // which also ends cycles.
    let mut parents = vec![NONE; document.nodes.len()];
    let mut placements = Vec::new();
    let mut stack: Vec<(u32, u32, DAffine3)> =
        walk.roots()?.into_iter().rev().map(|root| (root, root, file_to_world)).collect();
    while let Some((index, parent, parent_to_world)) = stack.pop() {
        let malformed = |what| GltfError::Node { node: path(document, &parents, index, parent), what };
        let (Some(node), Some(met)) =
            (document.nodes.get(index as usize), parents.get(index as usize).copied())
        else {
            return Err(malformed("it does not exist"));
        };
        if met != NONE {
            return Err(malformed("it has two parents, or is its own ancestor"));
        }
        let to_world = parent_to_world * local(node).map_err(malformed)?;
        if !to_world.is_finite() || !to_world.matrix3.determinant().is_finite() {
            return Err(malformed("its matrix overflows; repair the model where it was made"));
        }
        if let Some(slot) = parents.get_mut(index as usize) {
            *slot = parent;
        }
        if let Some(mesh) = node.mesh {
            if mesh as usize >= document.meshes.len() {
                return Err(GltfError::Node {
                    node: path(document, &parents, index, parent),
                    what: "its mesh does not exist",
                });
            }
            match node.extensions.as_ref().and_then(|extensions| extensions.instancing.as_ref()) {
                None => placements.push(Placement { node: index, mesh, to_world }),
                Some(instancing) => {
                    for instance in walk.instances(index, instancing)? {
                        let to_world = to_world * instance;
                        placements.push(Placement { node: index, mesh, to_world });
                    }
                }
            }
        }
        stack.extend(node.children.iter().rev().map(|&child| (child, index, to_world)));
    }
    Ok(placements)
}

struct Walk<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
}

impl Walk<'_> {
    /// The roots of the scene to show: the default one, else the first, else every node that is nobody's child.
    fn roots(&self) -> Result<Vec<u32>, GltfError> {
        let Document { scene, scenes, nodes, .. } = self.document;
        match (scene, scenes.first()) {
            (Some(index), _) => scenes
                .get(*index as usize)
                .map(|scene| scene.nodes.clone())
                .ok_or(GltfError::Scene { scene: *index, what: "it does not exist" }),
            (None, Some(first)) => Ok(first.nodes.clone()),
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

    /// The placements of EXT_mesh_gpu_instancing, relative to the node: translation, rotation and scale an instance.
    fn instances(&self, node: u32, instancing: &Instancing) -> Result<Vec<DAffine3>, GltfError> {
        let user = || format!("the instances of node {node}");
        let failed = |accessor| move |what| GltfError::Accessor { accessor, user: user(), what };
        let attributes = &instancing.attributes;
        let translations = attributes.translation.map(|index| (index, self.accessors.vectors::<3>(index)));
        let rotations = attributes.rotation.map(|index| (index, self.accessors.vectors::<4>(index)));
        let scales = attributes.scale.map(|index| (index, self.accessors.vectors::<3>(index)));
        let mut all = Vec::new();
        if let Some((accessor, values)) = translations {
            let values = values.map_err(failed(accessor))?;
            spread(&mut all, values, |trs, v| trs.translation = DVec3::from_array(v.map(f64::from)))
                .map_err(failed(accessor))?;
        }
        if let Some((accessor, values)) = rotations {
            let values = values.map_err(failed(accessor))?;
            spread(&mut all, values, |trs, v| trs.rotation = DQuat::from_array(v.map(f64::from)))
                .map_err(failed(accessor))?;
        }
        if let Some((accessor, values)) = scales {
            let values = values.map_err(failed(accessor))?;
            spread(&mut all, values, |trs, v| trs.scale = DVec3::from_array(v.map(f64::from)))
                .map_err(failed(accessor))?;
        }
        all.iter()
            .map(|trs| {
                trs.matrix().filter(DAffine3::is_finite).ok_or_else(|| GltfError::Node {
                    node: user(),
                    what: "an instance's rotation or place is not finite",
                })
            })
            .collect()
    }
}

/// Sets one property of every instance; the first property to be set makes the instances.
fn spread<const N: usize>(
    all: &mut Vec<Trs>,
    values: Vec<[f32; N]>,
    set: impl Fn(&mut Trs, [f32; N]),
) -> Result<(), &'static str> {
    if all.is_empty() {
        all.resize(values.len(), Trs::default());
    }
    if all.len() != values.len() {
        return Err("its count is not that of the other instance attributes");
    }
    for (trs, value) in all.iter_mut().zip(values) {
        set(trs, value);
    }
    Ok(())
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
    /// The map, or nothing if the rotation has no direction. Files keep rotations as rounded numbers: normalize.
    fn matrix(&self) -> Option<DAffine3> {
        let length = self.rotation.length();
        (length.is_normal()).then(|| {
            DAffine3::from_scale_rotation_translation(self.scale, self.rotation / length, self.translation)
        })
    }
}

/// A node's own matrix, exactly as it stands: it may shear and mirror, so it is never taken apart.
fn local(node: &Node) -> Result<DAffine3, &'static str> {
    if let Some(columns) = &node.matrix {
        let matrix = DMat4::from_cols_array(columns);
        return if matrix.row(3).to_array() == [0.0, 0.0, 0.0, 1.0] {
            Ok(DAffine3::from_mat4(matrix))
        } else {
            Err("the last row of its matrix is not 0 0 0 1")
        };
    }
    let trs = Trs {
        translation: DVec3::from_array(node.translation.unwrap_or_default()),
        rotation: node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array),
        scale: node.scale.map_or(DVec3::ONE, DVec3::from_array),
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
