//! Writes glTF documents: their bytes, and the buffer views and accessors of these.

use crate::import_files::{floats, glb};

/// A document under construction.
#[derive(Default)]
pub(crate) struct Document {
    bin: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
    more_buffers: String,
}

impl Document {
    /// A document whose accessor 0 has the positions (0,0,0), (1,0,0), (0,1,0).
    pub(crate) fn triangle() -> Self {
        let mut document = Self::default();
        document.positions(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        document
    }

    /// A view of these bytes; `more` are further members of it.
    pub(crate) fn view(&mut self, bytes: &[u8], more: &str) -> usize {
        let (offset, length) = (self.bytes(bytes), bytes.len());
        self.raw_view(&format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}{more}}}"#))
    }

    /// Adds bytes to buffer 0, and returns their offset.
    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        offset
    }

    /// Adds a buffer, as literal JSON.
    pub(crate) fn raw_buffer(&mut self, buffer: &str) {
        self.more_buffers += &format!(",{buffer}");
    }

    /// Adds a view, as literal JSON.
    pub(crate) fn raw_view(&mut self, view: &str) -> usize {
        self.views.push(view.to_owned());
        self.views.len() - 1
    }

    /// An accessor of `count` elements in a view of its own.
    pub(crate) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes, "");
        self.raw_accessor(&format!(
            r#"{{"bufferView":{view},"componentType":{component},"count":{count},"type":"{kind}"}}"#
        ))
    }

    /// Adds an accessor, as literal JSON.
    pub(crate) fn raw_accessor(&mut self, accessor: &str) -> usize {
        self.accessors.push(accessor.to_owned());
        self.accessors.len() - 1
    }

    /// An accessor of three floats each.
    pub(crate) fn positions(&mut self, positions: &[[f32; 3]]) -> usize {
        self.accessor(&floats(&positions.concat()), 5126, "VEC3", positions.len())
    }

    /// An accessor of two floats each.
    pub(crate) fn coordinates(&mut self, coordinates: &[[f32; 2]]) -> usize {
        self.accessor(&floats(&coordinates.concat()), 5126, "VEC2", coordinates.len())
    }

    /// An accessor of indices of 16 bits.
    pub(crate) fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", indices.len())
    }

    /// The JSON, with these further members.
    pub(crate) fn json(&self, members: &str) -> String {
        format!(
            r#"{{"asset":{{"version":"2.0"}},{members},"accessors":[{}],"bufferViews":[{}],
            "buffers":[{{"byteLength":{}}}{}]}}"#,
            self.accessors.join(","),
            self.views.join(","),
            self.bin.len(),
            self.more_buffers
        )
    }

    /// The file, with these further members.
    pub(crate) fn glb(&self, members: &str) -> Vec<u8> {
        glb(&self.json(members), &self.bin)
    }
}
