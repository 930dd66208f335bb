//! The parts of a glTF document that a model needs, as in the JSON.
//!
//! Only types are checked here, as leniently as the meaning allows: an index is checked on use. The `gltf`
//! crate is not used: it keeps matrices as f32, which at the coordinates of a plant (1e6 m) is 6 cm, and both
//! its check of a document and its reader of containers can panic on hostile input.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::Value;
use trimaran_scene::Attribute;

use super::GltfError;
use super::faults::Faults;
use super::material::{Image, Material, Sampler, Texture};
use super::mend::{Mended, mend};
use super::metadata::{FeatureIds, Features, Metadata};
use super::objects::objects;
use super::tolerant;
use crate::import::report::WarningKind;

objects! {
    pub(super) struct Document {
        pub asset: Asset,
        pub extensions_required: Vec<String>,
        pub scene: Option<u32>,
        pub scenes: Vec<Scene>,
        pub nodes: Vec<Node>,
        pub meshes: Vec<Mesh>,
        pub materials: Vec<Material>,
        pub textures: Vec<Texture>,
        pub samplers: Vec<Sampler>,
        pub images: Vec<Image>,
        pub accessors: Vec<Accessor>,
        pub buffer_views: Vec<BufferView>,
        pub buffers: Vec<Buffer>,
        pub extensions: Option<Box<DocumentExtensions>>,
    }

    pub(super) struct Asset {
        pub version: Option<String>,
        pub min_version: Option<String>,
    }

    pub(super) struct DocumentExtensions {
        pub metadata: Option<Metadata> = "EXT_structural_metadata",
    }

    pub(super) struct Scene {
        pub nodes: Vec<u32>,
    }

    pub(super) struct Node {
        pub name: Option<String>,
        pub children: Vec<u32>,
        pub mesh: Option<u32>,
        pub skin: Option<u32>,
        /// Column-major, to the parent's frame. Boxed, like all rare members: an empty node takes two bytes
        /// of a file.
        pub matrix: Option<Box<[f64; 16]>>,
        pub translation: Option<Box<[f64; 3]>>,
        /// A quaternion: x, y, z, w.
        pub rotation: Option<Box<[f64; 4]>>,
        pub scale: Option<Box<[f64; 3]>>,
        /// For the mesh's morph targets, replacing the mesh's own.
        pub weights: Option<Box<[f32]>>,
        pub extensions: Option<Box<NodeExtensions>>,
        /// The author's own data.
        pub extras: Option<Box<Value>>,
    }

    pub(super) struct NodeExtensions {
        pub instancing: Option<Instancing> = "EXT_mesh_gpu_instancing",
        pub visibility: Option<Visibility> = "KHR_node_visibility",
        pub features: Option<Features> = "EXT_instance_features",
    }

    pub(super) struct Visibility {
        pub visible: Option<bool>,
    }

    pub(super) struct Instancing {
        /// Accessors with one element per instance: TRANSLATION, ROTATION, SCALE and others.
        pub attributes: BTreeMap<String, u32>,
    }

    pub(super) struct Mesh {
        pub name: Option<String>,
        pub primitives: Vec<Primitive>,
        /// For the primitives' morph targets.
        pub weights: Option<Box<[f32]>>,
        pub extras: Option<Box<Value>>,
    }

    pub(super) struct Primitive {
        /// Accessors with one element per vertex: POSITION, COLOR_0, TEXCOORD_0 and others.
        pub attributes: BTreeMap<String, u32>,
        pub indices: Option<u32>,
        pub material: Option<u32>,
        /// 4, triangles, if there is none.
        pub mode: Option<u32>,
        pub targets: Vec<Target>,
        pub extensions: Option<Box<PrimitiveExtensions>>,
    }

    /// A morph target: offsets of positions, multiplied by its weight.
    pub(super) struct Target {
        pub position: Option<u32> = "POSITION",
    }

    pub(super) struct PrimitiveExtensions {
        pub draco: Option<Draco> = "KHR_draco_mesh_compression",
        pub features: Option<Features> = "EXT_mesh_features",
    }

    /// A primitive with arrays compressed by Draco.
    pub(super) struct Draco {
        pub buffer_view: u32,
        /// Draco's numbers of the primitive's attributes.
        pub attributes: BTreeMap<String, u32>,
    }

    pub(super) struct Accessor {
        pub buffer_view: Option<u32>,
        pub byte_offset: u64,
        pub component_type: u32,
        pub normalized: bool,
        pub count: u64,
        pub kind: String = "type",
        pub sparse: Option<Box<Sparse>>,
    }

    pub(super) struct Sparse {
        pub count: u64,
        pub indices: SparsePart,
        pub values: SparsePart,
    }

    /// The indices or the values of a sparse accessor; only the indices have a component type of their own.
    pub(super) struct SparsePart {
        pub buffer_view: Option<u32>,
        pub byte_offset: u64,
        pub component_type: Option<u32>,
    }

    pub(super) struct BufferView {
        pub buffer: u32,
        pub byte_offset: u64,
        pub byte_length: u64,
        pub byte_stride: Option<u64>,
        pub extensions: Option<Box<ViewExtensions>>,
    }

    pub(super) struct ViewExtensions {
        pub ext: Option<Packed> = "EXT_meshopt_compression",
        pub khr: Option<Packed> = "KHR_meshopt_compression",
    }

    /// The compressed bytes of a buffer view, and their decompressed form.
    pub(super) struct Packed {
        pub buffer: u32,
        pub byte_offset: u64,
        pub byte_length: u64,
        pub byte_stride: u64,
        pub count: u64,
        pub mode: String,
        pub filter: Option<Box<str>>,
    }

    pub(super) struct Buffer {
        pub uri: Option<String>,
        pub byte_length: u64,
        pub extensions: Option<Box<BufferExtensions>>,
    }

    pub(super) struct BufferExtensions {
        pub ext: Option<Fallback> = "EXT_meshopt_compression",
        pub khr: Option<Fallback> = "KHR_meshopt_compression",
    }

    pub(super) struct Fallback {
        pub fallback: Option<bool>,
    }
}

