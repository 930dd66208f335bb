//! Reads typed arrays out of buffers: dense, strided, sparse and quantized accessors.

use super::buffers::Bytes;
use super::json::{Accessor, BufferView, Document};

/// Reads accessors of one document. Errors are texts to which the caller adds the accessor's user.
pub(super) struct Accessors<'a> {
    accessors: &'a [Accessor],
    views: &'a [BufferView],
    buffers: &'a [Bytes<'a>],
    /// The bytes of the views that were compressed.
    decompressed: &'a [Option<Vec<u8>>],
    /// Bytes in all buffers: bounds the count of an accessor without bytes of its own.
    total: u64,
}

/// The type of a number in a buffer.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

/// The error of an accessor without bytes.
const NO_VIEW: &str = "its buffer view does not exist";

type Result<T> = std::result::Result<T, &'static str>;

impl<'a> Accessors<'a> {
    pub(super) fn new(
        document: &'a Document,
        buffers: &'a [Bytes<'a>],
        decompressed: &'a [Option<Vec<u8>>],
    ) -> Self {
        Self {
            accessors: &document.accessors,
            views: &document.buffer_views,
            buffers,
            decompressed,
            total: buffers.iter().map(|buffer| buffer.as_slice().len() as u64).sum(),
        }
    }

    /// The bytes of a buffer view.
    pub(super) fn view_bytes(&self, index: u32) -> Result<&'a [u8]> {
        self.bytes(index).map(|(bytes, _)| bytes)
    }

    /// Whether an accessor has elements in a buffer.
    pub(super) fn has_bytes(&self, index: u32) -> bool {
        self.accessor(index).is_ok_and(|accessor| accessor.buffer_view.is_some())
    }

    /// Whether an accessor's integers stand for 0..1 or -1..1.
    pub(super) fn is_normalized(&self, index: u32) -> bool {
        self.accessor(index).is_ok_and(|accessor| accessor.normalized)
    }

    /// Numbers per vector of this accessor: 1 to 4.
    pub(super) fn lanes(&self, index: u32) -> Result<usize> {
        match self.accessor(index)?.kind.as_str() {
            "SCALAR" => Ok(1),
            "VEC2" => Ok(2),
            "VEC3" => Ok(3),
            "VEC4" => Ok(4),
            _ => Err("its type is not a vector"),
        }
    }

    /// The declared number of elements. Reading may find fewer.
    pub(super) fn count(&self, index: u32) -> Result<u64> {
        Ok(self.accessor(index)?.count)
    }

    /// Whether each element is in the buffer, so that some can be read without the others.
    pub(super) fn is_dense(&self, index: u32) -> bool {
        self.accessor(index).is_ok_and(|accessor| accessor.sparse.is_none() && accessor.buffer_view.is_some())
    }

    /// Vectors of `N` floats; integers are converted, and scaled to 0..1 or -1..1 if the accessor is
    /// normalized.
    pub(super) fn vectors<const N: usize>(&self, index: u32) -> Result<Vec<[f32; N]>> {
        self.vectors_at(index, None, self.is_normalized(index))
    }

    /// Like [`Accessors::vectors`]; with `picks` only those elements, of an accessor that [is
    /// dense](Accessors::is_dense). The caller decides whether integers are scaled.
    pub(super) fn vectors_at<const N: usize>(
        &self,
        index: u32,
        picks: Option<&[u32]>,
        scaled: bool,
    ) -> Result<Vec<[f32; N]>> {
        let accessor = self.accessor(index)?;
        if self.lanes(index)? != N {
            return Err("its type has another number of components than its use demands");
        }
        let component = Component::new(accessor.component_type)?;
        let decode = |bytes: &[u8]| {
            let mut vector = [0.0; N];
            for (number, bytes) in vector.iter_mut().zip(bytes.chunks_exact(component.size())) {
                *number = component.float(bytes, scaled);
            }
            vector
        };
        let size = component.size() * N;
        let Some(picks) = picks else { return self.elements(accessor, size, [0.0; N], decode) };
        let view = accessor.buffer_view.ok_or(NO_VIEW)?;
        let elements = self.strided(view, accessor.byte_offset, accessor.count, size)?;
        let pick =
            |&pick: &u32| elements.get(pick as usize).map(decode).ok_or("an index points past its end");
        picks.iter().map(pick).collect()
    }

    /// Vertex indices: unsigned whole numbers.
    pub(super) fn indices(&self, index: u32) -> Result<Vec<u32>> {
        let accessor = self.accessor(index)?;
        let component = Component::new(accessor.component_type)?;
        if self.lanes(index)? != 1 || !component.is_unsigned() {
            return Err("indices must be unsigned scalars");
        }
        self.elements(accessor, component.size(), 0, |bytes| component.unsigned(bytes))
    }

    fn accessor(&self, index: u32) -> Result<&'a Accessor> {
        self.accessors.get(index as usize).ok_or("it does not exist")
    }

    /// The elements of an accessor, `size` bytes each.
    fn elements<T: Copy>(
        &self,
        accessor: &Accessor,
        size: usize,
        zero: T,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>> {
        let mut elements = match accessor.buffer_view {
            Some(view) => self.dense(view, accessor.byte_offset, accessor.count, size, &decode)?,
            // Only sparse values: the rest is zero, without bytes that would bound the count.
            None if accessor.count <= self.total => vec![zero; accessor.count as usize],
            None => return Err("it claims more elements than the file has bytes"),
        };
        if let Some(sparse) = accessor.sparse.as_ref().filter(|sparse| sparse.count > 0) {
            let part = &sparse.indices;
            let index = Component::new(part.component_type.ok_or("its sparse indices have no type")?)?;
            if !index.is_unsigned() {
                return Err("its sparse indices are not unsigned");
            }
            let places = self.dense(
                part.buffer_view.ok_or(NO_VIEW)?,
                part.byte_offset,
                sparse.count,
                index.size(),
                |bytes| index.unsigned(bytes),
            )?;
            let part = &sparse.values;
            let values =
                self.dense(part.buffer_view.ok_or(NO_VIEW)?, part.byte_offset, sparse.count, size, &decode)?;
            for (place, value) in places.into_iter().zip(values) {
                *elements.get_mut(place as usize).ok_or("a sparse index points past its end")? = value;
            }
        }
        Ok(elements)
    }

    /// `count` elements of `size` bytes; never more than the view has bytes for.
    fn dense<T>(
        &self,
        view: u32,
        offset: u64,
        count: u64,
        size: usize,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>> {
        let elements = self.strided(view, offset, count, size)?;
        Ok((0..elements.count).filter_map(|index| elements.get(index)).map(decode).collect())
    }

    /// The place of `count` elements of `size` bytes; all of them exist.
    fn strided(&self, view: u32, offset: u64, count: u64, size: usize) -> Result<Strided<'a>> {
        let (bytes, stride) = self.bytes(view)?;
        let stride = match stride {
            // Exporters write 0 for "one behind the other".
            None | Some(0) => size,
            Some(stride) => usize::try_from(stride)
                .ok()
                .filter(|&stride| stride >= size)
                .ok_or("its stride is less than an element")?,
        };
        let bytes = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..));
        let bytes = bytes.ok_or("its offset is past the end of its buffer view")?;
        // The last element needs only its own bytes, not a whole stride.
        let room = if bytes.len() < size { 0 } else { (bytes.len() - size) / stride + 1 };
        let count = usize::try_from(count).ok().filter(|&count| count <= room);
        let count = count.ok_or("it reaches past the end of its buffer view")?;
        Ok(Strided { bytes, stride, size, count })
    }

    /// The bytes of a view, and its stride if it has one.
    fn bytes(&self, index: u32) -> Result<(&'a [u8], Option<u64>)> {
        let view = self.views.get(index as usize).ok_or(NO_VIEW)?;
        if let Some(Some(bytes)) = self.decompressed.get(index as usize) {
            let stride = view.packed().filter(|packed| packed.mode == "ATTRIBUTES");
            return Ok((bytes, view.byte_stride.or(stride.map(|packed| packed.byte_stride))));
        }
        let buffer = self.buffers.get(view.buffer as usize).ok_or("its buffer does not exist")?.as_slice();
        let range = usize::try_from(view.byte_offset).ok().zip(usize::try_from(view.byte_length).ok());
        // A view that reaches past the end has the buffer's bytes: an accessor may need no more.
        let bytes =
            range.and_then(|(start, length)| buffer.get(start..start.checked_add(length)?.min(buffer.len())));
        Ok((bytes.ok_or("its buffer view reaches past the end of the buffer")?, view.byte_stride))
    }
}

