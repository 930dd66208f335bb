//! A role waits for missing things: a scene that is being copied, a port in use, a full disk.

use std::{fs, net::TcpListener, process::Command};

use crate::common::program::{Bench, Process, said};

/// A folder with a scene under another name than the role's configuration has.
fn folder() -> Bench {
    let bench = Bench::with_plant(100);
    fs::rename(bench.path("plant.scene"), bench.path("whole.scene")).unwrap();
    bench
}

/// A display that waits for something missing.
fn wait(bench: &Bench, listen: &str, more: &[&str]) -> Process {
    bench.write(
        "display.toml",
        format!("scene = 'plant.scene'\ncullers = 'tcp://127.0.0.1:1'\nlisten = '{listen}'\nout = 'walk'\njoin_timeout_s = 600\n"),
    );
    bench.start(&[&["role", "display", "--config", "display.toml"], more].concat())
}

const ANYWHERE: &str = "tcp://127.0.0.1:0";

#[test]
fn a_scene_that_is_being_copied_is_waited_for() {
    let bench = folder();
    let bytes = fs::read(bench.path("whole.scene")).unwrap();
    let mut display = wait(&bench, ANYWHERE, &[]);
    display.says_all(&["plant.scene", "trying again"]);
    bench.write("plant.scene", &bytes[..bytes.len() / 2]);
    display.says_all(&["plant.scene", "cut short", "trying again"]);
    bench.write("plant.scene", &bytes);
    display.says_all(&["the display listens on"]);
}

#[test]
fn a_port_in_use_is_waited_for() {
    let bench = Bench::with_plant(100);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let mut display = wait(&bench, &format!("tcp://{address}"), &[]);
    display.says_all(&[&address.to_string(), "in use", "trying again"]);
    drop(taken);
    display.says_all(&["the display listens on", &address.to_string()]);
    drop(display);

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut display = wait(&bench, ANYWHERE, &["--metrics", &address]);
    display.says_all(&[&address, "trying again"]);
    drop(taken);
    display.says_all(&["metrics on", &address]);
    display.says_all(&["the display listens on"]);
}

#[test]
fn what_stays_away_ends_a_role_that_is_to_be_started_again() {
    let bench = folder();
    let said = wait(&bench, ANYWHERE, &["--join-timeout", "0.3"]).ends(1);
    assert_eq!(said.matches("trying again").count(), 1, "one line a reason: {said}");
    assert!(!bench.path("walk/unfinished").exists(), "nothing was recorded");
}

/// A role that waits for a scene, or for its cullers, stops at once on request.
#[test]
fn a_role_that_waits_obeys() {
    let bench = folder();
    for (scene, waits) in [("whole.scene", "trying again"), ("plant.scene", "the display listens on")] {
        let mut display = wait(&bench, ANYWHERE, &[]);
        display.says_all(&[waits]);
        display.signal("TERM");
        display.ends(0);
        fs::rename(bench.path(scene), bench.path("plant.scene")).unwrap();
    }
    assert!(!bench.path("walk/unfinished").exists(), "nothing was recorded");
}

/// A folder on a file system of its own, of this many bytes, for as long as the command runs.
fn on_small_disk(bench: &Bench, bytes: usize, script: &str) -> Command {
    fs::create_dir(bench.path("disk")).unwrap();
    let mount = format!("mount -t tmpfs -o size={bytes} tmpfs disk && {script}");
    bench.command_of("unshare", &["--mount", "sh", "-c", &mount])
}

#[test]
fn a_full_disk_ends_the_walk_with_its_report() {
    let bench = Bench::with_plant(100);
    let program = env!("CARGO_BIN_EXE_trimaran");
    // The report is copied to a place that outlives the disk.
    let script = format!(
        "{program} run plant.scene --out disk/walk --frames 3000 --size 128x128 --audit-every 1; code=$?; \
         ls -A disk/walk > listing; cp disk/walk/report.* . ; exit $code"
    );
    let run = on_small_disk(&bench, 6 << 20, &script).output().unwrap();
    let said = said(&run);
    if said.contains("unshare failed") || said.contains("mount:") {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none(), "{said}");
        return println!("skipped: a disk of its own takes root: {said}");
    }
    assert_eq!(run.status.code(), Some(3), "{said}");
    assert!(said.contains("ended early") && said.contains("no space left"), "{said}");
    let listing = fs::read_to_string(bench.path("listing")).unwrap();
    assert_eq!(listing.split_whitespace().collect::<Vec<_>>(), ["frames", "report.html", "report.json"]);
    let report = bench.report("");
    assert_eq!(report["summary"]["ended"]["how"], "not_recorded");
    let frames = report["frames"].as_array().unwrap();
    assert!((1..3000).contains(&frames.len()), "{}", frames.len());
    assert!(frames[0]["pictures"]["shown"].is_string());
}

#[test]
fn a_disk_that_is_full_already_is_waited_for() {
    let bench = Bench::with_plant(100);
    let program = env!("CARGO_BIN_EXE_trimaran");
    let config = format!("scene = 'plant.scene'\nlisten = '{ANYWHERE}'\nout = 'disk/walk'\n");
    bench.write("display.toml", config);
    let script = format!(
        "{program} role display --config display.toml --join-timeout 0.3; code=$?; ls -A disk/walk; exit $code"
    );
    let run = on_small_disk(&bench, 1 << 20, &script).output().unwrap();
    let said = said(&run);
    if said.contains("unshare failed") || said.contains("mount:") {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none(), "{said}");
        return println!("skipped: a disk of its own takes root: {said}");
    }
    assert_eq!(run.status.code(), Some(1), "{said}");
    assert!(said.contains("no space left") && said.contains("trying again"), "{said}");
    assert!(run.stdout.is_empty(), "something was left behind: {run:?}");
}