impl Document {
    /// Parses a document. A faulty one is read as far as possible.
    pub(super) fn parse(json: &[u8], faults: &mut Faults) -> Result<Self, GltfError> {
        let mut document = match serde_json::from_slice(json) {
            Ok(document) => document,
            Err(_) => Self::parse_mended(json, faults)?,
        };
        document.settle(faults);
        Ok(document)
    }

    fn parse_mended(json: &[u8], faults: &mut Faults) -> Result<Self, GltfError> {
        let Mended { json, faults: mended } = mend(json);
        if let Ok(Head { meshes, nodes, accessors }) = serde_json::from_slice::<Head>(&json)
            && [&meshes, &nodes, &accessors].into_iter().any(|all| !all.is_empty())
        {
            return Err(GltfError::Version { version: "1.0".into() });
        }
        for (what, count) in mended {
            faults.report.warn_about(WarningKind::JsonMended, what, count);
        }
        Ok(tolerant::read(&json, faults)?)
    }

    /// Replaces NaN by defaults. Places stay: without one, a node is left out.
    fn settle(&mut self, faults: &mut Faults) {
        let mut weights = 0;
        let of_meshes = self.meshes.iter_mut().filter_map(|mesh| mesh.weights.as_mut());
        let of_nodes = self.nodes.iter_mut().filter_map(|node| node.weights.as_mut());
        for weight in of_meshes.chain(of_nodes).flatten().filter(|weight| !weight.is_finite()) {
            *weight = 0.0;
            weights += 1;
        }
        let detail = "weights of morph targets that are no numbers: taken as 0";
        faults.report.warn_about(WarningKind::FieldLeftOut, detail, weights);
        for (number, material) in self.materials.iter_mut().enumerate() {
            let name = material.name.clone().unwrap_or_else(|| format!("material {number}"));
            for what in material.settle() {
                faults.report.warn_of(WarningKind::FieldLeftOut, what, &name);
            }
        }
    }

    /// The name of an object that places `mesh` by `node`: the node's, or else the mesh's.
    pub(super) fn object_name(&self, node: u32, mesh: u32) -> &str {
        let node = self.nodes.get(node as usize).and_then(|node| node.name.as_deref());
        let mesh = || self.meshes.get(mesh as usize).and_then(|mesh| mesh.name.as_deref());
        node.or_else(mesh).unwrap_or_default()
    }

