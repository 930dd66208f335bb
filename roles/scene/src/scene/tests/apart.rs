//! A file taken apart, changed and put together.

use bytemuck::{AnyBitPattern, NoUninit, Pod};

use super::*;

/// A file taken apart. Putting it together sets correct lengths and hashes, whatever was changed.
pub(super) struct Apart {
    pub(super) header: Header,
    pub(super) directory: Vec<Entry>,
    /// As stored in the file.
    pub(super) pages: Vec<Vec<u8>>,
}

impl Apart {
    pub(super) fn new(bytes: &[u8]) -> Self {
        let header: Header = bytemuck::pod_read_unaligned(&bytes[..size_of::<Header>()]);
        let directory: Vec<Entry> = bytemuck::pod_collect_to_vec(&bytes[header.directory as usize..]);
        let page = |entry: &Entry| bytes[entry.offset as usize..][..entry.length as usize].to_vec();
        Self { header, pages: directory.iter().map(page).collect(), directory }
    }

    pub(super) fn of(arrays: SceneArrays) -> Self {
        Self::new(&encoded(arrays))
    }

    pub(super) fn number(&self, section: Section, page: usize) -> usize {
        self.header.pages(section).nth(page).unwrap()
    }

    /// The place of a page in the file.
    pub(super) fn range(&self, section: Section, page: usize) -> Range<u64> {
        let entry = self.directory[self.number(section, page)];
        entry.offset..entry.offset + u64::from(entry.length)
    }

    pub(super) fn entry(&mut self, section: Section, page: usize) -> &mut Entry {
        let number = self.number(section, page);
        &mut self.directory[number]
    }

    pub(super) fn records<T: AnyBitPattern + NoUninit>(&self, section: Section, page: usize) -> Vec<T> {
        let number = self.number(section, page);
        let unpacked = self.directory[number].unpacked as usize;
        bytemuck::pod_collect_to_vec(&zstd::bulk::decompress(&self.pages[number], unpacked).unwrap())
    }

    /// Replaces a page, keeping its declared unpacked length.
    pub(super) fn replace(&mut self, section: Section, page: usize, unpacked: &[u8]) {
        let number = self.number(section, page);
        self.pages[number] = zstd::bulk::compress(unpacked, 3).unwrap();
    }

    pub(super) fn edit<T: Pod>(&mut self, section: Section, page: usize, edit: impl FnOnce(&mut [T])) {
        let mut records = self.records(section, page);
        edit(&mut records);
        self.replace(section, page, bytemuck::cast_slice(&records));
    }

    pub(super) fn nodes(&mut self, edit: impl FnOnce(&mut [Node])) {
        self.edit(Section::Nodes, 0, edit);
    }

    pub(super) fn drawables(&mut self, edit: impl FnOnce(&mut [Drawable])) {
        self.edit(Section::Drawables, 0, edit);
    }

    pub(super) fn places(&mut self, edit: impl FnOnce(&mut [GeometryPlace])) {
        self.edit(Section::Places, 0, edit);
    }

    pub(super) fn objects(&mut self, edit: impl FnOnce(&mut [ObjectRecord])) {
        self.edit(Section::Objects, 0, edit);
    }

    /// Pages one behind the other, then the directory.
    pub(super) fn lay_out(&mut self) {
        let mut end = size_of::<Header>() as u64;
        for (entry, page) in self.directory.iter_mut().zip(&self.pages) {
            (entry.offset, entry.length) = (end, page.len() as u32);
            end += page.len() as u64;
        }
        self.header.pages = self.directory.len() as u32;
        self.header.end_with(&self.directory, end);
    }

    /// The file, with right hashes.
    pub(super) fn seal(mut self) -> Vec<u8> {
        for (entry, page) in self.directory.iter_mut().zip(&self.pages) {
            entry.hash = *blake3::hash(page).as_bytes();
        }
        self.header.seal(&self.directory);
        let directory = bytemuck::cast_slice(&self.directory);
        [bytemuck::bytes_of(&self.header), &self.pages.concat(), directory].concat()
    }

    pub(super) fn bytes(mut self) -> Vec<u8> {
        self.lay_out();
        self.seal()
    }
}

#[test]
fn a_file_taken_apart_is_put_together_as_it_was() {
    let bytes = encoded(tree());
    assert!(Apart::new(&bytes).bytes() == bytes);
}
