//! Cooked scenes of models that were viewed, so that viewing one again begins at once.

use std::{
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use blake3::Hasher;
use etcetera::{BaseStrategy, choose_base_strategy};
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;
use thiserror::Error;
use trimaran_scene::FORMAT_VERSION;

/// Digits of a hash in a name: 64 bits.
const DIGITS: usize = 16;
/// The size limit of the cache, bytes. Beyond it the least recently viewed scenes are removed.
const MOST_BYTES: u64 = 16 << 30;
/// A temporary file that was not written to for this long belongs to a process that is gone.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);

/// Why a model has no place in the cache.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CacheError {
    /// A file of the model is not there.
    #[error("cannot read {}: {cause}; check the name and the permissions", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// The cache cannot be used. Scenes can be cooked elsewhere.
    #[error("the folder for cooked scenes cannot be used; set XDG_CACHE_HOME to one that is writable")]
    Folder(#[from] io::Error),
}

/// The place of a model's cooked scene in the user's cache, such as `~/.cache/trimaran`.
///
/// Its name identifies the model's files and the options with which they are read. A note beside it holds the
/// state of each file that the import read or looked for, and of the scene. If one of them has changed, the
/// scene is cooked anew.
///
/// While this exists, no other process removes the scene to make room.
#[derive(Debug)]
pub struct CachedScene {
    scene: PathBuf,
    note: PathBuf,
    /// Locked, in shared mode, by each process that views the scene.
    lock: File,
    /// When the import began, or later.
    begun: SystemTime,
}

/// The note beside a cached scene.
#[derive(Debug, Serialize, Deserialize, PartialEq)]
struct Note {
    files: Vec<(PathBuf, State)>,
    scene: State,
}

/// The state of a file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, PartialEq, Eq)]
enum State {
    /// It is not there.
    Absent,
    /// Its length in bytes, and when it was last changed, in nanoseconds since 1970.
    Present(u64, u64),
    /// It may have changed while it was read: no file compares equal to this.
    Unknown,
}

impl CachedScene {
    /// The place for `files`, read with the options `reading`. Makes the folder, private to the user.
    ///
    /// # Errors
    /// When a file is not there, or the cache cannot be used.
    pub fn of(files: &[PathBuf], reading: &str) -> Result<Self, CacheError> {
        let unread = |path: &Path| {
            let path = path.to_owned();
            move |cause| CacheError::File { path, cause }
        };
        let mut model = Hasher::new();
        add(&mut model, reading.as_bytes());
        model.update(&FORMAT_VERSION.to_le_bytes());
        for file in files {
            let file = fs::canonicalize(file).map_err(unread(file))?;
            add(&mut model, file.as_os_str().as_encoded_bytes());
        }
        let name = files.first().and_then(|file| file.file_stem()).unwrap_or_default().to_string_lossy();
        let digits: String = model.finalize().to_hex().chars().take(DIGITS).collect();
        Ok(Self::within(&private_folder()?, &format!("{name}-{digits}"))?)
    }

    fn within(folder: &Path, name: &str) -> io::Result<Self> {
        let at = |ending: &str| folder.join(format!("{name}.{ending}"));
        let mut lock = File::options().create(true).truncate(false).write(true).open(at("lock"))?;
        owner_only(&at("lock"))?;
        lock.lock_shared()?;
        // By the file system's clock, which may be a little behind that of programs.
        lock.write_all(b"\n")?;
        let begun = lock.metadata()?.modified()?;
        Ok(Self { scene: at("scene"), note: at("json"), lock, begun })
    }

    /// The path of the scene, which may not exist yet.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.scene
    }

    /// Whether the scene exists and is up to date.
    #[must_use]
    pub fn is_current(&self) -> bool {
        let Some(note) = fs::read(&self.note).ok().and_then(|text| serde_json::from_slice(&text).ok()) else {
            return false;
        };
        let Note { files, scene } = note;
        let is_as_noted = |(path, state): &(PathBuf, State)| state_of(path) == *state;
        let current = files.iter().all(is_as_noted) && state_of(&self.scene) == scene;
        if current {
            // The newest note marks the scene that was viewed last.
            let _read_only =
                File::options().append(true).open(&self.note).and_then(|f| f.set_modified(now()));
        }
        current
    }

    /// Notes that the scene is cooked, of a model that depends on these files. Then removes files left by
    /// dead processes and, beyond the size limit, the least recently viewed scenes.
    ///
    /// # Errors
    /// When the system does not let it.
    pub fn keep(&self, depends_on: &[PathBuf]) -> io::Result<()> {
        owner_only(&self.scene)?;
        let state = |path: &PathBuf| {
            let path = std::path::absolute(path)?;
            let state = self.as_read(&path);
            Ok((path, state))
        };
        let files = depends_on.iter().map(state).collect::<io::Result<_>>()?;
        let note = Note { files, scene: state_of(&self.scene) };
        let folder = self.scene.parent().unwrap_or(Path::new("."));
        // A temporary file is its owner's alone.
        let file = NamedTempFile::with_prefix_in(".trimaran-", folder)?;
        serde_json::to_writer(&file, &note)?;
        file.persist(&self.note)?;
        trim(folder, MOST_BYTES)
    }

    /// The state in which the import has read a file: unknown if it may have changed since.
    fn as_read(&self, path: &Path) -> State {
        let begun = nanoseconds(self.begun);
        match state_of(path) {
            State::Present(_, changed) if changed >= begun => State::Unknown,
            state => state,
        }
    }
}

