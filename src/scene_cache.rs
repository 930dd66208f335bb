//! Cooked scenes of models that were viewed: so viewing one again begins at once.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
    time::UNIX_EPOCH,
};

use blake3::Hasher;
use etcetera::{BaseStrategy, HomeDirError, choose_base_strategy};
use thiserror::Error;
use trimaran_scene::FORMAT_VERSION;

/// Endings of files that belong to a model without being named: buffers of glTF, colours of OBJ, attributes of
/// RVM.
const COMPANIONS: [&str; 4] = ["bin", "mtl", "att", "txt"];

/// Digits of a hash in a name: 64 bits.
const DIGITS: usize = 16;

/// Why there is no place for a model's scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CacheError {
    /// A file of the model is not there.
    #[error("cannot read {}: {cause}; check the name and the permissions", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// The user has no home.
    #[error("there is no folder for cooked scenes: set HOME or XDG_CACHE_HOME, or use `trimaran import`")]
    NoHome(#[from] HomeDirError),
}

/// The place of a model's cooked scene in the user's cache, such as `~/.cache/trimaran`.
///
/// The name of the scene's file says which files it is made of, how they are read, and what state they were
/// in: their lengths and times of change. So a model that has changed has another place.
#[derive(Debug)]
pub struct CachedScene {
    path: PathBuf,
    /// What the names of all earlier states of the same model begin with.
    model: String,
}

impl CachedScene {
    /// That of `files`, read as `reading` says.
    ///
    /// # Errors
    /// When a file is not there, or the user has no home.
    pub fn of(files: &[PathBuf], reading: &str) -> Result<Self, CacheError> {
        let folder = choose_base_strategy()?.cache_dir().join("trimaran");
        Self::within(&folder, files, reading)
    }

    fn within(folder: &Path, files: &[PathBuf], reading: &str) -> Result<Self, CacheError> {
        let unread = |path: &Path| {
            let path = path.to_owned();
            move |cause| CacheError::File { path, cause }
        };
        let (mut model, mut state) = (Hasher::new(), Hasher::new());
        add(&mut model, reading.as_bytes());
        let mut companions = BTreeSet::new();
        for file in files {
            let file = fs::canonicalize(file).map_err(unread(file))?;
            add(&mut model, file.as_os_str().as_encoded_bytes());
            add_state(&mut state, &file).map_err(unread(&file))?;
            companions.extend(companions_of(&file));
        }
        for companion in companions {
            add_state(&mut state, &companion).map_err(unread(&companion))?;
        }
        state.update(&FORMAT_VERSION.to_le_bytes());
        let name = files.first().and_then(|file| file.file_stem()).unwrap_or_default().to_string_lossy();
        let model = format!("{name}-{}-", digits(&model));
        Ok(Self { path: folder.join(format!("{model}{}.scene", digits(&state))), model })
    }

    /// Where the scene is, or is to be.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it was cooked already.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.path.exists()
    }

    /// Makes the folder, and removes scenes of earlier states of the model.
    ///
    /// # Errors
    /// When the system does not let it.
    pub fn make_room(&self) -> io::Result<()> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder)?;
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name.starts_with(&self.model) && name.ends_with(".scene") {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

/// The files beside one that may be read with it.
fn companions_of(file: &Path) -> Vec<PathBuf> {
    let is_companion = |path: &PathBuf| {
        let ending = path.extension().unwrap_or_default();
        COMPANIONS.iter().any(|companion| ending.eq_ignore_ascii_case(companion)) && path.is_file()
    };
    let beside = file.parent().and_then(|folder| fs::read_dir(folder).ok());
    beside.into_iter().flatten().flatten().map(|entry| entry.path()).filter(is_companion).collect()
}

fn add_state(hasher: &mut Hasher, file: &Path) -> io::Result<()> {
    let metadata = fs::metadata(file)?;
    let changed = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    add(hasher, file.as_os_str().as_encoded_bytes());
    hasher.update(&metadata.len().to_le_bytes());
    hasher.update(&changed.unwrap_or_default().as_nanos().to_le_bytes());
    Ok(())
}

/// Adds a text with its length, so that no two lists of texts are alike.
fn add(hasher: &mut Hasher, text: &[u8]) {
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text);
}

fn digits(hasher: &Hasher) -> String {
    hasher.finalize().to_hex().chars().take(DIGITS).collect()
}

#[cfg(test)]
mod tests {
    use std::{fs::File, time::Duration};

    use super::*;

    /// A folder with two files of a model.
    fn model() -> (tempfile::TempDir, Vec<PathBuf>) {
        let folder = tempfile::tempdir().unwrap();
        let files = ["a.rvm", "b.rvm"].map(|name| folder.path().join(name)).to_vec();
        for file in &files {
            fs::write(file, "HEAD").unwrap();
        }
        (folder, files)
    }

    fn cached(files: &[PathBuf], reading: &str) -> PathBuf {
        CachedScene::within(Path::new("/cache"), files, reading).unwrap().path
    }

    #[test]
    fn the_same_files_in_the_same_state_have_one_place() {
        let (folder, files) = model();
        let before = cached(&files, "1 mm");
        assert_eq!(cached(&files, "1 mm"), before);
        assert!(before.to_string_lossy().starts_with("/cache/a-"), "{}", before.display());
        assert_ne!(cached(&files, "2 mm"), before);
        assert_ne!(cached(&files[..1], "1 mm"), before);
        assert_ne!(cached(&[files[1].clone(), files[0].clone()], "1 mm"), before);
        // Longer; changed at another time; with attributes beside it.
        fs::write(&files[1], "HEAD more").unwrap();
        let longer = cached(&files, "1 mm");
        assert_ne!(longer, before);
        let time = UNIX_EPOCH + Duration::from_secs(1_000_000);
        File::options().append(true).open(&files[1]).unwrap().set_modified(time).unwrap();
        let later = cached(&files, "1 mm");
        assert_ne!(later, longer);
        fs::write(folder.path().join("a.ATT"), "").unwrap();
        assert_ne!(cached(&files, "1 mm"), later);
        fs::write(folder.path().join("a.pdf"), "").unwrap();
        fs::remove_file(folder.path().join("a.ATT")).unwrap();
        assert_eq!(cached(&files, "1 mm"), later);
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = CachedScene::within(Path::new("/cache"), &["no.rvm".into()], "").unwrap_err();
        assert!(error.to_string().starts_with("cannot read no.rvm: "), "{error}");
    }

    #[test]
    fn a_scene_takes_the_place_of_earlier_ones_of_the_same_model_alone() {
        let (_folder, files) = model();
        let cache = tempfile::tempdir().unwrap();
        let folder = cache.path().join("trimaran");
        let earlier = CachedScene::within(&folder, &files, "").unwrap();
        let other = CachedScene::within(&folder, &files[..1], "").unwrap();
        earlier.make_room().unwrap();
        for scene in [&earlier, &other] {
            fs::write(scene.path(), "").unwrap();
        }
        fs::write(&files[0], "HEAD more").unwrap();
        let later = CachedScene::within(&folder, &files, "").unwrap();
        later.make_room().unwrap();
        assert_eq!([&earlier, &other, &later].map(CachedScene::is_there), [false, true, false]);
    }
}