/// Elements at equal steps through bytes.
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
    count: usize,
}

impl<'a> Strided<'a> {
    fn get(&self, index: usize) -> Option<&'a [u8]> {
        let start = (index < self.count).then_some(index)?.checked_mul(self.stride)?;
        self.bytes.get(start..start.checked_add(self.size)?)
    }
}

impl Component {
    fn new(code: u32) -> Result<Self> {
        match code {
            5120 => Ok(Self::I8),
            5121 => Ok(Self::U8),
            5122 => Ok(Self::I16),
            5123 => Ok(Self::U16),
            5125 => Ok(Self::U32),
            5126 => Ok(Self::F32),
            _ => Err("its component type is unknown"),
        }
    }

    const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    const fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    fn unsigned(self, bytes: &[u8]) -> u32 {
        match (self, bytes) {
            (Self::U8, &[a]) => u32::from(a),
            (Self::U16, &[a, b]) => u32::from(u16::from_le_bytes([a, b])),
            (Self::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
            _ => 0,
        }
    }

    /// The number as a float; signed normalized numbers clamp at -1 (glTF 2.0 specification, section
    /// 3.6.2.2).
    fn float(self, bytes: &[u8], normalized: bool) -> f32 {
        let (value, largest) = match (self, bytes) {
            (Self::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
            (Self::I8, &[a]) => (f32::from(a.cast_signed()), f32::from(i8::MAX)),
            (Self::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), f32::from(i16::MAX)),
            (Self::U8, &[a]) => (f32::from(a), f32::from(u8::MAX)),
            (Self::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), f32::from(u16::MAX)),
            _ => (self.unsigned(bytes) as f32, u32::MAX as f32),
        };
        if normalized { (value / largest).max(-1.0) } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(accessors: &str, views: &str) -> Document {
        serde_json::from_str(&format!(r#"{{"accessors":[{accessors}],"bufferViews":[{views}]}}"#)).unwrap()
    }

    fn read<const N: usize>(accessor: &str, views: &str, bytes: &[u8]) -> Result<Vec<[f32; N]>> {
        let document = document(accessor, views);
        let buffers = [Bytes::Within(bytes)];
        Accessors::new(&document, &buffers, &[]).vectors(0)
    }

    #[test]
    fn strides_and_offsets() {
        let bytes = [9, 1, 2, 0, 3, 4];
        let view = r#"{"buffer":0,"byteOffset":1,"byteLength":5,"byteStride":3}"#;
        let accessor = r#"{"bufferView":0,"componentType":5121,"count":2,"type":"VEC2"}"#;
        assert_eq!(read(accessor, view, &bytes), Ok(vec![[1.0, 2.0], [3.0, 4.0]]));
        let past = accessor.replace(r#""count":2"#, r#""count":3"#);
        assert_eq!(read::<2>(&past, view, &bytes), Err("it reaches past the end of its buffer view"));
    }

    #[test]
    fn normalized_numbers_are_scaled_and_clamped() {
        let view = r#"{"buffer":0,"byteLength":3}"#;
        let accessor = r#"{"bufferView":0,"componentType":5120,"normalized":true,"count":1,"type":"VEC3"}"#;
        assert_eq!(read(accessor, view, &[0x80, 0, 127]), Ok(vec![[-1.0, 0.0, 1.0]]));
    }

    #[test]
    fn sparse_values_replace_zeros() {
        let views = r#"{"buffer":0,"byteLength":1},{"buffer":0,"byteOffset":4,"byteLength":4}"#;
        let accessor = r#"{"componentType":5126,"count":3,"type":"SCALAR","sparse":{"count":1,
            "indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":1}}}"#;
        let bytes = [2, 0, 0, 0, 0, 0, 0x80, 0x3f];
        assert_eq!(read(accessor, views, &bytes), Ok(vec![[0.0], [0.0], [1.0]]));
        let bytes = [3, 0, 0, 0, 0, 0, 0x80, 0x3f];
        assert_eq!(read::<1>(accessor, views, &bytes), Err("a sparse index points past its end"));
    }

    #[test]
    fn no_count_makes_it_allocate() {
        let views = r#"{"buffer":0,"byteLength":8}"#;
        for accessor in [
            r#"{"componentType":5126,"count":9000000000000000000,"type":"VEC3"}"#,
            r#"{"bufferView":0,"componentType":5126,"count":9000000000000000000,"type":"VEC3"}"#,
            r#"{"bufferView":0,"byteOffset":18446744073709551615,"componentType":5126,"count":1,"type":"VEC3"}"#,
        ] {
            assert!(read::<3>(accessor, views, &[0; 8]).is_err(), "{accessor}");
        }
        let huge = r#"{"buffer":0,"byteOffset":18446744073709551615,"byteLength":18446744073709551615}"#;
        let accessor = r#"{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3"}"#;
        assert!(read::<3>(accessor, huge, &[0; 8]).is_err());
        let still = r#"{"buffer":0,"byteLength":8,"byteStride":2}"#;
        assert_eq!(read::<3>(accessor, still, &[0; 8]), Err("its stride is less than an element"));
        let tight = r#"{"buffer":0,"byteLength":12,"byteStride":0}"#;
        assert_eq!(read::<3>(accessor, tight, &[0; 12]), Ok(vec![[0.0; 3]]));
    }

    #[test]
    fn picked_elements_are_those_of_the_whole() {
        let bytes = [9, 1, 2, 0, 3, 4];
        let view = r#"{"buffer":0,"byteOffset":1,"byteLength":5,"byteStride":3}"#;
        let dense = r#"{"bufferView":0,"componentType":5121,"count":2,"type":"VEC2"}"#;
        let document = document(dense, view);
        let buffers = [Bytes::Within(&bytes)];
        let accessors = Accessors::new(&document, &buffers, &[]);
        assert!(accessors.is_dense(0) && accessors.count(0) == Ok(2));
        let picked = accessors.vectors_at(0, Some(&[1, 0, 1]), false);
        assert_eq!(picked, Ok(vec![[3.0, 4.0], [1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(accessors.vectors_at::<2>(0, Some(&[2]), false), Err("an index points past its end"));
    }
}
