//! The fingerprint of a scene: what peers compare, and what a file is checked against.

use rayon::prelude::*;
use trimaran_proto::SceneHash;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_128};

use super::Parts;

/// Bytes hashed as one piece. Pieces are hashed in parallel, so this is part of the definition of the
/// fingerprint.
pub(super) const PIECE: usize = 1 << 20;

/// XXH3-128 over, for each section in file order, its length in bytes (u64, little-endian) and the XXH3-128
/// (little-endian) of each of its pieces of 1 MiB.
pub(super) fn fingerprint(parts: &Parts<'_>) -> SceneHash {
    fingerprint_sections(&section_bytes(parts, &encode_sources(parts.sources)))
}

/// The sections' bytes in file order.
pub(super) fn section_bytes<'a>(parts: &Parts<'a>, sources: &'a [u8]) -> [&'a [u8]; 7] {
    [
        bytemuck::cast_slice(parts.nodes),
        bytemuck::cast_slice(parts.drawables),
        bytemuck::cast_slice(parts.vertices),
        bytemuck::cast_slice(parts.indices),
        bytemuck::cast_slice(parts.objects),
        parts.names,
        sources,
    ]
}

/// As [`fingerprint`], over the bytes of the sections.
pub(super) fn fingerprint_sections(sections: &[&[u8]]) -> SceneHash {
    let mut fingerprint = Fingerprint::new();
    for section in sections {
        let pieces: Vec<u128> = section.par_chunks(PIECE).map(piece).collect();
        fingerprint.section(section.len(), &pieces);
    }
    fingerprint.finish()
}

/// The hash of one piece.
pub(super) fn piece(bytes: &[u8]) -> u128 {
    xxh3_128(bytes)
}

/// A fingerprint in the making, section by section in file order.
pub(super) struct Fingerprint(Xxh3Default);

impl Fingerprint {
    pub(super) fn new() -> Self {
        Self(Xxh3Default::new())
    }

    /// Adds a section by its length and its pieces' hashes.
    pub(super) fn section(&mut self, length: usize, pieces: &[u128]) {
        self.0.update(&(length as u64).to_le_bytes());
        for piece in pieces {
            self.0.update(&piece.to_le_bytes());
        }
    }

    pub(super) fn finish(&self) -> SceneHash {
        SceneHash(self.0.digest128())
    }
}

/// The sources' names as bytes: each a length (u32, little-endian) and that many bytes of UTF-8.
pub(super) fn encode_sources(sources: &[String]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for source in sources {
        bytes.extend_from_slice(&(source.len() as u32).to_le_bytes());
        bytes.extend_from_slice(source.as_bytes());
    }
    bytes
}

/// The reverse of [`encode_sources`]; `None` if the bytes are not such a list.
pub(super) fn decode_sources(mut bytes: &[u8]) -> Option<Vec<String>> {
    let mut sources = Vec::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_first_chunk::<4>()?;
        let (name, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        sources.push(std::str::from_utf8(name).ok()?.to_owned());
        bytes = rest;
    }
    Some(sources)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_round_trip_and_cut_lists_are_refused() {
        let sources = vec!["a.RVM".to_owned(), String::new(), "für.glb".to_owned()];
        let bytes = encode_sources(&sources);
        assert_eq!(decode_sources(&bytes), Some(sources));
        for end in [1, 5, bytes.len() - 1] {
            assert_eq!(decode_sources(&bytes[..end]), None, "cut at {end}");
        }
    }

    #[test]
    fn the_border_between_sections_counts() {
        assert_ne!(fingerprint_sections(&[b"ab", b"c"]), fingerprint_sections(&[b"a", b"bc"]));
    }

    #[test]
    fn a_change_in_any_piece_changes_the_fingerprint() {
        let mut bytes = vec![7_u8; 2 * PIECE + 5];
        let before = fingerprint_sections(&[&bytes]);
        for index in [0, PIECE, 2 * PIECE + 4] {
            bytes[index] ^= 1;
            assert_ne!(fingerprint_sections(&[&bytes]), before, "byte {index}");
            bytes[index] ^= 1;
        }
    }
}
