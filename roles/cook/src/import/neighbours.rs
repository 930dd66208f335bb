//! Files that a model refers to: in its folder or below, each read once.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use super::budget::Budget;

/// Files beside a document, with a cache: naming one a thousand times costs no more than once.
pub(super) struct Neighbours<'b> {
    /// None if the document itself is not a file.
    folder: Option<PathBuf>,
    read: HashMap<PathBuf, Arc<Vec<u8>>>,
    /// The names in searched folders, by their lower case.
    listed: HashMap<PathBuf, HashMap<String, OsString>>,
    budget: &'b Budget,
}

/// Why a neighbour could not be read.
pub(super) enum NotThere {
    /// The name leads out of the folder, or there is no folder.
    Elsewhere,
    /// The system could not read it.
    Unread(PathBuf, io::Error),
}

impl<'b> Neighbours<'b> {
    /// The neighbours of the document at `path`; with `None` there are none.
    pub(super) fn of(path: Option<&Path>, budget: &'b Budget) -> Self {
        let folder = path.map(|path| path.parent().unwrap_or(Path::new("")).to_owned());
        Self { folder, read: HashMap::new(), listed: HashMap::new(), budget }
    }

    /// The bytes of the file called `name`, which must be in the document's folder or below: an untrusted
    /// model must not read other files of this machine. Also whether they were requested before.
    ///
    /// Models come from Windows: if there is no such file, backslashes divide folders, and then case is
    /// ignored.
    pub(super) fn read(&mut self, name: &Path) -> Result<(Arc<Vec<u8>>, bool), NotThere> {
        let divided = PathBuf::from(name.to_string_lossy().replace('\\', "/"));
        let missing = match self.read_exactly(name) {
            Err(missing) => missing,
            found => return found,
        };
        if divided != name
            && let Ok(found) = self.read_exactly(&divided)
        {
            return Ok(found);
        }
        match self.in_any_case(&divided) {
            Some(path) => self.read_at(path),
            None => Err(missing),
        }
    }

    fn read_exactly(&mut self, name: &Path) -> Result<(Arc<Vec<u8>>, bool), NotThere> {
        let path = self.path(name).ok_or(NotThere::Elsewhere)?;
        self.read_at(path)
    }

    fn read_at(&mut self, path: PathBuf) -> Result<(Arc<Vec<u8>>, bool), NotThere> {
        // By its canonical name: `a.bin` and `./a.bin` are one file.
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

    /// The path of the file whose name equals `name` except for case.
    pub(super) fn in_any_case(&mut self, name: &Path) -> Option<PathBuf> {
        self.path(name)?;
        let mut found = self.folder.clone()?;
        for part in name.components().filter(|part| *part != Component::CurDir) {
            let names = self.listed.entry(found.clone()).or_insert_with_key(|folder| list(folder));
            found.push(names.get(&part.as_os_str().to_string_lossy().to_lowercase())?);
        }
        Some(found)
    }
}

/// The names in a folder by their lower case; of equal ones the first in order.
fn list(folder: &Path) -> HashMap<String, OsString> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = fs::read_dir(here).into_iter().flatten().flatten();
    let mut names: Vec<OsString> = entries.map(|entry| entry.file_name()).collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    names.into_iter().map(|name| (name.to_string_lossy().to_lowercase(), name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::ImportLimits;

    #[test]
    fn names_of_windows_are_found_and_none_leads_out() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model");
        fs::create_dir_all(model.join("Mats")).unwrap();
        for (name, text) in [("a.mtl", "a"), ("Mats/Red.mtl", "red"), ("mats.mtl", "m"), ("x\\y", "xy")] {
            fs::write(model.join(name), text).unwrap();
        }
        fs::write(folder.path().join("secret"), "secret").unwrap();
        let budget = Budget::new(ImportLimits::default());
        let mut neighbours = Neighbours::of(Some(&model.join("a.obj")), &budget);
        let mut read = |name: &str| match neighbours.read(Path::new(name)) {
            Ok((bytes, _)) => String::from_utf8(bytes.to_vec()).unwrap(),
            Err(NotThere::Elsewhere) => "elsewhere".to_owned(),
            Err(NotThere::Unread(..)) => "not there".to_owned(),
        };
        let found = ["a.mtl", "A.MTL", "mats\\red.MTL", ".\\MATS/RED.mtl", "x\\y", "MATS.mtl"].map(&mut read);
        assert_eq!(found, ["a", "a", "red", "red", "xy", "m"]);
        let lost = ["b.mtl", "..\\secret", "Mats\\..\\..\\secret", "mats"].map(&mut read);
        assert_eq!(lost, ["not there"; 4]);
        let elsewhere = ["../secret", "/etc/passwd", "C:\\a.mtl", "Mats/../../SECRET"].map(&mut read);
        assert_eq!(elsewhere, ["elsewhere"; 4]);
    }
}
