//! The parts of a glTF document that a model needs, as they stand in the JSON.
//!
//! Nothing here is checked beyond its type: an index is checked where it is followed. The `gltf` crate is not
//! used for this: it keeps matrices as f32, which at the coordinates of a plant (1e6 m) is 6 cm, and both its
//! check of a document and its reader of containers can panic on hostile input.

use serde::Deserialize;
use serde_json::Value;
use trimaran_scene::Attribute;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub asset: Asset,
    pub extensions_required: Vec<String>,
    pub scene: Option<u32>,
    pub scenes: Vec<Scene>,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub materials: Vec<Material>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<Buffer>,
}

impl Document {
    /// What an object is called that places `mesh` by `node`: as the node, or else as the mesh.
    pub(super) fn object_name(&self, node: u32, mesh: u32) -> &str {
        let node = self.nodes.get(node as usize).and_then(|node| node.name.as_deref());
        let mesh = || self.meshes.get(mesh as usize).and_then(|mesh| mesh.name.as_deref());
        node.or_else(mesh).unwrap_or_default()
    }

    /// What is said of the object that a node is. Of many instances it is said once, of their group.
    pub(super) fn attributes_of_one(&self, node: u32) -> Vec<Attribute> {
        let one = self.nodes.get(node as usize).filter(|node| node.instancing().is_none());
        one.map(Node::attributes).unwrap_or_default()
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Asset {
    pub version: String,
    pub min_version: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub nodes: Vec<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub name: Option<String>,
    pub children: Vec<u32>,
    pub mesh: Option<u32>,
    pub skin: Option<u32>,
    /// Column-major, to the parent's frame. Boxed, as all that few nodes have: an empty node takes two bytes
    /// of a file.
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<Box<[f64; 3]>>,
    /// A quaternion: x, y, z, w.
    pub rotation: Option<Box<[f64; 4]>>,
    pub scale: Option<Box<[f64; 3]>>,
    pub extensions: Option<Box<NodeExtensions>>,
    /// Whatever its maker says of it.
    pub extras: Option<Box<Value>>,
}

impl Node {
    /// Whether it is one of several, or has some below it.
    pub(super) fn is_group(&self) -> bool {
        !self.children.is_empty() || self.instancing().is_some()
    }

    pub(super) fn instancing(&self) -> Option<&Instancing> {
        self.extensions.as_ref()?.instancing.as_ref()
    }

    /// The extras as names and values. Values that are no text are written as JSON.
    pub(super) fn attributes(&self) -> Vec<Attribute> {
        let attribute = |name: &str, value: &Value| {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            Attribute { name: name.into(), value: value.into() }
        };
        match self.extras.as_deref() {
            None | Some(Value::Null) => Vec::new(),
            Some(Value::Object(pairs)) => pairs.iter().map(|(name, value)| attribute(name, value)).collect(),
            Some(other) => vec![attribute("extras", other)],
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Instancing {
    pub attributes: InstanceAttributes,
}

/// Accessors of one placement an instance.
#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(rename_all = "UPPERCASE", default)]
pub(super) struct InstanceAttributes {
    pub translation: Option<u32>,
    pub rotation: Option<u32>,
    pub scale: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub name: Option<String>,
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<u32>,
    pub material: Option<u32>,
    #[serde(default = "triangles")]
    pub mode: u32,
}

/// The mode of a primitive that names none: 4, triangles.
const fn triangles() -> u32 {
    4
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub position: Option<u32>,
    #[serde(rename = "COLOR_0")]
    pub colour: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Material {
    pub pbr_metallic_roughness: Metallic,
    pub alpha_mode: AlphaMode,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Metallic {
    /// Linear red, green, blue, alpha.
    pub base_color_factor: [f32; 4],
    pub base_color_texture: Option<serde::de::IgnoredAny>,
}

impl Default for Metallic {
    fn default() -> Self {
        Self { base_color_factor: [1.0; 4], base_color_texture: None }
    }
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum AlphaMode {
    #[default]
    Opaque,
    /// `MASK`, `BLEND` and what extensions add.
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<u32>,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: u64,
    pub indices: SparsePart,
    pub values: SparsePart,
}

/// The indices or the values of a sparse accessor; only the indices have a component type of their own.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparsePart {
    pub buffer_view: u32,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: u32,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: u64,
}
