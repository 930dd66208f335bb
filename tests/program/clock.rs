//! The machine's clock is set while roles walk: nothing waits or measures by it.
//!
//! Needs libfaketime; without it the test says that it is skipped, and fails if `TRIMARAN_REQUIRE_FAKETIME`
//! is 1.

use std::{
    env, fs,
    path::Path,
    process::Output,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use crate::common::program::{Bench, printed};

/// Takes the place of the C library's clock: Debian's package libfaketime.
const FAKETIME: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";
const HOUR_MS: f64 = 3.6e6;

/// Walks in three processes while the clock jumps by twenty years, there and back, until the walk is over.
fn walk_through_time(bench: &Bench, transport: &str) -> Output {
    let clock = bench.path("clock");
    let set = |to: &str| {
        // Readers of the file during the write see the time before or the time after.
        bench.write("next", to);
        fs::rename(bench.path("next"), &clock).unwrap();
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
        let output = bench
            .command(&walk)
            .args(["--link", transport, "--out", transport])
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
    let bench = Bench::with_plant(300);
    for transport in ["unix", "tcp", "udp", "quic"] {
        printed(&walk_through_time(&bench, transport));
        let report = bench.report(transport);
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
