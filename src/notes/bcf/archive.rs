//! The zip archive of a BCF file. Nothing of it is written to the disk, and what it unpacks to is bounded.

use std::{
    collections::HashMap,
    io::{Cursor, Read, Write},
};

use zip::{CompressionMethod, ZipArchive, ZipWriter, write::SimpleFileOptions};

use super::{BcfError, xml::Element};

/// The most files, the most bytes of an XML file, and of all that is unpacked.
const FILES: usize = 50_000;
const LONGEST_XML: u64 = 16 << 20;
const MOST: u64 = 1 << 30;

/// An archive that is read.
#[derive(Debug)]
pub(super) struct Archive<'b> {
    zip: ZipArchive<Cursor<&'b [u8]>>,
    /// The files by their names, with slashes.
    files: HashMap<String, usize>,
    unpacked: u64,
}

impl<'b> Archive<'b> {
    pub(super) fn open(bytes: &'b [u8]) -> Result<Self, BcfError> {
        let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(BcfError::Zip)?;
        if zip.len() > FILES {
            return Err(BcfError::Files { files: zip.len(), most: FILES });
        }
        let mut files = HashMap::with_capacity(zip.len());
        for at in 0..zip.len() {
            let file = zip.by_index_raw(at).map_err(BcfError::Zip)?;
            // Some programs write the separators of Windows.
            let name = file.name().map_err(BcfError::Zip)?.replace('\\', "/");
            if name.starts_with('/') || name.contains(':') || name.split('/').any(|part| part == "..") {
                return Err(BcfError::Path(name));
            }
            if !name.ends_with('/') && files.insert(name.clone(), at).is_some() {
                return Err(BcfError::Twice(name));
            }
        }
        Ok(Self { zip, files, unpacked: 0 })
    }

    /// The names of its files, in order.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = self.files.keys().cloned().collect();
        names.sort_unstable();
        names
    }

    /// The bytes of a file, at most so many; `None` if it is not there.
    pub(super) fn bytes(&mut self, name: &str, most: u64) -> Result<Option<Vec<u8>>, BcfError> {
        let Some(at) = self.files.get(name) else { return Ok(None) };
        let entry = || name.to_owned();
        let file = self.zip.by_index(*at);
        let file = file.map_err(|cause| BcfError::Entry { entry: entry(), cause: cause.into() })?;
        let mut bytes = Vec::new();
        // The size that the archive states is only claimed.
        let read = file.take(most + 1).read_to_end(&mut bytes);
        read.map_err(|cause| BcfError::Entry { entry: entry(), cause: cause.into() })?;
        self.unpacked += bytes.len() as u64;
        if bytes.len() as u64 > most {
            return Err(BcfError::Size { entry: entry(), most });
        }
        if self.unpacked > MOST {
            return Err(BcfError::Size { entry: entry(), most: MOST });
        }
        Ok(Some(bytes))
    }

    /// The root of an XML file.
    pub(super) fn xml(&mut self, name: &str) -> Result<Element, BcfError> {
        let bytes = self.bytes(name, LONGEST_XML)?.ok_or_else(|| BcfError::Missing(name.to_owned()))?;
        Element::read(&bytes).map_err(|cause| BcfError::Xml { entry: name.to_owned(), cause })
    }
}

/// An archive that is written.
#[derive(Debug)]
pub(super) struct Packing(ZipWriter<Cursor<Vec<u8>>>);

impl Packing {
    pub(super) fn new() -> Self {
        Self(ZipWriter::new(Cursor::new(Vec::new())))
    }

    pub(super) fn xml(&mut self, name: &str, root: &Element) -> Result<(), BcfError> {
        let bytes = root.to_bytes().map_err(|cause| BcfError::Write(cause.into()))?;
        self.add(name, &bytes, CompressionMethod::Deflated)
    }

    /// Adds a file that is packed already.
    pub(super) fn packed(&mut self, name: &str, bytes: &[u8]) -> Result<(), BcfError> {
        self.add(name, bytes, CompressionMethod::Stored)
    }

    fn add(&mut self, name: &str, bytes: &[u8], method: CompressionMethod) -> Result<(), BcfError> {
        let options = SimpleFileOptions::default().compression_method(method);
        self.0.start_file(name, options).map_err(BcfError::Write)?;
        self.0.write_all(bytes).map_err(|cause| BcfError::Write(cause.into()))
    }

    pub(super) fn end(self) -> Result<Vec<u8>, BcfError> {
        self.0.finish().map(Cursor::into_inner).map_err(BcfError::Write)
    }
}
