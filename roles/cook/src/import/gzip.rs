//! Files packed with gzip.

use std::borrow::Cow;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use super::ImportError;

/// What every file that gzip packed begins with.
const MAGIC: &[u8] = b"\x1F\x8B";

/// The most bytes that a file of `packed` bytes may unpack to. Text of coordinates shrinks to a third; to a
/// sixtieth only what was made to.
const fn most(packed: usize) -> u64 {
    (64 << 20) + 64 * packed as u64
}

/// A file's name without `.gz` and its bytes as they were before gzip; or both as they are. Of packed files
/// only Wavefront OBJ is read.
pub(super) fn unpacked<'b>(path: &Path, bytes: &'b [u8]) -> Result<(PathBuf, Cow<'b, [u8]>), ImportError> {
    let owned = || path.to_owned();
    let named = ending(path).as_deref() == Some("gz");
    if !bytes.starts_with(MAGIC) {
        let magic = "the bytes 1F 8B";
        let wrong = ImportError::WrongMagic { path: owned(), expected: ".gz", magic };
        return if named { Err(wrong) } else { Ok((owned(), Cow::Borrowed(bytes))) };
    }
    let mut inner = if named { path.with_extension("") } else { owned() };
    match ending(&inner).as_deref() {
        Some("obj") => Ok((inner, Cow::Owned(unpack(path, bytes)?))),
        Some("glb" | "gltf" | "rvm" | "rev") => Err(ImportError::Packed { path: owned() }),
        // `plant.gz` may be anything.
        _ if named => {
            let text = unpack(path, bytes)?;
            let other: [&[u8]; 3] = [b"glTF", b"{", b"\0\0\0H"];
            if other.iter().any(|magic| text.starts_with(magic)) {
                return Err(ImportError::Packed { path: owned() });
            }
            if !text.starts_with(b"v ") && !text.windows(3).any(|start| start == b"\nv ") {
                return Err(ImportError::UnknownFormat { path: owned() });
            }
            inner.as_mut_os_string().push(".obj");
            Ok((inner, Cow::Owned(text)))
        }
        _ => Err(ImportError::UnknownFormat { path: owned() }),
    }
}

fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase())
}

fn unpack(path: &Path, bytes: &[u8]) -> Result<Vec<u8>, ImportError> {
    let limit = most(bytes.len());
    let mut text = Vec::new();
    let read = MultiGzDecoder::new(bytes).take(limit + 1).read_to_end(&mut text);
    read.map_err(|source| ImportError::Unpack { path: path.to_owned(), source })?;
    if text.len() as u64 > limit {
        return Err(ImportError::UnpacksToMore { path: path.to_owned(), limit });
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    fn packed(text: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    }

    fn said(name: &str, bytes: &[u8]) -> String {
        unpacked(Path::new(name), bytes).unwrap_err().to_string()
    }

    #[test]
    fn obj_is_unpacked_whatever_its_name_says_of_gzip() {
        let text = b"v 0 0 0\n";
        // Several streams one behind the other are one file.
        let twice = [packed(text), packed(text)].concat();
        for (name, inner) in
            [("a.obj.gz", "a.obj"), ("b/A.OBJ.GZ", "b/A.OBJ"), ("a.gz", "a.obj"), ("a.obj", "a.obj")]
        {
            let (name, bytes) = unpacked(Path::new(name), &twice).unwrap();
            assert_eq!((name.as_path(), &*bytes), (Path::new(inner), &*text.repeat(2)));
        }
        let (name, bytes) = unpacked(Path::new("a.rvm"), b"HEAD").unwrap();
        assert_eq!((name.as_path(), &*bytes), (Path::new("a.rvm"), &b"HEAD"[..]));
    }

    #[test]
    fn other_formats_are_told_to_be_unpacked() {
        let glb = packed(b"glTF");
        for name in ["a.glb.gz", "a.gz", "a.glb", "A.RVM.gz"] {
            let said = said(name, &glb);
            assert!(said.contains(name) && said.contains("gunzip"), "{said}");
        }
        let text = packed(b"a letter\n");
        assert!(said("a.gz", &text).contains("no known format"));
        assert!(said("a.step", &text).contains("no known format"));
        assert!(said("a.obj.gz", b"v 0 0 0\n").contains("1F 8B"));
    }

    #[test]
    fn what_is_cut_off_or_unpacks_to_too_much_is_refused() {
        let file = packed(&b"v 0 0 0\n".repeat(100));
        assert!(said("a.obj.gz", &file[..file.len() - 9]).contains("get it again"));
        let bomb = packed(&vec![b' '; 80 << 20]);
        assert!(most(bomb.len()) < 80 << 20, "{}", bomb.len());
        assert!(said("a.obj.gz", &bomb).contains("unpacks to more than"));
    }
}
