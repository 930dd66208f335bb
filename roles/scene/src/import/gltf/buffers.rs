//! The bytes that a glTF document refers to: in the container, in data URIs, or in files beside it.

use std::borrow::Cow;
use std::path::Path;

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use super::GltfError;
use super::json::Buffer;
use crate::import::format::{beside, read};

/// Exporters differ on padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Loads all buffers of a document; each is exactly as long as the document says.
pub(super) fn load<'a>(
    document: &Path,
    buffers: &[Buffer],
    bin: Option<&'a [u8]>,
) -> Result<Vec<Cow<'a, [u8]>>, GltfError> {
    buffers
        .iter()
        .enumerate()
        .map(|(index, buffer)| {
            let malformed = |what| GltfError::Buffer { buffer: index, what };
            let bytes = match (&buffer.uri, bin) {
                (Some(uri), _) => Cow::Owned(fetch(document, index, uri)?),
                (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
                (None, _) => return Err(malformed("it has no address, and the file no bytes for it")),
            };
            let length = usize::try_from(buffer.byte_length).ok().filter(|&length| length <= bytes.len());
            let length = length.ok_or(malformed("it has fewer bytes than the document says"))?;
            Ok(match bytes {
                Cow::Borrowed(slice) => Cow::Borrowed(slice.get(..length).unwrap_or_default()),
                Cow::Owned(mut vec) => {
                    vec.truncate(length);
                    Cow::Owned(vec)
                }
            })
        })
        .collect()
}

fn fetch(document: &Path, buffer: usize, uri: &str) -> Result<Vec<u8>, GltfError> {
    let malformed = |what| GltfError::Buffer { buffer, what };
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or(malformed("its data URI has no comma"))?;
        return if kind.ends_with(";base64") {
            BASE64.decode(data).map_err(|_| malformed("its data URI is not base64"))
        } else {
            Ok(percent_decode_str(data).collect())
        };
    }
    let name = percent_decode_str(uri).decode_utf8().map_err(|_| malformed("its address is not UTF-8"))?;
    let path = beside(document, Path::new(name.as_ref()))
        .ok_or(malformed("its address leads out of the document's folder; put the buffer beside it"))?;
    read(&path).map_err(|source| GltfError::BufferFile { buffer, path, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load_one(uri: Option<&str>, byte_length: u64) -> Result<Vec<u8>, GltfError> {
        let buffer = Buffer { uri: uri.map(str::to_owned), byte_length };
        let loaded = load(Path::new("no-such-folder/a.gltf"), &[buffer], Some(b"abc"))?;
        Ok(loaded[0].to_vec())
    }

    #[test]
    fn the_container_holds_the_buffer_without_an_address() {
        assert_eq!(load_one(None, 2).unwrap(), b"ab");
        assert!(matches!(load_one(None, 4), Err(GltfError::Buffer { buffer: 0, .. })));
    }

    #[test]
    fn data_uris_are_decoded_padded_or_not() {
        for uri in
            ["data:;base64,AQIDBA==", "data:application/octet-stream;base64,AQIDBA", "data:,%01%02%03%04"]
        {
            assert_eq!(load_one(Some(uri), 4).unwrap(), [1, 2, 3, 4], "{uri}");
        }
        for uri in ["data:;base64", "data:;base64,****"] {
            assert!(matches!(load_one(Some(uri), 1), Err(GltfError::Buffer { .. })), "{uri}");
        }
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = load_one(Some("my%20mesh.bin"), 1).unwrap_err();
        assert!(error.to_string().contains("no-such-folder/my mesh.bin"), "{error}");
    }

    #[test]
    fn addresses_that_lead_elsewhere_are_refused() {
        for uri in
            ["/etc/passwd", "../secret.bin", "a/../../secret.bin", "https://example.org/a.bin", "%2e%2e/a"]
        {
            assert!(matches!(load_one(Some(uri), 1), Err(GltfError::Buffer { .. })), "{uri}");
        }
    }
}
