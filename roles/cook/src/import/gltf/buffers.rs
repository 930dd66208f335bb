//! The bytes that a glTF document refers to: in the container, in data URIs, or in files beside it.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;
use thiserror::Error;

use super::GltfError;
use super::json::Buffer;
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

/// Loads all buffers of a document; each is exactly as long as the document says. One that only stands for
/// bytes that others have compressed may be empty.
pub(super) fn load<'a>(
    resources: &mut Resources<'_, '_>,
    buffers: &[Buffer],
    bin: Option<&'a [u8]>,
) -> Result<Vec<Bytes<'a>>, GltfError> {
    let load = |(index, buffer): (usize, &Buffer)| {
        let malformed = |what| GltfError::Buffer { buffer: index, what };
        let too_short = malformed("it has fewer bytes than the document says");
        let Ok(length) = usize::try_from(buffer.byte_length) else { return Err(too_short) };
        match (&buffer.uri, bin) {
            _ if buffer.is_fallback() => Ok(Bytes::Within(&[])),
            (Some(uri), _) => {
                let bytes = resources.fetch(uri).map_err(|fault| fault.of_buffer(index))?;
                if length <= bytes.len() { Ok(Bytes::Shared { bytes, length }) } else { Err(too_short) }
            }
            (None, Some(bin)) if index == 0 => bin.get(..length).map(Bytes::Within).ok_or(too_short),
            (None, _) => Err(malformed("it has no address, and the file no bytes for it")),
        }
    };
    buffers.iter().enumerate().map(load).collect()
}

/// What a document refers to by an address: data URIs, and files beside it.
pub(super) struct Resources<'n, 'b>(pub &'n mut Neighbours<'b>);

/// Why an address leads to nothing.
#[derive(Debug, Error)]
pub(super) enum ResourceFault {
    #[error("{0}")]
    Malformed(&'static str),
    #[error("cannot read {path}: {source}", path = .0.display(), source = .1)]
    Unread(PathBuf, io::Error),
}

impl ResourceFault {
    fn of_buffer(self, buffer: usize) -> GltfError {
        match self {
            Self::Malformed(what) => GltfError::Buffer { buffer, what },
            Self::Unread(path, source) => GltfError::BufferFile { buffer, path, source },
        }
    }
}

impl Resources<'_, '_> {
    /// The bytes at an address. Addresses are percent-encoded, but some exporters write names as they are, and
    /// some write the backslashes of Windows.
    pub(super) fn fetch(&mut self, uri: &str) -> Result<Arc<Vec<u8>>, ResourceFault> {
        use ResourceFault::{Malformed, Unread};
        if let Some(data) = uri.strip_prefix("data:") {
            let (kind, data) = data.split_once(',').ok_or(Malformed("its data URI has no comma"))?;
            return Ok(Arc::new(if kind.ends_with(";base64") {
                BASE64.decode(data).map_err(|_| Malformed("its data URI is not base64"))?
            } else {
                percent_decode_str(data).collect()
            }));
        }
        let decoded = percent_decode_str(uri).decode_utf8_lossy();
        let names = [decoded.to_string(), decoded.replace('\\', "/"), uri.to_owned()];
        let mut first = None;
        for name in names {
            match self.0.read(Path::new(&name)) {
                Ok((bytes, _)) => return Ok(bytes),
                Err(NotThere::Elsewhere) => {
                    first.get_or_insert(Malformed(
                        "its address leads out of the document's folder; put the file beside it",
                    ));
                }
                Err(NotThere::Unread(path, source)) => {
                    first.get_or_insert(Unread(path, source));
                }
            }
        }
        Err(first.unwrap_or(Malformed("it has no address")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::ImportLimits;
    use crate::import::budget::Budget;

    fn load_at<'a>(
        path: &Path,
        buffers: &[Buffer],
        bin: Option<&'a [u8]>,
    ) -> Result<Vec<Bytes<'a>>, GltfError> {
        let budget = Budget::new(ImportLimits::default());
        let mut neighbours = Neighbours::of(Some(path), &budget);
        load(&mut Resources(&mut neighbours), buffers, bin)
    }

    fn buffer(uri: Option<&str>, byte_length: u64) -> Buffer {
        Buffer { uri: uri.map(str::to_owned), byte_length, extensions: None }
    }

    fn load_one(uri: Option<&str>, byte_length: u64) -> Result<Vec<u8>, GltfError> {
        let loaded = load_at(Path::new("no-such-folder/a.gltf"), &[buffer(uri, byte_length)], Some(b"abc"))?;
        Ok(loaded[0].as_slice().to_vec())
    }

    #[test]
    fn what_only_stands_for_compressed_bytes_needs_none() {
        let json = r#"{"byteLength":99,"extensions":{"EXT_meshopt_compression":{"fallback":true}}}"#;
        let fallback: Buffer = serde_json::from_str(json).unwrap();
        let loaded = load_at(Path::new("a.gltf"), &[fallback], None).unwrap();
        assert_eq!(loaded[0].as_slice(), b"");
    }

    #[test]
    fn names_are_found_encoded_or_not_and_with_backslashes() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("buf dir")).unwrap();
        std::fs::write(folder.path().join("buf dir/a.bin"), b"abcd").unwrap();
        std::fs::write(folder.path().join("50%25.bin"), b"efgh").unwrap();
        let path = folder.path().join("a.gltf");
        for (uri, bytes) in [
            ("buf dir/a.bin", b"abcd"),
            ("buf%20dir/a.bin", b"abcd"),
            (r"buf dir\a.bin", b"abcd"),
            (r".\buf%20dir\a.bin", b"abcd"),
            ("50%25.bin", b"efgh"),
        ] {
            let loaded = load_at(&path, &[buffer(Some(uri), 4)], None).unwrap();
            assert_eq!(loaded[0].as_slice(), bytes, "{uri}");
        }
        for uri in [r"..\a.bin", r"buf dir\..\..\a.bin", r"C:\a.bin", "buf%20dir%2F..%2F..%2Fa"] {
            let loaded = load_at(&path, &[buffer(Some(uri), 4)], None);
            assert!(loaded.is_err(), "{uri}");
        }
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
        let named = |uri: &str, byte_length| buffer(Some(uri), byte_length);
        let buffers = [named("a.bin", 4), named("./a.bin", 2), named("a.bin", 5)];
        let path = folder.path().join("a.gltf");
        let load = |buffers| load_at(&path, buffers, None);
        let loaded = load(&buffers[..2]).unwrap();
        assert_eq!(loaded.iter().map(Bytes::as_slice).collect::<Vec<_>>(), [&b"abcd"[..], b"ab"]);
        assert!(matches!(loaded.as_slice(), [Bytes::Shared { bytes: a, .. }, Bytes::Shared { bytes: b, .. }]
            if Arc::ptr_eq(a, b)));
        assert!(matches!(load(&buffers), Err(GltfError::Buffer { buffer: 2, .. })));
    }
}
