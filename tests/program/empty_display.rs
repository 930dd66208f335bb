//! The program with a display that begins without the scene: culling is exact, and its pictures are those of
//! a display with the scene.

use std::fs;

use serde_json::Value;

use crate::common::ports::unused_port;
use crate::common::program::{Bench, said};

const FRAMES: usize = 6;
const WALK: [&str; 8] = ["run", "plant.scene", "--frames", "6", "--size", "128x128", "--audit-every", "1"];
/// The same by the clock.
const LIVE: [&str; 3] = ["--live", "20", "--empty-display"];
/// A link with a small window: over it frames are mostly shown before all of them has come.
const SLOW: [&str; 6] = ["--link", "udp", "-o", "udp.window=4096", "-o", "udp.send_buffer=4096"];

fn pictures(bench: &Bench, out: &str) -> Vec<Vec<u8>> {
    let picture = |frame| bench.path(out).join(format!("frames/{frame:05}.png"));
    (0..FRAMES).map(|frame| fs::read(picture(frame)).unwrap()).collect()
}

/// Walks with a display that has the scene.
fn with_the_scene(bench: &Bench) {
    bench.done(&[&WALK[..], &["--out", "whole"]].concat());
    let report = bench.report("whole");
    assert_eq!(report["summary"]["bytes_by_kind"]["geometry"].as_u64().unwrap_or(0), 0);
    assert!(pictures(bench, "whole").windows(2).any(|pair| pair[0] != pair[1]));
}

fn assert_exact(report: &Value, what: &str) {
    let summary = &report["summary"];
    for figure in ["false_culled_pixels_total", "cut_mismatch_pixels_total"] {
        assert_eq!(summary[figure], 0, "{what}: {figure} in {summary}");
    }
}

#[test]
fn over_every_link_a_display_without_the_scene_shows_what_one_with_it_shows() {
    let bench = Bench::with_plant(300);
    with_the_scene(&bench);
    for link in ["inproc", "unix", "tcp", "quic", "udp"] {
        let empty = ["--empty-display", "--geometry-cache", "1MiB", "--link", link, "--out", link];
        bench.done(&[&WALK[..], &empty].concat());
        let report = bench.report(link);
        assert_exact(&report, link);
        assert_eq!(report["frames"].as_array().unwrap().len(), FRAMES, "{link}");
        assert!(report["summary"]["bytes_by_kind"]["geometry"].as_u64().unwrap() > 0, "{link}");
        assert!(pictures(&bench, link) == pictures(&bench, "whole"), "{link}: other pictures");
    }
}

#[test]
fn a_display_of_its_own_needs_no_scene() {
    let bench = Bench::with_plant(300);
    with_the_scene(&bench);
    let at = format!("tcp://127.0.0.1:{}", unused_port());
    let mut culler = bench.start(&["role", "culler", "--scene", "plant.scene", "--listen", &at]);
    culler.says("the culler listens on");
    let display = ["role", "display", "--cullers", &at, "--path", "whole/report.json", "--out", "walk"];
    let size = ["--frames", "6", "--width", "128", "--height", "128", "--audit-every", "1"];
    let output = bench.trimaran(&[&display[..], &size].concat());
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(pictures(&bench, "walk") == pictures(&bench, "whole"), "other pictures");
    let report = bench.report("walk");
    assert_eq!(report["frames"].as_array().unwrap().len(), FRAMES);
    assert!(report["summary"]["bytes_by_kind"]["geometry"].as_u64().unwrap() > 0);
}

#[test]
fn glass_of_the_model_is_so_in_a_display_without_the_scene() {
    let bench = Bench::with_glass(FRAMES);
    // Hidden from frame 2 on, and solid from frame 4 on.
    bench.write(
        "states.toml",
        "[[change]]\nframe = 2\nhidden = [0]\n[[change]]\nframe = 4\nhidden = []\nsee_through = []\n",
    );
    let run = ["run", "glass.scene", "--path", "path.json", "--size", "128x128", "--audit-every", "1"];
    let walk = |out: &str, more: &[&str]| {
        bench.done(&[&run[..], more, &["--out", out]].concat());
        pictures(&bench, out)
    };
    let changing = walk("changing", &["--state", "states.toml"]);
    assert!(changing[0] != changing[2] && changing[2] != changing[4] && changing[0] != changing[4]);
    let empty = walk("empty", &["--state", "states.toml", "--empty-display", "--link", "tcp"]);
    assert!(empty == changing, "other pictures");
    let shown = walk("shown", &[]);
    assert!(shown[0] == changing[0] && shown[4] == shown[0]);
    let at = format!("tcp://127.0.0.1:{}", unused_port());
    let mut culler = bench.start(&["role", "culler", "--scene", "glass.scene", "--listen", &at]);
    culler.says("the culler listens on");
    let display = ["role", "display", "--cullers", &at, "--path", "path.json", "--out", "alone"];
    bench.done(&[&display[..], &["--width", "128", "--height", "128", "--audit-every", "1"]].concat());
    assert!(pictures(&bench, "alone") == shown, "other pictures in a process of its own");
}