impl Drop for CachedScene {
    fn drop(&mut self) {
        let _closing_does_it_too = self.lock.unlock();
    }
}

/// The user's cache of this program, private to the user.
///
/// # Errors
/// When the user has no home, or the system does not let it be made.
pub fn private_folder() -> io::Result<PathBuf> {
    let base = choose_base_strategy().map_err(io::Error::other)?;
    let folder = base.cache_dir().join("trimaran");
    fs::create_dir_all(&folder)?;
    // Earlier versions have made it readable.
    #[cfg(unix)]
    fs::set_permissions(&folder, std::os::unix::fs::PermissionsExt::from_mode(0o700))?;
    Ok(folder)
}

fn owner_only(file: &Path) -> io::Result<()> {
    #[cfg(unix)]
    fs::set_permissions(file, std::os::unix::fs::PermissionsExt::from_mode(0o600))?;
    Ok(())
}

/// Removes files left behind, then the least recently viewed scenes until all take at most `most` bytes. A
/// scene that a process views stays.
fn trim(folder: &Path, most: u64) -> io::Result<()> {
    let mut scenes = Vec::new();
    for entry in fs::read_dir(folder)? {
        // Another process may remove the same.
        let Ok(entry) = entry else { continue };
        let (path, Ok(metadata)) = (entry.path(), entry.metadata()) else { continue };
        let name = entry.file_name().to_string_lossy().into_owned();
        let changed = metadata.modified().unwrap_or(UNIX_EPOCH);
        if name.starts_with(".trimaran-") {
            if now().duration_since(changed).is_ok_and(|age| age > LEFT_BEHIND) {
                let _gone = fs::remove_file(path);
            }
        } else if path.extension().is_some_and(|ending| ending == "scene") {
            // Without a note, it was made by an earlier version, or only half.
            let viewed = fs::metadata(path.with_extension("json")).and_then(|note| note.modified());
            scenes.push((viewed.unwrap_or(UNIX_EPOCH), metadata.len(), path));
        }
    }
    scenes.sort_unstable();
    let mut taken: u64 = scenes.iter().map(|(_, length, _)| length).sum();
    for (viewed, length, scene) in scenes {
        if taken <= most && viewed > UNIX_EPOCH {
            break;
        }
        if remove(&scene) {
            taken = taken.saturating_sub(length);
        }
    }
    Ok(())
}

/// Removes a scene, unless a process views it.
fn remove(scene: &Path) -> bool {
    let lock = scene.with_extension("lock");
    let Ok(held) = File::options().create(true).append(true).open(&lock) else { return false };
    if held.try_lock().is_err() {
        return false;
    }
    // The note first: without it the scene is invalid.
    let _none = fs::remove_file(scene.with_extension("json"));
    let removed = fs::remove_file(scene).is_ok();
    let _gone = fs::remove_file(lock);
    removed
}

fn state_of(file: &Path) -> State {
    match fs::metadata(file) {
        Ok(metadata) => {
            State::Present(metadata.len(), nanoseconds(metadata.modified().unwrap_or(UNIX_EPOCH)))
        }
        Err(_) => State::Absent,
    }
}

