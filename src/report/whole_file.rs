//! A file that is written whole or not at all.

use std::{fs, io, path::Path};

/// Writes a file whole, or leaves what was there: a reader never finds half of it.
///
/// # Errors
/// Those of the system.
pub fn write_whole(path: &Path, text: &str) -> io::Result<()> {
    let beside = path.with_extension("part");
    let written = fs::write(&beside, text).and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        let _left = fs::remove_file(&beside);
    }
    written
}
