//! A clock of the machine that is set while roles walk: nothing waits or measures by it.
//!
//! Needs libfaketime; without it the test says that it is skipped, and fails if `TRIMARAN_REQUIRE_FAKETIME`
//! is 1.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::{
    env, fs,
    path::Path,
    process::{Command, Output},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// Takes the place of the C library's clock: Debian's package libfaketime.
const FAKETIME: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";
const HOUR_MS: f64 = 3.6e6;

/// Walks in three processes while the clock jumps by twenty years, there and back, until the walk is over.
fn walk_through_time(folder: &Path, transport: &str) -> Output {
    let clock = folder.join("clock");
    let set = |to: &str| {
        // Whoever reads the file while it is written sees the time before or the time after.
        fs::write(folder.join("next"), to).unwrap();
        fs::rename(folder.join("next"), &clock).unwrap();
    };
    set("+0");
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            for years in [10, -10].into_iter().cycle() {
                if over.load(Ordering::Relaxed) {
                    return;
                }
                set(&format!("{:+}d", years * 365));
                thread::sleep(Duration::from_millis(20));
            }
        });
        let walk = ["run", "plant.scene", "--frames", "200", "--size", "64x64", "--audit-every", "50"];
        let output = Command::new(env!("CARGO_BIN_EXE_trimaran"))
            .args(walk)
            .args(["--link", transport, "--out", transport])
            .current_dir(folder)
            .env("LD_PRELOAD", FAKETIME)
            .env("FAKETIME_TIMESTAMP_FILE", &clock)
            .envs([("FAKETIME_NO_CACHE", "1"), ("FAKETIME_DONT_FAKE_MONOTONIC", "1")])
            .output();
        over.store(true, Ordering::Relaxed);
        output.unwrap()
    })
}

#[test]
fn a_clock_that_jumps_by_years_changes_nothing() {
    if !Path::new(FAKETIME).exists() {
        let required = env::var_os("TRIMARAN_REQUIRE_FAKETIME").is_some_and(|value| value == "1");
        assert!(!required, "{FAKETIME} is not there");
        return println!("skipped: {FAKETIME} is not there");
    }
    let folder = tempfile::tempdir().unwrap();
    let make = ["generate", "plant", "--objects", "300", "-o", "plant.scene"];
    let made = Command::new(env!("CARGO_BIN_EXE_trimaran")).args(make).current_dir(&folder).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    for transport in ["unix", "tcp", "udp", "quic"] {
        let output = walk_through_time(folder.path(), transport);
        assert!(output.status.success(), "{transport}: {}", String::from_utf8_lossy(&output.stderr));
        let report = fs::read(folder.path().join(transport).join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        assert_eq!(report["summary"]["ended"]["how"], "finished", "{transport}");
        let frames = report["frames"].as_array().unwrap();
        assert_eq!(frames.len(), 200, "{transport}");
        for frame in frames {
            for (name, value) in frame.as_object().unwrap() {
                let ms = value.as_f64().filter(|_| name.ends_with("_ms")).unwrap_or_default();
                assert!((0.0..HOUR_MS).contains(&ms), "{transport}: {name} of {frame}");
            }
        }
    }
}
