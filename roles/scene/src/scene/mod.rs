//! The cooked scene: plain arrays that all roles share, made by cooking or read from a file.

mod file;
mod flat;
mod hash;
mod open_error;
mod records;
mod shading;
mod stable;
mod validate;

use glam::Vec3;
use rayon::prelude::*;
use trimaran_proto::SceneHash;

use file::MappedScene;
pub use file::SaveError;
pub use flat::FlatObject;
pub use open_error::OpenError;
pub use records::{Drawable, Node, NodeId, ObjectRecord, Rgba8, SceneArrays, Sides, Vertex};
pub use shading::{Normal, Shading};
pub use validate::SceneError;

/// A cooked scene, checked: every index in it is in range, every box finite, errors monotone to the root.
#[derive(Debug)]
pub struct Scene {
    storage: Storage,
    hash: SceneHash,
}

/// Where the arrays live.
#[derive(Debug)]
enum Storage {
    Memory(SceneArrays),
    File(MappedScene),
}

/// The arrays of a scene, wherever they live.
#[derive(Debug, Clone, Copy)]
struct Parts<'a> {
    nodes: &'a [Node],
    drawables: &'a [Drawable],
    vertices: &'a [Vertex],
    indices: &'a [u32],
    objects: &'a [ObjectRecord],
    /// UTF-8 as a whole.
    names: &'a [u8],
    sources: &'a [String],
}

impl Scene {
    /// Checks the arrays and makes a scene of them.
    ///
    /// # Errors
    /// Names the first record that is malformed.
    pub fn from_arrays(arrays: SceneArrays) -> Result<Self, SceneError> {
        let parts = arrays.parts();
        validate::check(&parts)?;
        Ok(Self { hash: hash::fingerprint(&parts), storage: Storage::Memory(arrays) })
    }

    /// The nodes, breadth first; the root is the first.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        match &self.storage {
            Storage::Memory(arrays) => &arrays.nodes,
            Storage::File(mapped) => mapped.nodes(),
        }
    }

    /// The drawables; a [`DrawableId`](trimaran_proto::DrawableId) indexes them.
    #[must_use]
    pub fn drawables(&self) -> &[Drawable] {
        match &self.storage {
            Storage::Memory(arrays) => &arrays.drawables,
            Storage::File(mapped) => mapped.drawables(),
        }
    }

    /// The vertices of all drawables.
    #[must_use]
    pub fn vertices(&self) -> &[Vertex] {
        match &self.storage {
            Storage::Memory(arrays) => &arrays.vertices,
            Storage::File(mapped) => mapped.vertices(),
        }
    }

    /// The indices of all drawables.
    #[must_use]
    pub fn indices(&self) -> &[u32] {
        match &self.storage {
            Storage::Memory(arrays) => &arrays.indices,
            Storage::File(mapped) => mapped.indices(),
        }
    }

    /// The objects, for names in reports.
    #[must_use]
    pub fn objects(&self) -> &[ObjectRecord] {
        match &self.storage {
            Storage::Memory(arrays) => &arrays.objects,
            Storage::File(mapped) => mapped.objects(),
        }
    }

    /// The name of an object (index into [`Scene::objects`]); `None` past their end, empty if the object has
    /// no name.
    #[must_use]
    pub fn object_name(&self, object: u32) -> Option<&str> {
        let parts = self.parts();
        parts.name_of(parts.objects.get(object as usize)?)
    }

    /// The name of a source file ([`ObjectRecord::source`]); `None` past their end.
    #[must_use]
    pub fn source_name(&self, source: u32) -> Option<&str> {
        self.parts().sources.get(source as usize).map(String::as_str)
    }

    /// The names of the files the objects came from.
    #[must_use]
    pub fn sources(&self) -> &[String] {
        self.parts().sources
    }

    /// A drawable's triangles, in its node's local frame.
    pub fn triangles(&self, drawable: &Drawable) -> impl Iterator<Item = [Vec3; 3]> + use<'_> {
        let (first, offset) = (drawable.first_index as usize, drawable.vertex_offset as usize);
        let indices = self.indices().get(first..first + drawable.index_count as usize).unwrap_or_default();
        let vertices = self.vertices();
        let corner = move |index: u32| Some(vertices.get(offset + index as usize)?.position.into());
        let (triples, _) = indices.as_chunks::<3>();
        triples.iter().filter_map(move |&[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?]))
    }

    /// A node and all above it, up to the root.
    pub fn ancestors(&self, node: NodeId) -> impl Iterator<Item = (NodeId, &Node)> {
        let get = |id: u32| self.nodes().get(id as usize).map(|node| (NodeId(id), node));
        std::iter::successors(get(node.0), move |(_, node)| get(node.parent))
    }

    /// The triangles of all leaves at their finest level: the model as it came, instances counted each.
    #[must_use]
    pub fn full_detail_triangles(&self) -> u64 {
        let leaves = self.nodes().par_iter().filter(|node| node.is_leaf());
        let finest = leaves.filter_map(|leaf| self.drawables().get(leaf.levels().next()?.index()));
        finest.map(|drawable| u64::from(drawable.index_count / 3)).sum()
    }

    /// Whether the arrays lie in whole pages laid out as in the file ([`Scene::open`]): all of them readable,
    /// and none of them changing, for as long as the scene lives.
    #[must_use]
    pub const fn is_mapped(&self) -> bool {
        matches!(self.storage, Storage::File(_))
    }

    /// The fingerprint that peers compare, and the checksum of the file.
    #[must_use]
    pub fn hash(&self) -> SceneHash {
        self.hash
    }

    fn parts(&self) -> Parts<'_> {
        match &self.storage {
            Storage::Memory(arrays) => arrays.parts(),
            Storage::File(mapped) => mapped.parts(),
        }
    }
}

impl SceneArrays {
    fn parts(&self) -> Parts<'_> {
        Parts {
            nodes: &self.nodes,
            drawables: &self.drawables,
            vertices: &self.vertices,
            indices: &self.indices,
            objects: &self.objects,
            names: self.names.as_bytes(),
            sources: &self.sources,
        }
    }
}

impl<'a> Parts<'a> {
    fn name_of(&self, object: &ObjectRecord) -> Option<&'a str> {
        let start = object.name_start as usize;
        let end = start.checked_add(object.name_length as usize)?;
        std::str::from_utf8(self.names.get(start..end)?).ok()
    }
}

#[cfg(test)]
mod tests;
