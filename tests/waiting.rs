//! What a role does not find yet is waited for: a scene that is being copied, a port in use, a full disk.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    net::TcpListener,
    process::{Child, ChildStderr, Command, Stdio},
};

use tempfile::TempDir;

/// A folder with a scene under another name than the role's configuration has.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let made = Command::new(env!("CARGO_BIN_EXE_trimaran"))
        .args(["generate", "plant", "--objects", "100", "-o", "whole.scene"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(made.status.success(), "{made:?}");
    folder
}

/// A display that waits for what is not there.
struct Display {
    child: Child,
    stderr: BufReader<ChildStderr>,
}

impl Display {
    fn start(folder: &TempDir, listen: &str, more: &[&str]) -> Self {
        let config =
            format!("scene = 'plant.scene'\nlisten = '{listen}'\nout = 'walk'\njoin_timeout_s = 600\n");
        fs::write(folder.path().join("display.toml"), config).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_trimaran"))
            .args(["role", "display", "--config", "display.toml"])
            .args(more)
            .current_dir(folder.path())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self { child, stderr }
    }

    /// Reads what it says up to a line that holds these words.
    fn says(&mut self, words: &[&str]) {
        let mut said = String::new();
        loop {
            let from = said.len();
            assert!(self.stderr.read_line(&mut said).unwrap() > 0, "{words:?} is not in: {said}");
            if words.iter().all(|word| said[from..].contains(word)) {
                return;
            }
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _gone = self.child.kill();
        let _gone = self.child.wait();
    }
}

const ANYWHERE: &str = "tcp://127.0.0.1:0";

#[test]
fn a_scene_that_is_being_copied_is_waited_for() {
    let folder = folder();
    let (whole, scene) = (folder.path().join("whole.scene"), folder.path().join("plant.scene"));
    let bytes = fs::read(&whole).unwrap();
    let mut display = Display::start(&folder, ANYWHERE, &[]);
    display.says(&["plant.scene", "trying again"]);
    fs::write(&scene, &bytes[..bytes.len() / 2]).unwrap();
    display.says(&["plant.scene", "cut short", "trying again"]);
    fs::write(&scene, &bytes).unwrap();
    display.says(&["the display listens on"]);
}

#[test]
fn a_port_in_use_is_waited_for() {
    let folder = folder();
    fs::rename(folder.path().join("whole.scene"), folder.path().join("plant.scene")).unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let mut display = Display::start(&folder, &format!("tcp://{address}"), &[]);
    display.says(&[&address.to_string(), "in use", "trying again"]);
    drop(taken);
    display.says(&["the display listens on", &address.to_string()]);
    drop(display);

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut display = Display::start(&folder, ANYWHERE, &["--metrics", &address]);
    display.says(&[&address, "trying again"]);
    drop(taken);
    display.says(&["metrics on", &address]);
    display.says(&["the display listens on"]);
}

#[test]
fn what_stays_away_ends_a_role_that_is_to_be_started_again() {
    let folder = folder();
    let mut display = Display::start(&folder, ANYWHERE, &["--join-timeout", "0.3"]);
    let mut said = String::new();
    display.stderr.read_to_string(&mut said).unwrap();
    assert_eq!(display.child.wait().unwrap().code(), Some(1), "{said}");
    assert_eq!(said.matches("trying again").count(), 1, "one line a reason: {said}");
    assert!(!folder.path().join("walk/unfinished").exists(), "nothing was recorded");
}

/// What waits for a scene, or for its cullers, ends at once when it is asked to.
#[test]
fn a_role_that_waits_obeys() {
    let folder = folder();
    for (scene, waits) in [("whole.scene", "trying again"), ("plant.scene", "the display listens on")] {
        let mut display = Display::start(&folder, ANYWHERE, &[]);
        display.says(&[waits]);
        let kill = format!("kill -TERM {}", display.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        assert_eq!(display.child.wait().unwrap().code(), Some(0), "{waits}");
        fs::rename(folder.path().join(scene), folder.path().join("plant.scene")).unwrap();
    }
    assert!(!folder.path().join("walk/unfinished").exists(), "nothing was recorded");
}

/// A folder on a file system of its own, of so many bytes, for as long as the command runs.
fn on_small_disk(folder: &TempDir, bytes: usize, script: &str) -> Command {
    let disk = folder.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = format!("mount -t tmpfs -o size={bytes} tmpfs disk && {script}");
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &mount]).current_dir(folder.path());
    command
}

#[test]
fn a_full_disk_ends_the_walk_with_its_report() {
    let folder = folder();
    fs::rename(folder.path().join("whole.scene"), folder.path().join("plant.scene")).unwrap();
    let program = env!("CARGO_BIN_EXE_trimaran");
    // The report is copied to where it can be read once the disk is gone.
    let script = format!(
        "{program} run plant.scene --out disk/walk --frames 3000 --size 128x128 --audit-every 1; code=$?; \
         ls -A disk/walk > listing; cp disk/walk/report.* . ; exit $code"
    );
    let run = on_small_disk(&folder, 6 << 20, &script).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    if said.contains("unshare failed") || said.contains("mount:") {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none(), "{said}");
        return println!("skipped: a disk of its own takes root: {said}");
    }
    assert_eq!(run.status.code(), Some(3), "{said}");
    assert!(said.contains("ended early") && said.contains("no space left"), "{said}");
    let listing = fs::read_to_string(folder.path().join("listing")).unwrap();
    assert_eq!(listing.split_whitespace().collect::<Vec<_>>(), ["frames", "report.html", "report.json"]);
    let report = fs::read(folder.path().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["summary"]["ended"]["how"], "not_recorded");
    let frames = report["frames"].as_array().unwrap();
    assert!((1..3000).contains(&frames.len()), "{}", frames.len());
    assert!(frames[0]["pictures"]["shown"].is_string());
}

#[test]
fn a_disk_that_is_full_already_is_waited_for() {
    let folder = folder();
    fs::rename(folder.path().join("whole.scene"), folder.path().join("plant.scene")).unwrap();
    let program = env!("CARGO_BIN_EXE_trimaran");
    let config = format!("scene = 'plant.scene'\nlisten = '{ANYWHERE}'\nout = 'disk/walk'\n");
    fs::write(folder.path().join("display.toml"), config).unwrap();
    let script = format!(
        "{program} role display --config display.toml --join-timeout 0.3; code=$?; ls -A disk/walk; exit $code"
    );
    let run = on_small_disk(&folder, 1 << 20, &script).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    if said.contains("unshare failed") || said.contains("mount:") {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none(), "{said}");
        return println!("skipped: a disk of its own takes root: {said}");
    }
    assert_eq!(run.status.code(), Some(1), "{said}");
    assert!(said.contains("no space left") && said.contains("trying again"), "{said}");
    assert!(run.stdout.is_empty(), "something was left behind: {run:?}");
}
