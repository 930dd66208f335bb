//! An open scene under changes of its file.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: a failure is a test's failure")]

use std::error::Error;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

use tempfile::TempDir;
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_cook::{CookOptions, Model, cook};
use trimaran_scene::random::Random;
use trimaran_scene::{Node, OpenError, ReadCause, ReadError, Rgba8, SaveError, Scene};

/// A folder with a scene of many pages in it, and the scene's bytes.
struct Saved {
    folder: TempDir,
    path: PathBuf,
    bytes: Vec<u8>,
}

fn save(model: &Model, path: &Path) -> Vec<u8> {
    cook(model, &CookOptions::default(), &()).unwrap().save(path).unwrap();
    fs::read(path).unwrap()
}

/// The scene that most tests use.
static PLANT: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    save(&plant(&PlantOptions::small(1)), &folder.path().join("plant.scene"))
});

impl Saved {
    fn new() -> Self {
        Self::of(PLANT.clone())
    }

    fn of(bytes: Vec<u8>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plant.scene");
        fs::write(&path, &bytes).unwrap();
        assert!(bytes.len() > 1 << 18, "smaller than a few pages: {}", bytes.len());
        let saved = Self { folder, path, bytes };
        saved.age();
        saved
    }

    /// Ages the file's time, so that writing to it is noticed even with a coarse file-system clock.
    fn age(&self) {
        let file = OpenOptions::new().write(true).open(&self.path).unwrap();
        file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(1 << 30)).unwrap();
    }

    /// Every byte of a scene: the output of saving it. It reads all of its pages.
    fn bytes_of(&self, scene: &Scene) -> Result<Vec<u8>, SaveError> {
        let path = self.folder.path().join("again.scene");
        scene.save(&path)?;
        Ok(fs::read(&path).unwrap())
    }

    /// Opens the scene, changes its file, and compares the scene's content with the original.
    fn survives(&self, change: fn(&Self)) {
        let scene = Scene::open(&self.path).unwrap();
        let unread = scene.resident_bytes();
        change(self);
        assert!(self.bytes_of(&scene).unwrap() == self.bytes, "the open scene changed with its file");
        scene.check().unwrap();
        assert!(scene.resident_bytes() > unread, "most was read after the change");
    }

    /// Opens the scene and reads some of it, changes its file, and checks the rest.
    fn is_noticed(&self, change: fn(&Self)) {
        let scene = Scene::open(&self.path).unwrap();
        let top: Vec<Node> = scene.nodes().range(0..200).copied().collect();
        let read = scene.resident_bytes();
        let last = scene.places().len() as u32 - 1;
        assert_eq!(scene.geometry(last).map(|geometry| geometry.triangles() > 0).ok(), Some(true));
        change(self);

        // Geometry is not kept.
        let error = scene.geometry(last).unwrap_err();
        self.is_about_a_change(&error, &format!("geometry {last}"));
        assert!(scene.fault().is_none(), "the records that were read are whole");
        // Loaded records are kept, and others appear absent.
        assert_eq!(
            (scene.nodes().len(), scene.hash()),
            (self.original().nodes().len(), self.original().hash())
        );
        assert!(scene.nodes().range(0..200).eq(&top));
        let error = scene.check().unwrap_err();
        assert!(matches!(error.cause, ReadCause::Changed), "{error}: {:?}", error.cause);
        assert!(scene.nodes().range(0..200).eq(&top));
        assert!(scene.resident_bytes() >= read);
        match self.bytes_of(&scene) {
            Err(SaveError::Read(error)) => assert!(matches!(error.cause, ReadCause::Changed), "{error}"),
            other => panic!("{:?}", other.map(|bytes| bytes.len())),
        }
    }

    fn is_about_a_change(&self, error: &ReadError, what: &str) {
        assert!(matches!(error.cause, ReadCause::Changed), "{error}: {:?}", error.cause);
        assert_eq!((&error.path, error.what.as_str()), (&self.path, what));
        assert!(error.bytes.start < error.bytes.end && error.bytes.end <= self.bytes.len() as u64);
        let message = error.to_string();
        assert!(message.contains("plant.scene") && message.contains("renaming a new file over the old one"));
        assert_eq!(error.source().unwrap().to_string(), "the file was overwritten while it was open");
    }

    fn original(&self) -> Scene {
        Scene::open_bytes(&self.path, &self.bytes).unwrap()
    }
}

