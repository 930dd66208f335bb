//! `trimaran ping`, both ends of it as processes.

use std::{fs, process::Output, thread, time::Duration};

use crate::common::program::{Bench, Process, printed};
use crate::doctor::as_present_user;

/// The answering end; it ends with the test.
struct Answering<'b> {
    bench: &'b Bench,
    endpoint: String,
    _process: Process,
}

impl<'b> Answering<'b> {
    fn start(bench: &'b Bench, endpoint: &str, more: &[&str]) -> Self {
        let mut process = bench.start(&[&["ping", "--answer", endpoint], more].concat());
        let line = process.says("answers pings on");
        let endpoint = line.trim().rsplit(' ').next().unwrap().to_owned();
        Self { bench, endpoint, _process: process }
    }

    fn ping(&self, more: &[&str]) -> Output {
        self.bench.trimaran(&[&["ping", &self.endpoint, "--interval", "0"], more].concat())
    }
}

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text)).concat()
}

#[test]
fn cameras_and_frames_go_there_and_back_over_every_transport() {
    let bench = Bench::empty();
    for name in ["here", "there"] {
        bench.done(&["keys", "new", name]);
    }
    let keys = |own: &'static str, peer: &'static str| ["--keys", own, "--peer", peer];
    for (endpoint, secured) in [
        ("tcp://127.0.0.1:0", false),
        (&format!("unix:{}", bench.path("ping.sock").display()), false),
        ("quic://127.0.0.1:0", true),
    ] {
        let (mut here, mut there) = (Vec::new(), Vec::new());
        if secured {
            here.extend(keys("here.key", "there.pub"));
            there.extend(keys("there.key", "here.pub"));
        }
        let answering = Answering::start(&bench, endpoint, &there);
        for (ids, bytes) in [("0", 2 * 72..2 * 72 + 20), ("3000", 2 * 3000..2 * 12_200)] {
            let output = answering.ping(&[&["--ids", ids, "--count", "4", "--json"], &here[..]].concat());
            let summary: serde_json::Value = serde_json::from_str(&printed(&output)).unwrap();
            assert_eq!((&summary["sent"], &summary["answered"]), (&4.into(), &4.into()), "{summary}");
            assert_eq!(summary["loss_percent"], 0.0);
            let us = |key: &str| summary[key].as_f64().unwrap();
            assert!(
                0.0 < us("min_us") && us("min_us") <= us("p50_us") && us("p50_us") <= us("max_us"),
                "{summary}"
            );
            assert!(bytes.contains(&(us("bytes") as i32)), "{endpoint}: {summary}");
        }
    }
}

#[test]
fn a_person_reads_a_histogram() {
    let bench = Bench::empty();
    let answering = Answering::start(&bench, "tcp://127.0.0.1:0", &[]);
    let text = said(&answering.ping(&["--count", "7"]));
    assert!(text.contains("linked in") && text.contains("7 sent, 7 answered, 0 lost (0.0 %)"), "{text}");
    assert!(text.contains("####") && text.contains("jitter"), "{text}");
}

#[test]
fn nobody_there_is_said_in_the_timeouts_time() {
    let bench = Bench::empty();
    let nobody = format!("unix:{}", bench.path("nobody.sock").display());
    let output = bench.trimaran(&["ping", &nobody, "--timeout", "0.2"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let expected = format!("no link to {nobody} within");
    assert!(said(&output).contains(&expected), "{}", said(&output));
    let bare = bench.trimaran(&["ping", "quic://127.0.0.1:1"]);
    assert_eq!(bare.status.code(), Some(2));
    assert!(said(&bare).contains("trimaran keys new"), "{}", said(&bare));
}

/// A ping and a check take part in nothing: the display's report has no culler.
#[test]
fn a_role_that_answers_is_success() {
    let bench = Bench::with_plant(60);
    let listens = |process: &mut Process| {
        let line = process.says("listens on");
        line.trim().rsplit(' ').next().unwrap().to_owned()
    };
    let scene = ["--scene", "plant.scene", "--listen", "tcp://127.0.0.1:0"];
    let mut culler = bench.start(&[&["role", "culler"], &scene[..]].concat());
    let size = ["--width", "32", "--height", "32", "--live", "1", "--out", "walk"];
    let mut display = bench.start(&[&["role", "display"], &scene[..], &size[..]].concat());
    let at = [&mut culler, &mut display].map(listens);
    for (role, at) in ["culler", "display"].into_iter().zip(&at) {
        let said = bench.done(&["ping", at]);
        assert!(said.starts_with(&format!("{at}: a {role} answers in ")), "{said}");
        let json = bench.done(&["ping", at, "--json"]);
        let answer: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(answer["role"], role, "{answer}");
        assert_eq!(answer["scene"].is_string(), role == "culler", "{answer}");
    }
    let file = format!(
        "scene = 'plant.scene'\nlisten = 'tcp://127.0.0.1:0'\ndisplays = '{}'\ncullers = '{}'\n",
        at[1], at[0]
    );
    bench.write("two.toml", file);
    let found = bench.trimaran(&[&["doctor", "--config", "two.toml"], as_present_user()].concat());
    let lines = String::from_utf8_lossy(&found.stdout);
    for peer in [
        format!("peer    displays: {} is a display\n", at[1]),
        format!("peer    cullers: {} is a culler, which has the same scene\n", at[0]),
    ] {
        assert!(lines.contains(&peer), "{lines}");
    }
    culler.signal("TERM");
    culler.ends(0);
    let journal = bench.path("walk/unfinished/walk.jsonl");
    while !fs::read_to_string(&journal).is_ok_and(|journal| journal.contains("\n{\"frame\":")) {
        thread::sleep(Duration::from_millis(5));
    }
    display.signal("TERM");
    display.ends(3);
    let notes = bench.report("walk")["run"]["notes"].to_string();
    assert!(!notes.contains("came before"), "{notes}");
}
