//! Draco-compressed primitives: KHR_draco_mesh_compression.

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};

use super::GltfError;
use super::accessor::Accessors;
use super::json::{Draco, Primitive};
use crate::import::budget::Budget;

/// The arrays of a primitive, decompressed.
pub(super) struct Decoded<'a> {
    mesh: Mesh,
    draco: &'a Draco,
}

/// Draco's memory for a triangle and a vertex during decompression, in those of a mesh.
const TIMES: u64 = 4;

/// The most bytes of a vertex's decompressed attributes.
const BYTES_A_VERTEX: u64 = 256;

impl<'a> Decoded<'a> {
    /// The arrays of a compressed primitive without plain ones; `place` names it.
    pub(super) fn of(
        primitive: &'a Primitive,
        accessors: &Accessors<'_>,
        budget: &Budget,
        place: &dyn Fn() -> String,
    ) -> Option<Result<Self, GltfError>> {
        let draco = primitive.extensions.as_ref()?.draco.as_ref()?;
        let plain = primitive.attributes.get("POSITION").is_some_and(|&index| accessors.has_bytes(index));
        (!plain).then(|| Self::decode(draco, primitive, accessors, budget, place))
    }

    fn decode(
        draco: &'a Draco,
        primitive: &Primitive,
        accessors: &Accessors<'_>,
        budget: &Budget,
        place: &dyn Fn() -> String,
    ) -> Result<Self, GltfError> {
        let malformed = |what: String| GltfError::Draco { mesh: place(), what };
        let count = |accessor: Option<u32>| accessor.map_or(Ok(0), |index| accessors.count(index));
        let counts = count(primitive.indices)
            .and_then(|corners| Ok((corners, count(primitive.attributes.get("POSITION").copied())?)));
        let (corners, vertices) = counts.map_err(|what| malformed(what.into()))?;
        // The document declares the size, and no more is decompressed.
        let faces = (corners / 3).max(1);
        let vertices = vertices.max(1);
        budget.mesh(faces.saturating_mul(TIMES), vertices.saturating_mul(TIMES), place)?;
        let limits = DecodeLimits::permissive()
            .with_max_faces(faces)
            .with_max_points(vertices)
            .with_max_decoded_bytes(vertices.saturating_mul(BYTES_A_VERTEX));
        let bytes = accessors.view_bytes(draco.buffer_view).map_err(|what| malformed(what.into()))?;
        let mut mesh = Mesh::new();
        MeshDecoder::new()
            .decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh)
            .map_err(|error| malformed(error.to_string()))?;
        if mesh.num_points() as u64 > vertices {
            return Err(malformed("it has more vertices than the document says".into()));
        }
        Ok(Self { mesh, draco })
    }

    /// How many vertices it has.
    pub(super) fn vertices(&self) -> usize {
        self.mesh.num_points()
    }

    /// The corners of its triangles.
    pub(super) fn corners(&self) -> Vec<u32> {
        self.mesh.faces().iter().flatten().map(|&corner| u32::from(corner)).collect()
    }

    /// An attribute's vectors of `N` numbers, if it has them; with `scaled` integers become 0..1, or -1..1.
    pub(super) fn vectors<const N: usize>(&self, name: &str, scaled: bool) -> Option<Vec<[f32; N]>> {
        let attribute = self.attribute(name)?;
        let mut numbers = attribute.read_f32s(self.vertices(), N);
        if let Some(largest) = largest(attribute.data_type()).filter(|_| scaled) {
            numbers.iter_mut().for_each(|number| *number = (*number / largest).max(-1.0));
        }
        Some(numbers.as_chunks().0.to_vec())
    }

    /// How many numbers a vector of an attribute has.
    pub(super) fn lanes(&self, name: &str) -> Option<usize> {
        Some(self.attribute(name)?.num_components().into())
    }

    fn attribute(&self, name: &str) -> Option<&PointAttribute> {
        self.mesh.attribute_by_unique_id(*self.draco.attributes.get(name)?)
    }
}

/// The value for 1 in scaled integers.
fn largest(kind: DataType) -> Option<f32> {
    match kind {
        DataType::Int8 => Some(f32::from(i8::MAX)),
        DataType::Uint8 => Some(f32::from(u8::MAX)),
        DataType::Int16 => Some(f32::from(i16::MAX)),
        DataType::Uint16 => Some(f32::from(u16::MAX)),
        DataType::Uint32 => Some(u32::MAX as f32),
        _ => None,
    }
}