fn nanoseconds(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

#[expect(clippy::disallowed_methods, reason = "it is held against the times of files")]
fn now() -> SystemTime {
    SystemTime::now()
}

/// Adds a text with its length, so that two different lists of texts never hash alike.
fn add(hasher: &mut Hasher, text: &[u8]) {
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text);
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A folder for scenes, with one of a model of two files. The first file is old, the second does not
    /// exist.
    fn cooked() -> (tempfile::TempDir, CachedScene, [PathBuf; 2]) {
        let folder = tempfile::tempdir().unwrap();
        let files = ["a.rvm", "a.att"].map(|name| folder.path().join(name));
        fs::write(&files[0], "HEAD").unwrap();
        age(&files[0], 1_000);
        let cached = CachedScene::within(folder.path(), "a-1").unwrap();
        fs::write(cached.path(), "scene").unwrap();
        assert!(!cached.is_current(), "nothing is noted of it");
        cached.keep(&files).unwrap();
        assert!(cached.is_current());
        (folder, cached, files)
    }

    fn age(file: &Path, seconds: u64) {
        let then = now() - Duration::from_secs(seconds);
        File::options().append(true).open(file).unwrap().set_modified(then).unwrap();
    }

    #[test]
    fn a_scene_is_current_while_each_file_is_as_it_was_read() {
        let (_folder, cached, [model, attributes]) = cooked();
        fs::write(&attributes, "").unwrap();
        assert!(!cached.is_current(), "a file is there that the import looked for");
        fs::remove_file(&attributes).unwrap();
        assert!(cached.is_current());
        age(&model, 2_000);
        assert!(!cached.is_current(), "it was changed");
        fs::remove_file(&model).unwrap();
        assert!(!cached.is_current(), "it is gone");
    }

    #[test]
    fn a_scene_that_is_damaged_or_half_noted_is_cooked_again() {
        let (_folder, cached, files) = cooked();
        fs::write(cached.path(), "scen").unwrap();
        assert!(!cached.is_current());
        fs::write(cached.path(), "scene").unwrap();
        cached.keep(&files).unwrap();
        assert!(cached.is_current());
        fs::write(&cached.note, "{").unwrap();
        assert!(!cached.is_current());
    }

    #[test]
    fn a_file_that_changes_while_it_is_read_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let cached = CachedScene::within(folder.path(), "a-1").unwrap();
        let model = folder.path().join("a.rvm");
        fs::write(&model, "HEAD").unwrap();
        fs::write(cached.path(), "scene").unwrap();
        cached.keep(&[model]).unwrap();
        assert!(!cached.is_current());
    }

    #[test]
    fn only_the_owner_reads_what_is_kept() {
        let (_folder, cached, _) = cooked();
        for file in [&cached.scene, &cached.note, &cached.note.with_extension("lock")] {
            assert_eq!(fs::metadata(file).unwrap().permissions().mode() & 0o777, 0o600, "{file:?}");
        }
    }

    #[test]
    fn what_was_longest_not_viewed_makes_room_unless_it_is_viewed_now() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["viewed", "oldest", "older", "newest"];
        let mut kept = Vec::new();
        for (name, seconds) in names.into_iter().zip([4_000, 3_000, 2_000, 1_000]) {
            let cached = CachedScene::within(folder.path(), name).unwrap();
            fs::write(cached.path(), [0; 100]).unwrap();
            cached.keep(&[]).unwrap();
            age(&cached.note, seconds);
            kept.push(cached);
        }
        kept.truncate(1);
        let is_there = |name: &str| folder.path().join(format!("{name}.scene")).exists();
        trim(folder.path(), 400).unwrap();
        assert!(names.into_iter().all(is_there));
        trim(folder.path(), 250).unwrap();
        assert_eq!(names.map(is_there), [true, false, false, true]);
    }

    #[test]
    fn what_processes_left_behind_is_removed() {
        let (folder, _cached, _) = cooked();
        let [left, in_use, earlier] =
            [".trimaran-1.tmp", ".trimaran-2.tmp", "b-0-0.scene"].map(|name| folder.path().join(name));
        for file in [&left, &in_use, &earlier] {
            fs::write(file, "").unwrap();
        }
        age(&left, 10_000);
        trim(folder.path(), MOST_BYTES).unwrap();
        assert_eq!([&left, &in_use, &earlier].map(|file| file.exists()), [false, true, false]);
    }
}
