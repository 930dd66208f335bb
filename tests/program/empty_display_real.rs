//! Displays without the scene, on real models: with little memory, with evictions, and with roles lost
//! meanwhile, they show the same as a display with the scene.

use std::{fs, path::PathBuf, thread, time::Duration};

use trimaran_scene::random::Random;

use crate::common::data::Data;
use crate::common::ports::unused_port;
use crate::common::program::{Bench, Process};
use crate::common::scenes::scene_file;

/// One picture in this many of the long walk is kept.
const KEPT_EVERY: usize = 50;

fn picture(bench: &Bench, out: &str, frame: usize) -> Vec<u8> {
    let path = bench.path(out).join(format!("frames/{frame:05}.png"));
    fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Walks through the model's scene on three paths, each with another display and other cullers.
fn walks_at_random(files: &[PathBuf]) {
    const FRAMES: usize = 16;
    let bench = Bench::empty();
    fs::copy(scene_file(files), bench.path("model.scene")).unwrap();
    for seed in 1..4 {
        let mut random = Random::new(seed);
        let mut pick = |from: &[&'static str]| from[random.below(from.len())];
        let cache = pick(&["1MiB", "4MiB", "64MiB"]);
        let (link, cullers) = (pick(&["tcp", "quic", "udp"]), pick(&["1", "2", "3"]));
        let schedule = if cullers == "2" { pick(&["independent", "switch"]) } else { "independent" };
        let seed = seed.to_string();
        let walk = ["run", "model.scene", "--frames", "16", "--size", "192x192"];
        let walk = [&walk[..], &["--seed", &seed, "--cullers", cullers, "--schedule", schedule]].concat();
        let (whole, empty) = (format!("whole-{seed}"), format!("empty-{seed}"));
        // Its pictures are the same as those below, which are all checked.
        bench.done(&[&walk[..], &["--audit-every", "0", "--out", &whole]].concat());
        let with = ["--empty-display", "--geometry-cache", cache, "--link", link];
        bench.done(&[&walk[..], &with, &["--audit-every", "1", "--out", &empty]].concat());
        let what = format!("seed {seed}, {cache}, {link}, {cullers} cullers, {schedule}");
        let report = bench.report(&empty);
        assert_eq!(report["summary"]["cut_mismatch_pixels_total"], 0, "{what}");
        assert_eq!(report["summary"]["audited_frames"], FRAMES, "{what}");
        for frame in 0..FRAMES {
            assert!(picture(&bench, &empty, frame) == picture(&bench, &whole, frame), "{what}: {frame}");
        }
        let geometry = report["summary"]["bytes_by_kind"]["geometry"].as_u64().unwrap();
        println!("{what}: {geometry} bytes of geometry, {FRAMES} pictures alike");
    }
}

#[test]
fn the_platform_with_little_memory_shows_the_same() {
    if let Some(data) = Data::find() {
        walks_at_random(&data.platform());
    }
}

#[test]
fn a_model_of_instances_with_little_memory_shows_the_same() {
    if let Some(data) = Data::find() {
        walks_at_random(&[data.unpacked("ldraw_town_hall_1.3Mtri.glb")]);
    }
}

/// Two cullers and a display, each a process. Each culler is lost once and comes again; the display is killed
/// in the middle, and begins anew with nothing.
#[test]
fn cullers_that_come_and_go_and_a_display_that_is_killed_change_no_picture() {
    let Some(data) = Data::find() else { return };
    const FRAMES: usize = 1000;
    let bench = Bench::empty();
    fs::copy(scene_file(&data.platform()), bench.path("model.scene")).unwrap();
    let walk = ["--frames", "1000", "--audit-every", "50"];
    bench.done(&[&["run", "model.scene", "--size", "160x160", "--out", "whole"][..], &walk].concat());
    let at = [(); 2].map(|()| format!("tcp://127.0.0.1:{}", unused_port()));
    let both = at.join(",");
    let start_culler = |place: usize| {
        let culler = ["role", "culler", "--scene", "model.scene", "--listen", &at[place]];
        let mut culler = start(&bench, &culler);
        culler.says("the culler listens on");
        culler
    };
    let display = ["role", "display", "--cullers", &both, "--path", "whole/report.json", "--out", "walk"];
    let size = ["--width", "160", "--height", "160", "--geometry-cache", "1MiB"];
    let display = [&display[..], &size, &walk].concat();
    let [first, second] = [0, 1].map(start_culler);
    let killed = start(&bench, &display);
    shows(&bench, 40);
    killed.kill();
    let mut again = start(&bench, &display);
    again.says("begins with nothing of the scene");
    // The killed one's records are moved aside.
    again.says("a walk before this one left no report");
    shows(&bench, 40);
    first.kill();
    again.says("culler 1 was lost before");
    let _first = start_culler(0);
    again.says("culler 1 came before");
    shows(&bench, 80);
    second.signal("INT");
    again.says("culler 2 was lost before");
    let _second = start_culler(1);
    again.says("culler 2 came before");
    again.ends(0);
    assert_eq!(bench.report("walk")["frames"].as_array().unwrap().len(), FRAMES);
    for frame in (0..FRAMES).step_by(KEPT_EVERY) {
        assert!(picture(&bench, "walk", frame) == picture(&bench, "whole", frame), "frame {frame}");
    }
}

/// Waits until this many frames of the walk are on disk.
fn shows(bench: &Bench, frames: usize) {
    let journal = bench.path("walk/unfinished/walk.jsonl");
    for _ in 0..20_000 {
        if fs::read_to_string(&journal).unwrap_or_default().matches("\n{\"frame\":").count() >= frames {
            return;
        }
        thread::sleep(Duration::from_millis(5));
    }
    panic!("the walk does not go on");
}

fn start(bench: &Bench, args: &[&str]) -> Process {
    let mut command = bench.command(args);
    Process::start(command.env("TRIMARAN_LOG", "info").env("TRIMARAN_LINK_IDLE_TIMEOUT_S", "3"))
}
