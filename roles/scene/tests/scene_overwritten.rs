//! An open scene stays as it was, whatever becomes of its file.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: a failure is a test's failure")]

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use tempfile::TempDir;
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_cook::{CookOptions, cook};
use trimaran_scene::{OpenError, Rgba8, Scene};

/// A folder with a scene of some pages in it, and the scene's bytes.
struct Saved {
    folder: TempDir,
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Saved {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plant.scene");
        let scene = cook(&plant(&PlantOptions::small(1)), &CookOptions::default(), &()).unwrap();
        scene.save(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        assert!(bytes.len() > 1 << 20, "smaller than a few pages: {}", bytes.len());
        Self { folder, path, bytes }
    }

    /// Every byte of a scene: what saving it writes. It reads all of its arrays.
    fn bytes_of(&self, scene: &Scene) -> Vec<u8> {
        let path = self.folder.path().join("again.scene");
        scene.save(&path).unwrap();
        fs::read(&path).unwrap()
    }

    /// Opens the scene, does something to its file, and compares all that the scene holds with what it held.
    fn survives(&self, change: impl FnOnce(&Path)) {
        let scene = Scene::open(&self.path).unwrap();
        change(&self.path);
        assert!(self.bytes_of(&scene) == self.bytes, "the open scene changed with its file");
    }
}

/// Overwrites the first bytes of a file where it stands, as `scp` and `cp` do.
fn overwrite(path: &Path, bytes: &[u8]) {
    OpenOptions::new().write(true).open(path).unwrap().write_all(bytes).unwrap();
}

#[test]
fn an_open_scene_outlives_an_overwrite_of_the_same_length() {
    let saved = Saved::new();
    saved.survives(|path| overwrite(path, &vec![0xff; saved.bytes.len()]));
}

#[test]
fn an_open_scene_outlives_a_cut() {
    let saved = Saved::new();
    saved.survives(|path| OpenOptions::new().write(true).open(path).unwrap().set_len(100).unwrap());
}

#[test]
fn an_open_scene_outlives_a_copy_that_begins_anew() {
    let saved = Saved::new();
    // What `scp` does: the file is emptied, then written from its beginning on.
    saved.survives(|path| fs::write(path, &saved.bytes[..saved.bytes.len() / 2]).unwrap());
}

#[test]
fn an_open_scene_outlives_a_replacement_and_a_deletion() {
    let saved = Saved::new();
    saved.survives(|path| {
        let other = path.with_extension("other");
        fs::write(&other, b"something else").unwrap();
        fs::rename(other, path).unwrap();
    });
    fs::write(&saved.path, &saved.bytes).unwrap();
    saved.survives(|path| fs::remove_file(path).unwrap());
}

struct Stop<'a>(&'a AtomicBool);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Somebody writes one scene over another of the same length without a pause. Whatever is opened is one of
/// them.
#[test]
fn a_scene_that_is_being_overwritten_opens_whole_or_not_at_all() {
    let saved = Saved::new();
    // The same plant in other colours: all of its vertices differ, and the file is as long.
    let mut model = plant(&PlantOptions::small(1));
    for Rgba8([r, g, b, _]) in model.meshes.iter_mut().flat_map(|mesh| &mut mesh.colours) {
        (*r, *g, *b) = (!*r, !*g, !*b);
    }
    let other = saved.folder.path().join("other.scene");
    cook(&model, &CookOptions::default(), &()).unwrap().save(&other).unwrap();
    let both = [saved.bytes.clone(), fs::read(&other).unwrap()];
    assert!(both[0] != both[1] && both[0].len() == both[1].len());

    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for bytes in both.iter().cycle() {
                if done.load(Ordering::Relaxed) {
                    return;
                }
                overwrite(&saved.path, bytes);
            }
        });
        // The writer ends even where an assertion fails.
        let _stop = Stop(&done);
        for _ in 0..50 {
            match Scene::open(&saved.path) {
                Ok(scene) => {
                    let bytes = saved.bytes_of(&scene);
                    assert!(bytes == both[0] || bytes == both[1], "a mixture of two scenes");
                }
                // Damaged where the writer did not come to write meanwhile, and stood half way.
                Err(OpenError::Changed { .. } | OpenError::Damaged { .. }) => {}
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
    for end in [0, 1, 8, 100, saved.bytes.len() - 1] {
        let error = open(Some(&saved.bytes[..end]));
        assert!(matches!(error, OpenError::Truncated { actual, .. } if actual == end as u64), "{error}");
        assert!(error.may_pass() && error.to_string().contains("being copied"), "{error}");
    }
    let missing = open(None);
    assert!(missing.may_pass() && missing.to_string().contains("cannot read"), "{missing}");

    let mut damaged = saved.bytes.clone();
    damaged[saved.bytes.len() / 2] ^= 1;
    let mut newer = saved.bytes.clone();
    newer[8] = 200;
    for bytes in [&damaged[..], &newer, b"glTF, not a scene"] {
        let error = open(Some(bytes));
        assert!(!error.may_pass(), "{error}");
    }
    let folder = Scene::open(saved.folder.path()).unwrap_err();
    assert!(!folder.may_pass() && folder.to_string().contains("not a regular file"), "{folder}");
}

/// A file that the kernel keeps from being written to needs no copy.
#[cfg(target_os = "linux")]
#[test]
fn a_sealed_file_is_mapped_and_an_open_one_is_not() {
    use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
    use std::os::fd::AsRawFd;

    let saved = Saved::new();
    let mapped = |seals: Option<SealFlags>| {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let mut file = File::from(memfd_create("sealed-plant", flags).unwrap());
        file.write_all(&saved.bytes).unwrap();
        if let Some(seals) = seals {
            fcntl_add_seals(&file, seals).unwrap();
        }
        let scene = Scene::open(Path::new(&format!("/proc/self/fd/{}", file.as_raw_fd()))).unwrap();
        assert!(saved.bytes_of(&scene) == saved.bytes);
        let first = scene.nodes().as_ptr().addr();
        let maps = fs::read_to_string("/proc/self/maps").unwrap();
        let line = maps.lines().find(|line| {
            let (start, rest) = line.split_once('-').unwrap();
            let end = rest.split(' ').next().unwrap();
            let range = [start, end].map(|hex| usize::from_str_radix(hex, 16).unwrap());
            (range[0]..range[1]).contains(&first)
        });
        line.unwrap().contains("sealed-plant")
    };
    assert!(mapped(Some(SealFlags::WRITE | SealFlags::SHRINK)));
    assert!(!mapped(Some(SealFlags::SHRINK)));
    assert!(!mapped(None));
}