    /// The attributes of the object of a node: the node's, completed by the mesh's. If a node has several,
    /// their group has them.
    pub(super) fn attributes_of_one(&self, node: u32) -> Vec<Attribute> {
        let one = self.nodes.get(node as usize).filter(|node| !self.is_several(node));
        one.map(|node| self.attributes(node)).unwrap_or_default()
    }

    /// Whether a node is several objects: instances, or features of a mesh.
    pub(super) fn is_several(&self, node: &Node) -> bool {
        let mesh = node.mesh.and_then(|mesh| self.meshes.get(mesh as usize));
        let mut primitives = mesh.into_iter().flat_map(|mesh| &mesh.primitives);
        node.instancing().is_some()
            || Metadata::of(self).is_some() && primitives.any(|one| one.features().is_some())
    }

    /// Whether a node is a group: it has several objects, or nodes below it.
    pub(super) fn is_group(&self, node: &Node) -> bool {
        !node.children.is_empty() || self.is_several(node)
    }

    /// The bytes of a mesh's attributes for each of its objects.
    pub(super) fn text_of_mesh(&self, mesh: u32) -> u64 {
        let extras = self.meshes.get(mesh as usize).and_then(|mesh| mesh.extras.as_deref());
        attributes(extras).iter().map(|one| (one.name.len() + one.value.len()) as u64).sum()
    }

    /// The attributes of a node and its mesh.
    pub(super) fn attributes(&self, node: &Node) -> Vec<Attribute> {
        let mut all = attributes(node.extras.as_deref());
        let mesh = node.mesh.and_then(|mesh| self.meshes.get(mesh as usize));
        let more = mesh.map(|mesh| attributes(mesh.extras.as_deref())).unwrap_or_default();
        let said = all.len();
        for attribute in more {
            if !all.iter().take(said).any(|known| known.name == attribute.name) {
                all.push(attribute);
            }
        }
        all
    }
}

/// Extras as names and values. Values other than text are written as JSON.
fn attributes(extras: Option<&Value>) -> Vec<Attribute> {
    let attribute = |name: &str, value: &Value| {
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        Attribute { name: name.into(), value: value.into() }
    };
    match extras {
        None | Some(Value::Null) => Vec::new(),
        Some(Value::Object(pairs)) => pairs.iter().map(|(name, value)| attribute(name, value)).collect(),
        Some(other) => vec![attribute("extras", other)],
    }
}

/// The marks of a glTF 1.0 document: objects by name instead of 2.0's arrays.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Head {
    meshes: BTreeMap<String, IgnoredAny>,
    nodes: BTreeMap<String, IgnoredAny>,
    accessors: BTreeMap<String, IgnoredAny>,
}

impl Node {
    pub(super) fn instancing(&self) -> Option<&Instancing> {
        self.extensions.as_ref()?.instancing.as_ref()
    }

    pub(super) fn is_hidden(&self) -> bool {
        let visibility = self.extensions.as_ref().and_then(|extensions| extensions.visibility.as_ref());
        visibility.is_some_and(|visibility| visibility.visible == Some(false))
    }
}

impl Primitive {
    /// The numbering of its triangles' features: the attribute's name, and the meaning of the numbers.
    pub(super) fn features(&self) -> Option<(String, &FeatureIds)> {
        let ids = self.extensions.as_ref()?.features.as_ref()?.with_table()?;
        Some((format!("_FEATURE_ID_{}", ids.attribute?), ids))
    }
}

impl BufferView {
    /// Its compression, if it has one.
    pub(super) fn packed(&self) -> Option<&Packed> {
        let extensions = self.extensions.as_ref()?;
        extensions.khr.as_ref().or(extensions.ext.as_ref())
    }
}

impl Buffer {
    /// Whether it is only a fallback for compressed bytes.
    pub(super) fn is_fallback(&self) -> bool {
        let all = self.extensions.as_ref().map(|of| [of.ext.as_ref(), of.khr.as_ref()]);
        all.is_some_and(|all| all.into_iter().flatten().any(|fallback| fallback.fallback == Some(true)))
    }
}
