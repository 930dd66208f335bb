//! A scene larger than its memory limit: `trimaran run` in a control group.
//!
//! Needs Linux and a memory controller that this process may limit; elsewhere the test says that it is
//! skipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use trimaran_cook::generate::{TankerOptions, tanker};
use trimaran_cook::{CookOptions, cook};
use trimaran_scene::Scene;
use trimaran_scene::path::{AutoPathOptions, auto};

/// The memory limit of the process. A session with its drivers takes about 100 MB of it. The unpacked scene
/// takes more than twice the limit.
const LIMIT: u64 = 160 << 20;

const FRAMES: u32 = 24;

/// A control group that limits memory, removed when it is dropped.
struct Group(PathBuf);

impl Group {
    /// `None` if there is no usable controller.
    fn new(limit: u64) -> Option<Self> {
        let own = fs::read_to_string("/proc/self/cgroup").ok()?;
        let (first, second) = own.lines().find_map(|line| {
            let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
            let path = path.trim_start_matches('/');
            match controllers {
                "memory" => Some((Path::new("/sys/fs/cgroup/memory").join(path), "memory.limit_in_bytes")),
                "" => Some((Path::new("/sys/fs/cgroup").join(path), "memory.max")),
                _ => None,
            }
        })?;
        let group = Self(first.join(format!("trimaran-test-{}", std::process::id())));
        fs::create_dir(&group.0).ok()?;
        fs::write(group.0.join(second), limit.to_string()).ok()?;
        Some(group)
    }

    /// The command, run within the group.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("sh");
        let enter = format!("echo $$ >'{}' && exec \"$0\" \"$@\"", self.0.join("cgroup.procs").display());
        command.args(["-c", &enter, program]);
        command
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = fs::remove_dir(&self.0);
    }
}

/// Walks the scene along the path, and returns the pictures.
fn walk(mut command: Command, scene: &Path, path: &Path, out: &Path, more: &[&str]) -> Vec<Vec<u8>> {
    command.arg("run").arg(scene).arg("--path").arg(path).arg("--out").arg(out);
    command.args(["--audit-every", "0", "--size", "480x360", "--frames", &FRAMES.to_string()]);
    let run = command.args(more).output().unwrap();
    assert!(run.status.success(), "{}: {}", run.status, String::from_utf8_lossy(&run.stderr));
    let picture = |frame: u32| fs::read(out.join(format!("frames/{frame:05}.png"))).unwrap();
    (0..FRAMES).map(picture).collect()
}

#[test]
fn a_scene_larger_than_its_memory_shows_the_same_pictures() {
    let Some(_) = crate::common::devices() else { return };
    let Some(group) = Group::new(LIMIT) else {
        println!("skipped: no control group for memory can be made here");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let [scene, path] = ["tanker.scene", "path.json"].map(|name| folder.path().join(name));
    let model = tanker(&TankerOptions { seed: 1, objects: 320_000, triangles: 32_000_000 });
    let cooked = cook(&model, &CookOptions::default(), &()).unwrap();
    drop(model);
    cooked.save(&scene).unwrap();
    let unpacked = cooked.resident_bytes() + cooked.totals().stored_triangles * 32;
    assert!(unpacked > 2 * LIMIT, "{unpacked} bytes");
    drop(cooked);
    let found = auto(
        &Scene::open(&scene).unwrap(),
        &AutoPathOptions { frames: FRAMES, ..AutoPathOptions::default() },
    );
    fs::write(&path, found.unwrap().path.to_json()).unwrap();

    let trimaran = env!("CARGO_BIN_EXE_trimaran");
    let [free, limited] = ["free", "limited"].map(|name| folder.path().join(name));
    let expected = walk(Command::new(trimaran), &scene, &path, &free, &[]);
    let found = walk(group.command(trimaran), &scene, &path, &limited, &["--gpu-memory", "4MiB"]);
    assert!(expected.iter().any(|picture| *picture != expected[0]), "the camera moves");
    let differ = (0..FRAMES as usize).filter(|&frame| expected[frame] != found[frame]);
    assert_eq!(differ.collect::<Vec<_>>(), Vec::<usize>::new());
}
