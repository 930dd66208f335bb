//! The bytes that a glTF document refers to: in the container, in data URIs, or in files beside it.

use std::path::Path;
use std::sync::Arc;

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use super::GltfError;
use super::json::Buffer;
use crate::import::budget::Budget;
use crate::import::neighbours::{Neighbours, NotThere};

/// Exporters differ on padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The bytes of a buffer.
#[derive(Debug)]
pub(super) enum Bytes<'a> {
    /// In the container.
    Within(&'a [u8]),
    /// From elsewhere: a file may be the bytes of several buffers.
    Shared { bytes: Arc<Vec<u8>>, length: usize },
}

impl Bytes<'_> {
    pub(super) fn as_slice(&self) -> &[u8] {
        match self {
            Self::Within(bytes) => bytes,
            Self::Shared { bytes, length } => bytes.get(..*length).unwrap_or_default(),
        }
    }
}

/// Loads all buffers of a document; each is exactly as long as the document says.
pub(super) fn load<'a>(
    document: Option<&Path>,
    buffers: &[Buffer],
    bin: Option<&'a [u8]>,
    budget: &Budget,
) -> Result<Vec<Bytes<'a>>, GltfError> {
    let mut neighbours = Neighbours::of(document, budget);
    let load = |(index, buffer): (usize, &Buffer)| {
        let malformed = |what| GltfError::Buffer { buffer: index, what };
        let too_short = malformed("it has fewer bytes than the document says");
        let Ok(length) = usize::try_from(buffer.byte_length) else { return Err(too_short) };
        match (&buffer.uri, bin) {
            (Some(uri), _) => {
                let bytes = fetch(&mut neighbours, index, uri)?;
                if length <= bytes.len() { Ok(Bytes::Shared { bytes, length }) } else { Err(too_short) }
            }
            (None, Some(bin)) if index == 0 => bin.get(..length).map(Bytes::Within).ok_or(too_short),
            (None, _) => Err(malformed("it has no address, and the file no bytes for it")),
        }
    };
    buffers.iter().enumerate().map(load).collect()
}

fn fetch(neighbours: &mut Neighbours<'_>, buffer: usize, uri: &str) -> Result<Arc<Vec<u8>>, GltfError> {
    let malformed = |what| GltfError::Buffer { buffer, what };
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or(malformed("its data URI has no comma"))?;
        return Ok(Arc::new(if kind.ends_with(";base64") {
            BASE64.decode(data).map_err(|_| malformed("its data URI is not base64"))?
        } else {
            percent_decode_str(data).collect()
        }));
    }
    let name = percent_decode_str(uri).decode_utf8().map_err(|_| malformed("its address is not UTF-8"))?;
    match neighbours.read(Path::new(name.as_ref())) {
        Ok((bytes, _)) => Ok(bytes),
        Err(NotThere::Elsewhere) => {
            Err(malformed("its address leads out of the document's folder; put the buffer beside it"))
        }
        Err(NotThere::Unread(path, source)) => Err(GltfError::BufferFile { buffer, path, source }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::ImportLimits;

    fn budget() -> Budget {
        Budget::new(ImportLimits::default())
    }

    fn load_one(uri: Option<&str>, byte_length: u64) -> Result<Vec<u8>, GltfError> {
        let buffer = Buffer { uri: uri.map(str::to_owned), byte_length };
        let loaded = load(Some(Path::new("no-such-folder/a.gltf")), &[buffer], Some(b"abc"), &budget())?;
        Ok(loaded[0].as_slice().to_vec())
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

    #[test]
    fn a_file_that_many_buffers_name_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.bin"), b"abcd").unwrap();
        let buffer = |uri: &str, byte_length| Buffer { uri: Some(uri.to_owned()), byte_length };
        let buffers = [buffer("a.bin", 4), buffer("./a.bin", 2), buffer("a.bin", 5)];
        let load = |buffers| load(Some(&folder.path().join("a.gltf")), buffers, None, &budget());
        let loaded = load(&buffers[..2]).unwrap();
        assert_eq!(loaded.iter().map(Bytes::as_slice).collect::<Vec<_>>(), [&b"abcd"[..], b"ab"]);
        assert!(matches!(loaded.as_slice(), [Bytes::Shared { bytes: a, .. }, Bytes::Shared { bytes: b, .. }]
            if Arc::ptr_eq(a, b)));
        assert!(matches!(load(&buffers), Err(GltfError::Buffer { buffer: 2, .. })));
    }
}
