//! `trimaran sim` for users: its output and files, and its refusals with their messages.

use std::fs;
use std::process::{Command, Output, Stdio};

use crate::common::program::{Bench, said};

impl Bench {
    /// A short simulation over TCP, unless `words` override it.
    fn simulation(&self, words: &[&str]) -> Command {
        let mut command = self.command(&[&["sim"], words].concat());
        let mut usual = |flag: &str, value: &str| {
            if !words.contains(&flag) {
                command.args([flag, value]);
            }
        };
        usual("--frames", "3");
        usual("--link", "tcp");
        command
    }

    fn sim(&self, words: &[&str]) -> Output {
        self.simulation(words).output().unwrap()
    }

    /// Runs a simulation that must end with `code`, with all of `expected` in its output.
    fn fails(&self, words: &[&str], code: i32, expected: &[&str]) {
        let output = self.sim(words);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(code), "{words:?}: {said}");
        for part in expected {
            assert!(said.contains(part), "{words:?}: {part:?} is not in: {said}");
        }
        assert!(output.stdout.is_empty() && !said.contains("panicked"), "{words:?}: {said}");
    }

    /// Writes a network with such links.
    fn network(&self, link: &str) {
        self.write("mine.toml", format!("about = \"a\"\nsources = []\n[up]\n{link}\n"));
    }
}

#[test]
fn flags_that_make_no_sense_are_refused_by_name() {
    let bench = Bench::empty();
    for flag in ["--or-ms", "--hc-ms", "--rvg-ms", "--udp-deadline-ms"] {
        for value in ["-1", "nan", "60001"] {
            bench.fails(&[flag, value], 2, &[flag, value, "milliseconds from 0 to 60000"]);
        }
    }
    for (words, expected) in [
        (&["--network", "token-ring"][..], &["token-ring", "fast-ethernet, gigabit"][..]),
        (&["--network", "none.toml"], &["cannot read the network none.toml"]),
        (&["--link", "carrier"], &["--link", "udp-deadline"]),
        (&["--batch", "0"], &["--batch", "1..=16384"]),
        (&["--nodes", "100000001"], &["--nodes"]),
        (&["--frames", "0"], &["--frames"]),
        (&["--seed", "first"], &["--seed", "first"]),
        (&["--udp-repair", "101"], &["--udp-repair", "0..=100"]),
        (&["--trace", "none.trace"], &["cannot read none.trace"]),
        (&["--trace", "none.trace", "--nodes", "5"], &["--trace", "--nodes"]),
        (&["--coding", "changes"], &["--coding changes needs --trace"]),
        (&["--scene", "a.scene"], &["--trace"]),
        (&["--device", "any"], &["--scene"]),
    ] {
        bench.fails(words, 2, expected);
    }
}

#[test]
fn a_network_that_cannot_be_is_refused_by_its_key() {
    let bench = Bench::empty();
    for (link, expected) in [
        ("rate = \"0 bit/s\"", "\"0 bit/s\" is no rate"),
        ("mtu = 500", "the key `up.mtu` is below 576 bytes"),
        ("phases_from = \"none.csv\"", "the key `up.phases_from` names none.csv, which cannot be read"),
    ] {
        bench.network(link);
        bench.fails(&["--network", "mine.toml"], 2, &["mine.toml", expected]);
    }
}

#[test]
fn a_network_that_nothing_gets_through_is_told_by_the_keys_that_may_be_why() {
    let bench = Bench::empty();
    bench.network("loss = { independent = 1.0 }");
    let keys = "nothing gets through mine.toml over tcp: look at its keys rate, loss, queue and mtu";
    bench.fails(&["--network", "mine.toml"], 1, &[keys]);
    bench.network("mtu = 600");
    let keys = "nothing gets through mine.toml over quic: look at its keys rate, loss, queue and mtu";
    bench.fails(&["--network", "mine.toml", "--link", "quic"], 1, &[keys, "packets of 1228 bytes"]);
}

#[test]
fn a_place_that_cannot_be_written_to_is_named_before_anything_is_simulated() {
    let bench = Bench::empty();
    bench.write("file", "a file");
    for flag in ["--out", "--pcap"] {
        // This many frames would take a minute.
        for (place, why) in [("file", "File exists"), ("file/below", "Not a directory")] {
            let words = [flag, place, "--frames", "1000000"];
            bench.fails(&words, 1, &[&format!("cannot write to {place}: {why}")]);
        }
    }
    fs::create_dir_all(bench.path("out/runs.csv")).unwrap();
    bench.fails(&["--out", "out"], 1, &["cannot write to out", "Is a directory"]);
    assert_eq!(fs::read_to_string(bench.path("file")).unwrap(), "a file");
}

#[test]
fn seeds_are_taken_once_each_and_in_order() {
    let bench = Bench::empty();
    let output = bench.sim(&["--seed", "7,3,7,3", "--json", "--out", "out"]);
    assert!(output.status.success() && output.stderr.is_empty(), "quiet in a pipe: {output:?}");
    let runs: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let seeds: Vec<u64> =
        runs.as_array().unwrap().iter().map(|run| run["seeds"][0].as_u64().unwrap()).collect();
    assert_eq!(seeds, [3, 7]);
    let csv = fs::read_to_string(bench.path("out/runs.csv")).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    // Pooled: one row, with both seeds and twice three frames.
    assert!(
        lines.len() == 2 && lines[1].starts_with("fast-ethernet,tcp,2,independent,plain,4000,1024,3 7,6,"),
        "{csv}"
    );
    assert_eq!(lines[0].split(',').count(), lines[1].split(',').count(), "{csv}");
    assert_eq!(fs::read_to_string(bench.path("out/frames.csv")).unwrap().lines().count(), 1 + 6);
    let saved: serde_json::Value =
        serde_json::from_slice(&fs::read(bench.path("out/sim.json")).unwrap()).unwrap();
    assert_eq!(saved, runs);
}

#[test]
fn whoever_stops_reading_ends_it_without_a_panic() {
    let bench = Bench::empty();
    for words in [&[][..], &["--json"]] {
        let mut child =
            bench.simulation(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!((output.status.code(), said(&output).as_str()), (Some(0), ""), "{words:?}");
    }
}

#[test]
fn a_deadline_that_is_over_before_anything_can_have_come_is_warned_of() {
    let bench = Bench::empty();
    let words =
        ["--link", "udp-deadline", "--network", "wifi,gigabit", "--udp-deadline-ms", "2", "--out", "out"];
    let output = bench.sim(&words);
    assert!(output.status.success(), "{output:?}");
    let said = said(&output);
    // Once, and not by each link as well.
    let warnings: Vec<&str> = said.lines().collect();
    let [warning] = warnings[..] else { unreachable!("one network is that slow: {said}") };
    assert!(
        warning
            .contains("over udp-deadline may take 2ms, and by wifi the way to the display alone takes 2ms")
            && warning.contains("--udp-deadline-ms"),
        "{warning}"
    );
    let page = fs::read_to_string(bench.path("out/sim.html")).unwrap();
    assert_eq!(page.matches("udp-deadline/2ms: a frame may take no longer than the way").count(), 1);
}

#[test]
fn flags_for_links_that_are_not_asked_for_are_warned_of() {
    let output = Bench::empty().sim(&["--udp-deadline-ms", "20", "--udp-repair", "5", "--udp-in-the-clear"]);
    let said = said(&output);
    for flag in ["--udp-deadline-ms", "--udp-repair", "--udp-in-the-clear"] {
        assert!(said.contains(&format!("{flag} changes nothing")), "{said}");
    }
}