/// Overwrites the first bytes of a file in place, like `scp` and `cp`.
fn overwrite(path: &Path, bytes: &[u8]) {
    OpenOptions::new().write(true).open(path).unwrap().write_all(bytes).unwrap();
}

#[test]
fn an_open_scene_outlives_its_file() {
    let changes: [fn(&Saved); 4] = [
        |Saved { path, .. }| {
            let other = path.with_extension("other");
            fs::write(&other, b"something else").unwrap();
            fs::rename(other, path).unwrap();
        },
        // Another scene is saved over it.
        |Saved { path, bytes, .. }| {
            let other = save(&plant(&PlantOptions::small(2)), path);
            assert!(other != *bytes && fs::read(path).unwrap() == other);
        },
        |Saved { path, .. }| fs::remove_file(path).unwrap(),
        // Pages are verified by their hashes: equal bytes are good, whenever they were written.
        |Saved { path, bytes, .. }| fs::write(path, bytes).unwrap(),
    ];
    for change in changes {
        Saved::new().survives(change);
    }
}

#[test]
fn a_file_that_is_written_to_is_a_fault() {
    let changes: [fn(&Saved); 3] = [
        // Of the same length.
        |Saved { path, bytes, .. }| overwrite(path, &vec![0xff; bytes.len()]),
        |Saved { path, .. }| OpenOptions::new().write(true).open(path).unwrap().set_len(100).unwrap(),
        // Like `scp`: the file is truncated, then written from its beginning. Half of it is there again.
        |Saved { path, bytes, .. }| fs::write(path, &bytes[..bytes.len() / 2]).unwrap(),
    ];
    for change in changes {
        Saved::new().is_noticed(change);
    }
}

#[test]
fn a_record_that_was_overwritten_is_a_fault_of_the_scene() {
    let saved = Saved::new();
    let scene = Scene::open(&saved.path).unwrap();
    let last = scene.nodes().len() - 1;
    let unread = scene.resident_bytes();
    overwrite(&saved.path, &vec![0xff; saved.bytes.len()]);
    let object = scene.objects().get(0);
    assert_eq!((object, scene.resident_bytes()), (None, unread));
    let first = scene.fault().unwrap().clone();
    saved.is_about_a_change(&first, &format!("objects 0 to {}", scene.objects().len().min(1024) - 1));
    // Further reads find nothing more, and the same fault.
    assert_eq!((scene.object_name(0), scene.triangles(&scene.drawables()[0]).count()), (None, 0));
    assert!(scene.nodes().get(0).is_some() && scene.nodes().get(last + 1).is_none());
    assert_eq!(scene.fault().unwrap().what, first.what);
}

/// The scenes of two models, whose files have one length: the name of a file that a model came from, of
/// random characters, fills up the shorter one.
fn of_one_length(mut models: [Model; 2], path: &Path) -> [Vec<u8>; 2] {
    let mut random = Random::stream(1, 2, 3);
    for _ in 0..100 {
        let files = models.each_ref().map(|model| save(model, path));
        let [first, second] = files.each_ref().map(Vec::len);
        let missing = first.abs_diff(second);
        if missing == 0 {
            return files;
        }
        let shorter = &mut models[usize::from(second < first)].sources[0].name;
        shorter.extend((0..missing).map(|_| char::from(b'!' + random.below(94) as u8)));
    }
    panic!("no two of one length were found");
}

