//! Files packed with gzip.

use std::borrow::Cow;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::bufread::GzDecoder;

use super::ImportError;
use super::format::ending;

/// The first bytes of every gzip file.
const MAGIC: &[u8] = b"\x1F\x8B";

/// The largest unpacked size of a file of `packed` bytes. Text of coordinates shrinks to a third; only
/// malicious files shrink to a sixtieth.
const fn most(packed: usize) -> u64 {
    (64 << 20) + 64 * packed as u64
}

/// A file before packing by gzip.
pub(super) struct Unpacked<'b> {
    /// Its name without `.gz`.
    pub name: PathBuf,
    pub bytes: Cow<'b, [u8]>,
    /// The number of bytes behind the packed data, unless they are padding.
    pub behind: usize,
}

/// The endings of formats that are read packed.
const READ_PACKED: [&str; 10] = ["obj", "stl", "ply", "step", "stp", "stpz", "p21", "iges", "igs", "ifc"];

/// The formats that are known by their first bytes.
const KNOWN: [(&str, &[u8]); 4] =
    [("step", b"ISO-10303-21"), ("ply", b"ply"), ("stl", b"solid"), ("obj", b"v ")];

/// A file before gzip, if it is packed.
pub(super) fn unpacked<'b>(path: &Path, bytes: &'b [u8]) -> Result<Unpacked<'b>, ImportError> {
    let owned = || path.to_owned();
    let named = ending(path).as_deref() == Some("gz");
    let mut inner = if named { path.with_extension("") } else { owned() };
    if !bytes.starts_with(MAGIC) {
        // Browsers unpack downloads, and keep the name.
        if named && !is_read_packed(&inner) {
            let magic = "the bytes 1F 8B";
            return Err(ImportError::WrongMagic { path: owned(), expected: ".gz", magic });
        }
        return Ok(Unpacked { name: inner, bytes: Cow::Borrowed(bytes), behind: 0 });
    }
    let of = |name, (text, behind)| Unpacked { name, bytes: Cow::Owned(text), behind };
    match ending(&inner).as_deref() {
        _ if is_read_packed(&inner) => Ok(of(inner, unpack(path, bytes)?)),
        Some("glb" | "gltf" | "rvm" | "rev") => Err(ImportError::Packed { path: owned() }),
        // `plant.gz` may be anything.
        _ if named => {
            let (text, behind) = unpack(path, bytes)?;
            let other: [&[u8]; 3] = [b"glTF", b"{", b"\0\0\0H"];
            if other.iter().any(|magic| text.starts_with(magic)) {
                return Err(ImportError::Packed { path: owned() });
            }
            let begins = |start: &[u8]| text.starts_with(start);
            let is_obj = || text.windows(3).any(|start| start == b"\nv ");
            let found = KNOWN.iter().find(|(ending, start)| begins(start) || *ending == "obj" && is_obj());
            let Some((ending, _)) = found else { return Err(ImportError::UnknownFormat { path: owned() }) };
            inner.as_mut_os_string().push(".");
            inner.as_mut_os_string().push(ending);
            Ok(of(inner, (text, behind)))
        }
        _ => Err(ImportError::UnknownFormat { path: owned() }),
    }
}

fn is_read_packed(path: &Path) -> bool {
    ending(path).is_some_and(|ending| READ_PACKED.contains(&&*ending))
}

/// The unpacked data, and the number of significant bytes behind it. Several consecutive streams are one
/// file; anything else is padding, or was added in transfer.
fn unpack(path: &Path, bytes: &[u8]) -> Result<(Vec<u8>, usize), ImportError> {
    let limit = most(bytes.len());
    let mut text = Vec::new();
    let mut rest = bytes;
    loop {
        let mut stream = GzDecoder::new(rest);
        if rest.len() < bytes.len() && stream.header().is_none() {
            let is_padding = rest.iter().all(|&byte| byte == 0);
            return Ok((text, if is_padding { 0 } else { rest.len() }));
        }
        let room = (limit + 1).saturating_sub(text.len() as u64);
        let read = stream.by_ref().take(room).read_to_end(&mut text);
        read.map_err(|source| ImportError::Unpack { path: path.to_owned(), source })?;
        if text.len() as u64 > limit {
            return Err(ImportError::UnpacksToMore { path: path.to_owned(), limit });
        }
        rest = stream.into_inner();
    }
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
        unpacked(Path::new(name), bytes).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn obj_is_unpacked_whatever_its_name_says_of_gzip() {
        let text = b"v 0 0 0\n";
        // Several consecutive streams are one file.
        let twice = [packed(text), packed(text)].concat();
        for (name, inner) in
            [("a.obj.gz", "a.obj"), ("b/A.OBJ.GZ", "b/A.OBJ"), ("a.gz", "a.obj"), ("a.obj", "a.obj")]
        {
            let Unpacked { name, bytes, behind } = unpacked(Path::new(name), &twice).unwrap();
            assert_eq!((name.as_path(), &*bytes, behind), (Path::new(inner), &*text.repeat(2), 0));
        }
        let Unpacked { name, bytes, .. } = unpacked(Path::new("a.rvm"), b"HEAD").unwrap();
        assert_eq!((name.as_path(), &*bytes), (Path::new("a.rvm"), &b"HEAD"[..]));
        // A browser unpacked it.
        let Unpacked { name, bytes, .. } = unpacked(Path::new("a.obj.gz"), text).unwrap();
        assert_eq!((name.as_path(), &*bytes), (Path::new("a.obj"), &text[..]));
    }

    #[test]
    fn what_stands_behind_a_packed_file_is_counted_unless_it_is_zeros() {
        let text = b"v 0 0 0\n";
        for (more, counted) in [
            (&b"\0\0\0"[..], 0),
            (b"\n", 1),
            (b"more text", 9),
            (b"\x1f", 1),
            (b"\x1f\x8b", 2),
            (b"\x1f\x8bxyz", 5),
        ] {
            let file = [&*packed(text), more].concat();
            let Unpacked { bytes, behind, .. } = unpacked(Path::new("a.obj.gz"), &file).unwrap();
            assert_eq!((&*bytes, behind), (&text[..], counted), "{more:?}");
        }
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
        assert!(said("a.doc", &text).contains("no known format"));
        assert!(said("a.gz", b"v 0 0 0\n").contains("1F 8B"));
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
