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
    /// Takes a file apart (glTF 2.0 specification, section 4). Skips chunks of other kinds, as required. The
    /// chunks determine the length, whatever the header says, and bytes behind them are ignored.
    pub(super) fn parse(file: &'a [u8]) -> Result<Self, GltfError> {
        if !file.starts_with(b"glTF") {
            return Ok(Self { json: bare(file), bin: None });
        }
        let malformed = |offset, what| GltfError::Container { offset, what };
        let version = u32_at(file, 4).ok_or(malformed(4, "it ends within the header"))?;
        if version != 2 {
            return Err(GltfError::Version { version: format!("{version}.0") });
        }
        let said = u32_at(file, 8).ok_or(malformed(8, "it ends within the header"))? as usize;

        let (mut json, mut bin) = (None, None);
        let mut offset = HEADER;
        while offset < file.len() {
            let length = u32_at(file, offset).unwrap_or(u32::MAX) as usize;
            let kind = file.get(offset + 4..offset + 8).unwrap_or_default();
            match file.get(offset + 8..).and_then(|rest| rest.get(..length)) {
                Some(chunk) if kind == JSON && json.is_none() => json = Some(bare(chunk)),
                Some(chunk) if kind == BIN && bin.is_none() => bin = Some(chunk),
                Some(_) => {}
                None if kind == JSON || kind == BIN || said > file.len() || json.is_none() => {
                    return Err(malformed(offset, "a chunk is longer than what is left of the file"));
                }
                None => break,
            }
            offset = offset.saturating_add(8).saturating_add(length);
        }
        let json = json.ok_or(malformed(HEADER, "it has no JSON chunk"))?;
        Ok(Self { json, bin })
    }
}

/// JSON without added bytes: a byte order mark, and zeros to fill a chunk.
fn bare(json: &[u8]) -> &[u8] {
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    let end =
        json.iter().rposition(|byte| *byte != 0 && !byte.is_ascii_whitespace()).map_or(0, |last| last + 1);
    json.get(..end).unwrap_or(json)
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
        assert_eq!((parts.json, parts.bin), (&b"{}"[..], Some(&b"\x01\x02"[..])));
    }

    #[test]
    fn every_truncation_is_refused_or_lacks_the_bytes() {
        let file = glb(&[(b"JSON", b"{}"), (b"BIN\0", b"\x01\x02")]);
        for end in 4..file.len() {
            assert!(
                Container::parse(&file[..end]).is_ok_and(|parts| parts.bin.is_none()) == (end == 22),
                "{end}"
            );
        }
    }

    #[test]
    fn whole_chunks_are_read_whatever_the_header_says_and_whatever_is_around_them() {
        let sound = glb(&[(b"JSON", b"\xEF\xBB\xBF{}\0\0 \0"), (b"BIN\0", b"\x01\x02")]);
        for (length, behind) in
            [(0u32, &b""[..]), (3, b""), (20, b"\0\0"), (900, b""), (39, b"\x09\0\0\0TAIL\0")]
        {
            let mut file = [&sound, behind].concat();
            file[8..12].copy_from_slice(&length.to_le_bytes());
            let parts = Container::parse(&file).unwrap();
            assert_eq!((parts.json, parts.bin), (&b"{}"[..], Some(&b"\x01\x02"[..])), "{length} {behind:?}");
        }
    }

    #[test]
    fn another_version_is_named() {
        let mut file = glb(&[(b"JSON", b"{}")]);
        file[4] = 1;
        assert!(matches!(Container::parse(&file), Err(GltfError::Version { version }) if version == "1.0"));
    }
}