struct Stop<'a>(&'a AtomicBool);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// One scene is written over another of the same length continuously. All data read is of the opened one.
#[test]
fn a_scene_that_is_being_overwritten_is_read_whole_or_with_a_fault() {
    // The same plant in other colours: all of its vertices differ.
    let mut models = [(); 2].map(|()| plant(&PlantOptions::small(1)));
    for Rgba8([r, g, b, _]) in models[1].meshes.iter_mut().flat_map(|mesh| &mut mesh.colours) {
        (*r, *g, *b) = (*r ^ 0x80, *g ^ 0x80, *b ^ 0x80);
    }
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.scene");
    let both = of_one_length(models, &other);
    assert!(both[0] != both[1]);
    let saved = Saved::of(both[0].clone());
    let hashes = both.each_ref().map(|bytes| Scene::open_bytes(&other, bytes).unwrap().hash());
    assert!(hashes[0] != hashes[1]);

    let done = AtomicBool::new(false);
    let torn = |cause: &ReadCause| matches!(cause, ReadCause::Changed | ReadCause::Damaged);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for bytes in both.iter().cycle() {
                if done.load(Ordering::Relaxed) {
                    return;
                }
                overwrite(&saved.path, bytes);
            }
        });
        // The writer ends even if an assertion fails.
        let _stop = Stop(&done);
        for _ in 0..50 {
            let scene = match Scene::open(&saved.path) {
                Ok(scene) => scene,
                // Damaged if the writer was paused half way meanwhile.
                Err(OpenError::Changed { .. } | OpenError::Damaged { .. }) => continue,
                Err(OpenError::Read(error)) if torn(&error.cause) => continue,
                Err(other) => panic!("{other}"),
            };
            let which = hashes.iter().position(|hash| *hash == scene.hash()).unwrap();
            match saved.bytes_of(&scene) {
                Ok(bytes) => assert!(bytes == both[which], "a mixture of two scenes"),
                Err(SaveError::Read(error)) => assert!(torn(&error.cause), "{error}"),
                Err(other) => panic!("{other}"),
            }
        }
    });
}

#[test]
fn what_may_pass_is_told_from_what_stays() {
    let saved = Saved::new();
    let open = |bytes: Option<&[u8]>| {
        match bytes {
            Some(bytes) => fs::write(&saved.path, bytes).unwrap(),
            None => fs::remove_file(&saved.path).unwrap(),
        }
        Scene::open(&saved.path).unwrap_err()
    };
    for end in [0, 1, 8, 100, 128, saved.bytes.len() / 2, saved.bytes.len() - 1] {
        let error = open(Some(&saved.bytes[..end]));
        assert!(matches!(error, OpenError::Truncated { actual, .. } if actual == end as u64), "{error}");
        assert!(error.may_pass() && error.to_string().contains("being copied"), "{error}");
    }
    let missing = open(None);
    assert!(missing.may_pass() && missing.to_string().contains("cannot read"), "{missing}");

    // The header, the first page of nodes and the directory.
    let damaged = [40, 140, saved.bytes.len() - 40].map(|at| {
        let mut damaged = saved.bytes.clone();
        damaged[at] ^= 1;
        damaged
    });
    let mut newer = saved.bytes.clone();
    newer[8] = 200;
    for bytes in [&damaged[0], &damaged[1], &damaged[2], &newer, &b"glTF, not a scene"[..]] {
        let error = open(Some(bytes));
        assert!(!error.may_pass(), "{error}");
    }
    let folder = Scene::open(saved.folder.path()).unwrap_err();
    assert!(!folder.may_pass() && folder.to_string().contains("not a regular file"), "{folder}");

    let read = |cause| {
        OpenError::Read(ReadError { path: saved.path.clone(), bytes: 0..1, what: "nodes".to_owned(), cause })
    };
    assert!(read(ReadCause::Changed).may_pass());
    assert!(!read(ReadCause::Damaged).may_pass());
}

/// Many scenes are open at once: each keeps one file open, and closes it.
#[cfg(target_os = "linux")]
#[test]
fn a_scene_keeps_its_file_open_as_long_as_it_lives() {
    let saved = Saved::new();
    let open_files = || {
        let files = fs::read_dir("/proc/self/fd").unwrap();
        files
            .filter(|file| fs::read_link(file.as_ref().unwrap().path()).is_ok_and(|to| to == saved.path))
            .count()
    };
    let scenes: Vec<Scene> = (0..3).map(|_| Scene::open(&saved.path).unwrap()).collect();
    assert_eq!(open_files(), 3);
    drop(scenes);
    assert_eq!(open_files(), 0);
}
