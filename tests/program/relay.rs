//! The program as a relay: displays that watch show the pictures of the one that leads, bit by bit.

use std::fs;

use crate::common::program::{Bench, Process};

/// An endpoint in a line of output.
fn endpoint(process: &mut Process, words: &str) -> String {
    let line = process.says(words);
    let at = line.find("tcp://").unwrap_or_else(|| panic!("{line}"));
    line[at..].split_whitespace().next().unwrap().to_owned()
}

#[test]
fn watchers_behind_two_relays_show_the_last_picture_of_the_walk() {
    let bench = Bench::with_plant(200);
    let any = "tcp://127.0.0.1:0";
    let mut culler = bench.start(&["role", "culler", "--scene", "plant.scene", "--listen", any]);
    let culler_at = endpoint(&mut culler, "the culler listens on");
    let mut root = bench.start(&["role", "relay", "--upstream", &culler_at, "--listen", any]);
    let root_at = endpoint(&mut root, "the relay listens on");
    let mut leaf = bench.start(&["role", "relay", "--upstream", &root_at, "--listen", any]);
    let leaf_at = endpoint(&mut leaf, "the relay listens on");
    let walk = ["--scene", "plant.scene", "--cullers", &root_at, "--frames", "12", "--audit-every", "0"];
    let size = ["--width", "128", "--height", "96", "--out", "walk"];
    bench.done(&[&["role", "display"], &walk[..], &size].concat());
    // They come late, to either relay.
    for (at, name) in [(&root_at, "root.png"), (&leaf_at, "leaf.png")] {
        let args = ["role", "watcher", "--scene", "plant.scene", "--relay", at, "--picture", name];
        let mut command = bench.command(&args);
        let mut watcher = Process::start(command.env("TRIMARAN_LOG", "info"));
        watcher.says("the first picture is shown");
        watcher.signal("INT");
        watcher.ends(0);
        let shown = fs::read(bench.path("walk/frames/00011.png")).unwrap();
        assert!(fs::read(bench.path(name)).unwrap() == shown, "{name} is another picture");
    }
}
