//! The binary container of glTF: a header, a chunk of JSON, and perhaps a chunk of bytes.

use super::GltfError;

/// A .glb file taken apart, or a .gltf file, which is all JSON.
pub(super) struct Container<'a> {
    pub json: &'a [u8],
    pub bin: Option<&'a [u8]>,
}

const HEADER: usize = 12;
const JSON: &[u8] = b"JSON";
const BIN: &[u8] = b"BIN\0";

impl<'a> Container<'a> {
    /// Takes a file apart (glTF 2.0 specification, section 4). Chunks of other kinds are skipped, as it
    /// demands.
    pub(super) fn parse(file: &'a [u8]) -> Result<Self, GltfError> {
        if !file.starts_with(b"glTF") {
            return Ok(Self { json: file.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(file), bin: None });
        }
        let malformed = |offset, what| GltfError::Container { offset, what };
        let version = u32_at(file, 4).ok_or(malformed(4, "it ends within the header"))?;
        if version != 2 {
            return Err(GltfError::Version { version: format!("{version}.0") });
        }
        let length = u32_at(file, 8).ok_or(malformed(8, "it ends within the header"))?;
        let body = file.get(..length as usize).ok_or(malformed(8, "it is shorter than its header says"))?;

        let mut json = None;
        let mut bin = None;
        let mut offset = HEADER;
        while offset < body.len() {
            let length = u32_at(body, offset).ok_or(malformed(offset, "it ends within a chunk's header"))?;
            let chunk = body.get(offset + 8..).and_then(|rest| rest.get(..length as usize));
            let chunk = chunk.ok_or(malformed(offset, "a chunk is longer than what is left of the file"))?;
            match body.get(offset + 4..offset + 8) {
                Some(JSON) if json.is_none() => json = Some(chunk),
                Some(BIN) if bin.is_none() => bin = Some(chunk),
                _ => {}
            }
            offset += 8 + length as usize;
        }
        let json = json.ok_or(malformed(HEADER, "it has no JSON chunk"))?;
        Ok(Self { json, bin })
    }
}

fn u32_at(bytes: &[u8], offset: usize) -> Option<u32> {
    let four = bytes.get(offset..)?.first_chunk()?;
    Some(u32::from_le_bytes(*four))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8], &[u8])]) -> Vec<u8> {
        let mut body = Vec::new();
        for (kind, data) in chunks {
            body.extend((data.len() as u32).to_le_bytes());
            body.extend(*kind);
            body.extend(*data);
        }
        let mut file = b"glTF\x02\0\0\0".to_vec();
        file.extend((12 + body.len() as u32).to_le_bytes());
        file.extend(body);
        file
    }

    #[test]
    fn chunks_are_found_and_foreign_ones_skipped() {
        let file = glb(&[(b"JSON", b"{} "), (b"XTRA", b"what"), (b"BIN\0", b"\x01\x02")]);
        let parts = Container::parse(&file).unwrap();
        assert_eq!((parts.json, parts.bin), (&b"{} "[..], Some(&b"\x01\x02"[..])));
    }

    #[test]
    fn every_truncation_is_refused() {
        let file = glb(&[(b"JSON", b"{}"), (b"BIN\0", b"\x01\x02")]);
        for end in 4..file.len() {
            assert!(Container::parse(&file[..end]).is_err(), "cut at {end}");
        }
    }

    #[test]
    fn a_header_that_claims_less_than_itself_is_refused() {
        let mut file = glb(&[(b"JSON", b"{}")]);
        file[8..12].copy_from_slice(&3u32.to_le_bytes());
        assert!(matches!(Container::parse(&file), Err(GltfError::Container { .. })));
    }

    #[test]
    fn another_version_is_named() {
        let mut file = glb(&[(b"JSON", b"{}")]);
        file[4] = 1;
        assert!(matches!(Container::parse(&file), Err(GltfError::Version { version }) if version == "1.0"));
    }
}
