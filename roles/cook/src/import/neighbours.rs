//! The files that a model refers to: in its folder or below, each read once.

use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use super::budget::Budget;

/// Files beside a document, and those that were read already: naming one a thousand times costs no more than
/// once.
pub(super) struct Neighbours<'b> {
    /// None if the document itself is no file.
    folder: Option<PathBuf>,
    read: HashMap<PathBuf, Arc<Vec<u8>>>,
    budget: &'b Budget,
}

/// Why a neighbour could not be had.
pub(super) enum NotThere {
    /// The name leads out of the folder, or there is no folder.
    Elsewhere,
    /// The system could not read it.
    Unread(PathBuf, io::Error),
}

impl<'b> Neighbours<'b> {
    /// Those of the document at `path`; with `None` there are none.
    pub(super) fn of(path: Option<&Path>, budget: &'b Budget) -> Self {
        let folder = path.map(|path| path.parent().unwrap_or(Path::new("")).to_owned());
        Self { folder, read: HashMap::new(), budget }
    }

    /// The bytes of the file called `name`, which must be in the document's folder or below. A model from a
    /// stranger must not name any other file of this machine. Also whether they were asked for before.
    pub(super) fn read(&mut self, name: &Path) -> Result<(Arc<Vec<u8>>, bool), NotThere> {
        let path = self.path(name).ok_or(NotThere::Elsewhere)?;
        // By its true name: `a.bin` and `./a.bin` are one file.
        let unread = |source| NotThere::Unread(path.clone(), source);
        self.budget.look_for(&path);
        let true_path = fs::canonicalize(&path).map_err(unread)?;
        if let Some(bytes) = self.read.get(&true_path) {
            return Ok((Arc::clone(bytes), true));
        }
        let bytes = Arc::new(self.budget.read(&true_path).map_err(unread)?);
        self.read.insert(true_path, Arc::clone(&bytes));
        Ok((bytes, false))
    }

    fn path(&self, name: &Path) -> Option<PathBuf> {
        let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        let is_plain = !name.to_string_lossy().contains(':') && name.components().all(inside);
        self.folder.as_ref().filter(|_| is_plain).map(|folder| folder.join(name))
    }
}
