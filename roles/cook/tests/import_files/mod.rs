//! Writers of small files for the tests of the importers.

use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;
use trimaran_cook::import::{ImportError, ImportOptions, Imported, import};

/// Imports one file with this name and these bytes.
pub(crate) fn import_bytes(name: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    import_beside(name, bytes, &[])
}

/// Imports a file that has others beside it.
pub(crate) fn import_beside(
    name: &str,
    bytes: &[u8],
    others: &[(&str, &[u8])],
) -> Result<Imported, ImportError> {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in others {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    let path: PathBuf = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    import(&[path], &ImportOptions::default(), &mut |_| {})
}

/// The names of the objects.
pub(crate) fn names(imported: &Imported) -> Vec<&str> {
    imported.model.objects.iter().map(|object| &*object.name).collect()
}

/// A .glb of this JSON and these bytes.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, data) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
        file.extend((data.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(data);
    }
    file
}

/// Little-endian bytes of floats.
pub(crate) fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Writes RVM files.
pub(crate) struct RvmWriter {
    bytes: Vec<u8>,
}

impl RvmWriter {
    /// A file with its head and model.
    pub(crate) fn new() -> Self {
        Self::in_encoding("Unicode UTF-8")
    }

    /// A file whose head names an encoding.
    pub(crate) fn in_encoding(encoding: &str) -> Self {
        let mut head = word(2);
        for text in ["test", "", "today", "me", encoding] {
            head.extend(string(text.as_bytes()));
        }
        let model = [word(1), string(b"project"), string(b"model")].concat();
        Self { bytes: Vec::new() }.chunk("HEAD", &head).chunk("MODL", &model)
    }

    /// Any chunk.
    pub(crate) fn chunk(mut self, id: &str, body: &[u8]) -> Self {
        self.bytes.extend(id.bytes().flat_map(|letter| [0, 0, 0, letter]));
        let next = self.bytes.len() + 8 + body.len();
        self.bytes.extend(word(next as u32));
        self.bytes.extend(word(1));
        self.bytes.extend(body);
        self
    }

    /// Opens a group.
    pub(crate) fn open(self, name: &str, material: u32) -> Self {
        self.open_bytes(name.as_bytes(), material)
    }

    /// Opens a group whose name may be in any encoding.
    pub(crate) fn open_bytes(self, name: &[u8], material: u32) -> Self {
        let body = [word(2), string(name), reals(&[0.0; 3]), word(material)].concat();
        self.chunk("CNTB", &body)
    }

    /// Opens a group of version 3, which has a transparency.
    pub(crate) fn open_transparent(self, name: &str, material: u32, percent: u8) -> Self {
        let rest = vec![percent, 0, 0, 0];
        let body = [word(3), string(name.as_bytes()), reals(&[0.0; 3]), word(material), rest].concat();
        self.chunk("CNTB", &body)
    }

    /// Closes a group.
    pub(crate) fn close(self) -> Self {
        self.chunk("CNTE", &word(1))
    }

    /// A primitive with the box `low` to `high`, placed at `place`, metres.
    pub(crate) fn primitive(
        self,
        kind: u32,
        place: [f32; 3],
        low: [f32; 3],
        high: [f32; 3],
        shape: &[u8],
    ) -> Self {
        let [x, y, z] = place;
        let matrix = reals(&[0.001, 0.0, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.001, x, y, z]);
        let body = [word(1), word(kind), matrix, reals(&low), reals(&high), shape.to_vec()].concat();
        self.chunk("PRIM", &body)
    }

    /// A box about `place`, its size in millimetres.
    pub(crate) fn cuboid(self, place: [f32; 3], size: [f32; 3]) -> Self {
        self.primitive(2, place, size.map(|side| -side / 2.0), size.map(|side| side / 2.0), &reals(&size))
    }

    /// The finished file.
    pub(crate) fn finish(self) -> Vec<u8> {
        self.chunk("END:", &word(1)).bytes
    }

    /// The file as it is so far.
    pub(crate) fn unfinished(self) -> Vec<u8> {
        self.bytes
    }
}

/// A big-endian word.
pub(crate) fn word(value: u32) -> Vec<u8> {
    value.to_be_bytes().to_vec()
}

/// Big-endian floats.
pub(crate) fn reals(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_be_bytes()).collect()
}

fn string(text: &[u8]) -> Vec<u8> {
    let mut bytes = word(text.len().div_ceil(4) as u32);
    bytes.extend(text);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}
