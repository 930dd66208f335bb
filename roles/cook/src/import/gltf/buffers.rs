//! Loads the bytes that a glTF document refers to: in the container, in data URIs, or in files beside it.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;
use thiserror::Error;

use super::GltfError;
use super::faults::Faults;
use super::json::Buffer;
use crate::import::neighbours::{Neighbours, NotThere};
use crate::import::report::WarningKind;

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
    /// From elsewhere: several buffers may share a file.
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

/// Loads all buffers of a document. A missing one is empty, and a short one has the bytes that exist: the
/// reader of missing bytes leaves its part out. A fallback buffer of compressed data may be empty.
pub(super) fn load<'a>(
    resources: &mut Resources<'_, '_>,
    buffers: &[Buffer],
    bin: Option<&'a [u8]>,
    faults: &mut Faults,
) -> Vec<Bytes<'a>> {
    let mut load = |(index, buffer): (usize, &Buffer)| {
        let length = usize::try_from(buffer.byte_length).unwrap_or(usize::MAX);
        let bytes = match (&buffer.uri, bin) {
            _ if buffer.is_fallback() => return Bytes::Within(&[]),
            (Some(uri), _) => match resources.fetch(uri) {
                Ok(bytes) => Bytes::Shared { length: length.min(bytes.len()), bytes },
                Err(fault) => {
                    faults.note(WarningKind::BytesLeftOut, &fault.to_string(), &format!("buffer {index}"));
                    faults.cause(|| fault.of_buffer(index));
                    return Bytes::Within(&[]);
                }
            },
            (None, Some(bin)) if index == 0 => Bytes::Within(bin.get(..length).unwrap_or(bin)),
            (None, _) => {
                let what = "it has no address, and the file no bytes for it";
                faults.note(WarningKind::BytesLeftOut, what, &format!("buffer {index}"));
                faults.cause(|| GltfError::Buffer { buffer: index, what });
                return Bytes::Within(&[]);
            }
        };
        if bytes.as_slice().len() < length {
            let what = "it has fewer bytes than the document says";
            faults.cause(|| GltfError::Buffer { buffer: index, what });
        }
        bytes
    };
    buffers.iter().enumerate().map(&mut load).collect()
}

/// The targets of a document's URIs: data URIs, and files beside it.
pub(super) struct Resources<'n, 'b>(pub &'n mut Neighbours<'b>);

/// Why a URI cannot be loaded.
#[derive(Debug, Error)]
pub(super) enum ResourceFault {
    #[error("{0}")]
    Malformed(&'static str),
    #[error("cannot read {0}: {1}")]
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
    /// The bytes at a URI. URIs are percent-encoded, but some exporters write plain names, Windows
    /// backslashes, or whole paths of their machine: then the file of that name beside the document is meant.
    pub(super) fn fetch(&mut self, uri: &str) -> Result<Arc<Vec<u8>>, ResourceFault> {
        use ResourceFault::{Malformed, Unread};
        let uri = uri.trim();
        if is_data(uri) {
            let (kind, data) = uri.split_once(',').ok_or(Malformed("its data URI has no comma"))?;
            let data: Vec<u8> = percent_decode_str(data).collect();
            let is_base64 = kind.to_ascii_lowercase().trim_end().ends_with(";base64");
            return Ok(Arc::new(if is_base64 { from_base64(data)? } else { data }));
        }
        let plain = uri.split(['?', '#']).next().unwrap_or(uri);
        let [decoded, plain] =
            [uri, plain].map(|uri| percent_decode_str(uri).decode_utf8_lossy().replace('\\', "/"));
        let last = plain.rsplit('/').next().unwrap_or_default().to_owned();
        let exact = percent_decode_str(uri).decode_utf8_lossy().into_owned();
        let mut first = None;
        for name in [exact, without_detours(&decoded), uri.to_owned(), without_detours(&plain), last] {
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

/// Whether a URI contains the bytes themselves.
pub(super) fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// Bytes of base64 of either alphabet, in lines or not, padded or not.
fn from_base64(mut data: Vec<u8>) -> Result<Vec<u8>, ResourceFault> {
    data.retain(|byte| !byte.is_ascii_whitespace());
    for byte in &mut data {
        *byte = match *byte {
            b'-' => b'+',
            b'_' => b'/',
            other => other,
        };
    }
    let end = data.iter().rposition(|byte| *byte != b'=').map_or(0, |last| last + 1);
    data.truncate(end);
    BASE64.decode(data).map_err(|_| ResourceFault::Malformed("its data URI is not base64"))
}

/// A name without redundant folders: `a/../b` is `b`.
fn without_detours(name: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in name.split('/') {
        match (part, parts.last()) {
            ("..", Some(last)) if !matches!(*last, ".." | "." | "") => {
                parts.pop();
            }
            _ => parts.push(part),
        }
    }
    parts.join("/")
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
        let mut faults = Faults::default();
        let loaded = load(&mut Resources(&mut neighbours), buffers, bin, &mut faults);
        faults.first().map_or(Ok(loaded), Err)
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
        std::fs::write(folder.path().join("top.bin"), b"ijkl").unwrap();
        let path = folder.path().join("a.gltf");
        for (uri, bytes) in [
            ("buf dir/a.bin", b"abcd"),
            ("buf%20dir/a.bin", b"abcd"),
            (r"buf dir\a.bin", b"abcd"),
            (r".\buf%20dir\a.bin", b"abcd"),
            ("50%25.bin", b"efgh"),
            ("top.bin?version=1", b"ijkl"),
            ("buf dir/../buf dir/a.bin", b"abcd"),
            (r"C:\Users\me\top.bin", b"ijkl"),
            ("file:///home/me/top.bin", b"ijkl"),
            ("/home/me/top.bin", b"ijkl"),
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
        for uri in [
            "data:;base64,AQIDBA==",
            "data:application/octet-stream;base64,AQIDBA",
            "data:,%01%02%03%04",
            "DATA:x/y;charset=utf-8;BASE64, AQ\nID\tBA%3D%3D",
            "data:;base64,AQIDBA=====",
        ] {
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
