//! Buffer views compressed by meshoptimizer: EXT_meshopt_compression and KHR_meshopt_compression.

use meshopt::{
    decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence, decode_vertex_buffer,
};
use rayon::prelude::*;

use super::GltfError;
use super::buffers::Bytes;
use super::faults::Faults;
use super::json::{BufferView, Packed};
use crate::import::budget::Budget;
use crate::import::report::WarningKind;

type Result<T> = std::result::Result<T, &'static str>;

/// The bytes of a compressed view that count as a vertex.
const BYTES_A_VERTEX: u64 = 32;

/// The decompressed bytes of each compressed view. If decompression fails, its fallback bytes, if there are
/// any.
pub(super) fn decompress(
    views: &[BufferView],
    buffers: &[Bytes<'_>],
    budget: &Budget,
    faults: &mut Faults,
) -> std::result::Result<Vec<Option<Vec<u8>>>, GltfError> {
    if views.iter().all(|view| view.packed().is_none()) {
        return Ok(Vec::new());
    }
    let one = |(index, view): (usize, &BufferView)| {
        let Some(packed) = view.packed() else { return Ok(None) };
        let malformed = |what| GltfError::Packed { view: index as u32, what };
        let bytes = compressed(packed, buffers).map_err(malformed)?;
        let size = Size::of(packed, bytes.len()).map_err(malformed)?;
        let vertices = (size.count as u64 * size.stride as u64).div_ceil(BYTES_A_VERTEX);
        budget.mesh(0, vertices, || format!("buffer view {index}, decompressed,"))?;
        let unpacked = unpack(packed, size, bytes).map_err(malformed)?;
        if (unpacked.len() as u64) < view.byte_length {
            return Err(malformed("it has fewer bytes than its buffer view"));
        }
        Ok(Some(unpacked))
    };
    let mut all: Vec<std::result::Result<_, GltfError>> = views.par_iter().enumerate().map(one).collect();
    for (index, view) in all.iter_mut().enumerate() {
        if let Err(GltfError::Packed { what, .. }) = view {
            faults.note(WarningKind::BytesLeftOut, what, &format!("buffer view {index}"));
            if let Err(why) = std::mem::replace(view, Ok(None)) {
                faults.cause(|| why);
            }
        }
    }
    all.into_iter().collect()
}

fn compressed<'a>(packed: &Packed, buffers: &'a [Bytes<'_>]) -> Result<&'a [u8]> {
    let buffer = buffers.get(packed.buffer as usize).ok_or("its buffer does not exist")?.as_slice();
    let range = usize::try_from(packed.byte_offset).ok().zip(usize::try_from(packed.byte_length).ok());
    range
        .and_then(|(start, length)| buffer.get(start..start.checked_add(length)?))
        .ok_or("its compressed bytes reach past the end of the buffer")
}

/// The number and size of a view's decompressed elements.
#[derive(Clone, Copy)]
struct Size {
    count: usize,
    stride: usize,
}

impl Size {
    /// At most as many elements as the bytes can hold: memory is allocated for all at once.
    fn of(packed: &Packed, bytes: usize) -> Result<Self> {
        let sizes = usize::try_from(packed.count).ok().zip(usize::try_from(packed.byte_stride).ok());
        let (count, stride) = sizes.ok_or("its count is too large")?;
        let (fits, least) = match packed.mode.as_str() {
            // A block of at most 256 elements has at least a byte for each four of an element.
            "ATTRIBUTES" => {
                let fits = stride.is_multiple_of(4) && (4..=256).contains(&stride);
                (fits, count.div_ceil(256).saturating_mul(stride / 4))
            }
            // At least a byte a triangle, or an index.
            "TRIANGLES" => (matches!(stride, 2 | 4) && count.is_multiple_of(3), count / 3),
            "INDICES" => (matches!(stride, 2 | 4), count),
            _ => return Err("its mode is unknown"),
        };
        if !fits {
            Err("its stride or count does not fit its mode")
        } else if least > bytes {
            Err("it claims more elements than its bytes can hold")
        } else {
            Ok(Self { count, stride })
        }
    }
}

fn unpack(packed: &Packed, Size { count, stride }: Size, bytes: &[u8]) -> Result<Vec<u8>> {
    let broken = |_| "its compressed bytes are damaged";
    if count == 0 {
        return Ok(Vec::new());
    }
    match (packed.mode.as_str(), stride) {
        ("ATTRIBUTES", _) => {
            let mut words = vertices(stride / 4, count, bytes)?;
            filter(packed.filter.as_deref().unwrap_or("NONE"), stride, &mut words)?;
            Ok(words.into_iter().flat_map(u32::to_ne_bytes).collect())
        }
        ("TRIANGLES", 2) => Ok(shorts(decode_index_buffer(bytes, count).map_err(broken)?)),
        ("TRIANGLES", _) => Ok(longs(decode_index_buffer(bytes, count).map_err(broken)?)),
        (_, 2) => Ok(shorts(decode_index_sequence(bytes, count).map_err(broken)?)),
        _ => Ok(longs(decode_index_sequence(bytes, count).map_err(broken)?)),
    }
}

fn shorts(indices: Vec<u16>) -> Vec<u8> {
    indices.into_iter().flat_map(u16::to_le_bytes).collect()
}

fn longs(indices: Vec<u32>) -> Vec<u8> {
    indices.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// An element of `N` words; arrays of this length have no default of their own.
#[derive(Clone, Copy)]
struct Element<const N: usize>([u32; N]);

impl<const N: usize> Default for Element<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

fn elements<const N: usize>(count: usize, bytes: &[u8]) -> Result<Vec<u32>> {
    let elements: Vec<Element<N>> =
        decode_vertex_buffer(bytes, count).map_err(|_| "its compressed bytes are damaged")?;
    Ok(elements.into_iter().flat_map(|Element(words)| words).collect())
}

/// Consecutive elements of this many words. The decoder takes an element's size from its type.
fn vertices(words: usize, count: usize, bytes: &[u8]) -> Result<Vec<u32>> {
    macro_rules! by_size {
        ($($size:literal)*) => {
            match words {
                $($size => elements::<$size>(count, bytes),)*
                _ => Err("its stride does not fit its mode"),
            }
        };
    }
    by_size!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}

/// Decodes the filters that were applied for better compression.
fn filter(name: &str, stride: usize, words: &mut [u32]) -> Result<()> {
    match (name, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => fourwise(words, |four: &mut [[i8; 4]]| decode_filter_oct(four)),
        ("OCTAHEDRAL", 8) => fourwise(words, |four: &mut [[i16; 4]]| decode_filter_oct(four)),
        ("QUATERNION", 8) => fourwise(words, decode_filter_quat),
        ("COLOR", 4) => fourwise(words, |four: &mut [[u8; 4]]| decode_filter_color(four)),
        ("COLOR", 8) => fourwise(words, |four: &mut [[u16; 4]]| decode_filter_color(four)),
        ("EXPONENTIAL", _) => decode_filter_exp(bytemuck::cast_slice_mut::<u32, [u32; 1]>(words)),
        ("OCTAHEDRAL" | "QUATERNION" | "COLOR", _) => return Err("its stride does not fit its filter"),
        _ => return Err("its filter is unknown"),
    }
    Ok(())
}

/// Elements of one or two words as four bytes or shorts.
fn fourwise<T: bytemuck::Pod>(words: &mut [u32], filter: impl Fn(&mut [[T; 4]])) {
    if let Ok(elements) = bytemuck::try_cast_slice_mut(words) {
        filter(elements);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshopt::{
        EncodeExpMode, encode_filter_exp, encode_index_buffer, encode_index_sequence, encode_vertex_buffer,
    };
    use proptest::prelude::*;

    fn packed(mode: &str, filter: Option<&str>, count: u64, byte_stride: u64) -> Packed {
        let filter = filter.map(Box::from);
        Packed { count, byte_stride, mode: mode.into(), filter, ..Packed::default() }
    }

    fn read(packed: &Packed, bytes: &[u8]) -> Result<Vec<u8>> {
        unpack(packed, Size::of(packed, bytes.len())?, bytes)
    }

    #[test]
    fn triangles_come_back() {
        let indices: Vec<u32> = (0..300).flat_map(|at| [at, at + 1, at + 2]).collect();
        let bytes = encode_index_buffer(&indices, 302).unwrap();
        let long = read(&packed("TRIANGLES", None, 900, 4), &bytes).unwrap();
        let short = read(&packed("TRIANGLES", None, 900, 2), &bytes).unwrap();
        // The codec may rotate a triangle's corners.
        let sorted = |corners: &[u32]| {
            let mut all: Vec<_> = corners.to_vec();
            all.chunks_mut(3).for_each(<[u32]>::sort_unstable);
            all
        };
        let long: Vec<u32> = long.as_chunks().0.iter().map(|&four| u32::from_le_bytes(four)).collect();
        let short: Vec<u32> =
            short.as_chunks().0.iter().map(|&two| u32::from(u16::from_le_bytes(two))).collect();
        assert_eq!(sorted(&long), sorted(&indices));
        assert_eq!(short, long);
    }

    #[test]
    fn exponents_come_back_as_floats() {
        let values = [[1.0f32, -2.5, 1024.0], [0.0, 0.125, 3.0]];
        let written = encode_filter_exp(&values, 24, EncodeExpMode::Separate);
        let bytes = encode_vertex_buffer(&written).unwrap();
        let read = read(&packed("ATTRIBUTES", Some("EXPONENTIAL"), 2, 12), &bytes).unwrap();
        let floats: Vec<f32> = read.as_chunks().0.iter().map(|&four| f32::from_le_bytes(four)).collect();
        assert_eq!(floats, values.concat());
    }

    #[test]
    fn what_it_claims_must_fit_its_bytes() {
        for (mode, filter, count, stride) in [
            ("ATTRIBUTES", None, u64::MAX, 16),
            ("ATTRIBUTES", None, 1 << 40, 256),
            ("ATTRIBUTES", None, 4, 6),
            ("ATTRIBUTES", None, 4, 0),
            ("ATTRIBUTES", None, 4, 260),
            ("TRIANGLES", None, 4, 4),
            ("TRIANGLES", None, 3 << 40, 4),
            ("INDICES", None, 1 << 40, 2),
            ("INDICES", None, 4, 1),
            ("OTHER", None, 4, 4),
            ("ATTRIBUTES", None, 4, 4),
        ] {
            assert!(read(&packed(mode, filter, count, stride), &[0; 64]).is_err(), "{mode} {count} {stride}");
        }
        let bytes = encode_vertex_buffer(&[[1u32; 3]; 4]).unwrap();
        for (filter, stride) in [("OCTAHEDRAL", 12), ("QUATERNION", 12), ("COLOR", 12), ("OTHER", 12)] {
            assert!(read(&packed("ATTRIBUTES", Some(filter), 4, stride), &bytes).is_err(), "{filter}");
        }
    }

    proptest! {
        #[test]
        fn vertices_come_back(elements in prop::collection::vec(any::<[u32; 5]>(), 1..600)) {
            let bytes = encode_vertex_buffer(&elements).unwrap();
            let read = read(&packed("ATTRIBUTES", None, elements.len() as u64, 20), &bytes).unwrap();
            let written: Vec<u8> = elements.concat().into_iter().flat_map(u32::to_ne_bytes).collect();
            prop_assert_eq!(read, written);
        }

        #[test]
        fn indices_come_back(indices in prop::collection::vec(0..60_000u32, 1..600)) {
            let bytes = encode_index_sequence(&indices, 60_000).unwrap();
            let read = read(&packed("INDICES", None, indices.len() as u64, 4), &bytes).unwrap();
            let written: Vec<u8> = indices.into_iter().flat_map(u32::to_le_bytes).collect();
            prop_assert_eq!(read, written);
        }

        #[test]
        fn damage_does_no_harm(
            at in any::<prop::sample::Index>(), byte in any::<u8>(), count in 0..900u64, stride in 0..70u64,
        ) {
            let mut bytes = encode_vertex_buffer(&[[7u32, 8, 9]; 300]).unwrap();
            let at = at.index(bytes.len());
            bytes[at] = byte;
            for mode in ["ATTRIBUTES", "TRIANGLES", "INDICES"] {
                if let Ok(read) = read(&packed(mode, None, count, 4 * stride), &bytes) {
                    prop_assert_eq!(read.len() as u64, count * 4 * stride);
                }
            }
        }
    }
}