#[test]
fn a_display_without_the_scene_needs_cullers_and_a_path() {
    let bench = Bench::empty();
    for (more, words) in [
        (&["--cullers", "tcp://127.0.0.1:1"][..], ["session.path", "give a path file"]),
        (&["--path", "path.json"][..], ["scene", "culler"]),
    ] {
        let output = bench.trimaran(&[&["role", "display", "--out", "walk"], more].concat());
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
        assert!(!bench.path("walk").exists(), "something was left behind");
    }
}

#[test]
fn a_walk_with_an_empty_display_needs_a_culler() {
    let bench = Bench::with_plant(30);
    let output =
        bench.trimaran(&["run", "plant.scene", "--empty-display", "--cullers", "0", "--out", "walk"]);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("give --cullers 1 or more"), "{said}");
    assert!(!bench.path("walk").exists(), "something was left behind");
}

#[test]
fn a_live_display_without_the_scene_is_exact_but_for_what_it_says_it_lacks() {
    let bench = Bench::with_plant(1000);
    for (link, more) in [("inproc", &["--while-loading", "coarser"][..]), ("udp", &SLOW)] {
        let text = bench.done(&[&WALK[..], &LIVE, more, &["--out", link]].concat());
        let report = bench.report(link);
        let frames = report["frames"].as_array().unwrap();
        assert!(!frames.is_empty());
        let mut before: Option<&Value> = None;
        for (number, frame) in frames.iter().enumerate() {
            let at = format!("{link}: {frame}");
            assert_eq!(frame["frame"], number, "{at}");
            if frame["lacking"] == 0 {
                assert_eq!(
                    (&frame["cut_mismatch_pixels"], &frame["false_culled_pixels"]),
                    (&0.into(), &0.into()),
                    "{at}"
                );
                assert!(frame["loading_pixels"].is_null() && !frame["full_detail"].is_null(), "{at}");
            } else {
                assert!(frame["loading_pixels"].is_u64(), "{at}");
                assert!(frame["cut_mismatch_pixels"].is_null() && frame["full_detail"].is_null(), "{at}");
            }
            let again = frame["again"].as_bool().unwrap();
            assert_eq!((frame["latency_ms"].is_null(), frame["bytes"].is_null()), (again, again), "{at}");
            assert!(again || frame["bytes"].as_u64() > Some(0), "{at}");
            if again {
                let before = before.unwrap();
                assert_eq!(
                    ["eye", "forward"].map(|key| &frame[key]),
                    ["eye", "forward"].map(|key| &before[key])
                );
                assert!(frame["lacking"].as_u64() < before["lacking"].as_u64(), "{at}");
            }
            before = Some(frame);
        }
        let lacking = frames.iter().filter(|frame| frame["lacking"] != 0).count();
        let loading = &report["summary"]["loading"];
        assert_eq!(loading["frames"].as_u64().unwrap_or(0), lacking as u64, "{link}");
        assert_eq!(loading.is_null(), lacking == 0, "{link}");
        assert_eq!(text.contains("\nloading "), lacking > 0, "{text}");
    }
}

#[test]
fn a_live_display_that_waits_lacks_nothing() {
    let bench = Bench::with_plant(1000);
    let waits = ["--while-loading", "wait", "--record", "walk.trace", "--out", "walk"];
    bench.done(&[&WALK[..], &LIVE, &SLOW, &waits].concat());
    assert!(bench.path("walk.trace").exists());
    let report = bench.report("walk");
    assert_exact(&report, "waits");
    let frames = report["frames"].as_array().unwrap();
    assert!(!frames.is_empty());
    assert!(frames.iter().all(|frame| frame["lacking"] == 0 && frame["again"] == false));
    assert!(report["summary"]["loading"].is_null());
}

#[test]
fn what_is_shown_while_loading_is_asked_of_live_displays_that_begin_empty() {
    let bench = Bench::with_plant(30);
    for (more, words) in [
        (&["--live", "30"][..], &["--while-loading", "add --empty-display"][..]),
        (&["--empty-display"], &["--while-loading", "add --live", "In lockstep the display always waits"]),
    ] {
        for what in ["wait", "coarser"] {
            let output = bench.trimaran(
                &[&["run", "plant.scene", "--while-loading", what, "--out", "walk"], more].concat(),
            );
            let said = said(&output);
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(words.iter().all(|word| said.contains(word)), "{said}");
            assert!(!bench.path("walk").exists(), "something was left behind");
        }
    }
    let output = bench.trimaran(&[
        "run",
        "plant.scene",
        "--empty-display",
        "--live",
        "30",
        "--while-loading",
        "guess",
    ]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("coarser, wait"), "{}", said(&output));
}
