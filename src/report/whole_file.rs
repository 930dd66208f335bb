//! A file that is written whole or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

/// Writes a file whole, or leaves what was there: a reader never finds half of it.
///
/// # Errors
/// Those of the system.
pub fn write_whole(path: &Path, text: &str) -> io::Result<()> {
    write_whole_by(path, |file| file.write_all(text.as_bytes()))
}

/// The same for what `write` writes.
///
/// # Errors
/// Those of the system, and of `write`.
pub fn write_whole_by(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let beside = path.with_extension("part");
    let written = File::create(&beside).and_then(|file| {
        let mut file = BufWriter::new(file);
        write(&mut file).and_then(|()| file.flush())
    });
    let written = written.and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        let _left = fs::remove_file(&beside);
    }
    written
}
