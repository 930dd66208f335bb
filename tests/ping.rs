//! `trimaran ping`, both ends of it as processes.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Output, Stdio};

fn trimaran(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trimaran"));
    command.current_dir(folder).args(args);
    command
}

/// The answering end; it ends with the test.
struct Answering {
    child: Child,
    endpoint: String,
    /// Open for as long as it may have something to say.
    _stderr: BufReader<ChildStderr>,
}

impl Answering {
    fn start(folder: &Path, endpoint: &str, more: &[&str]) -> Self {
        let mut command = trimaran(folder, &[&["ping", "--answer", endpoint], more].concat());
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        stderr.read_line(&mut line).unwrap();
        let endpoint = line.trim().rsplit(' ').next().unwrap().to_owned();
        assert!(line.contains("answers pings on"), "{line}");
        Self { child, endpoint, _stderr: stderr }
    }

    fn ping(&self, folder: &Path, more: &[&str]) -> Output {
        trimaran(folder, &[&["ping", &self.endpoint, "--interval", "0"], more].concat()).output().unwrap()
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text)).concat()
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", said(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn cameras_and_frames_go_there_and_back_over_every_transport() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["here", "there"] {
        assert!(trimaran(folder.path(), &["keys", "new", name]).output().unwrap().status.success());
    }
    let keys = |own: &'static str, peer: &'static str| ["--keys", own, "--peer", peer];
    for (endpoint, secured) in [
        ("tcp://127.0.0.1:0", false),
        (&format!("unix:{}/ping.sock", folder.path().display()), false),
        ("quic://127.0.0.1:0", true),
    ] {
        let (mut here, mut there) = (Vec::new(), Vec::new());
        if secured {
            here.extend(keys("here.key", "there.pub"));
            there.extend(keys("there.key", "here.pub"));
        }
        let answering = Answering::start(folder.path(), endpoint, &there);
        for (ids, bytes) in [("0", 2 * 72..2 * 72 + 20), ("3000", 2 * 3000..2 * 12_200)] {
            let output = answering
                .ping(folder.path(), &[&["--ids", ids, "--count", "4", "--json"], &here[..]].concat());
            let summary = json(&output);
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
    let folder = tempfile::tempdir().unwrap();
    let answering = Answering::start(folder.path(), "tcp://127.0.0.1:0", &[]);
    let text = said(&answering.ping(folder.path(), &["--count", "7"]));
    assert!(text.contains("linked in") && text.contains("7 sent, 7 answered, 0 lost (0.0 %)"), "{text}");
    assert!(text.contains("####") && text.contains("jitter"), "{text}");
}

#[test]
fn nobody_there_is_said_in_the_timeouts_time() {
    let folder = tempfile::tempdir().unwrap();
    let nobody = format!("unix:{}", folder.path().join("nobody.sock").display());
    let output = trimaran(folder.path(), &["ping", &nobody, "--timeout", "0.2"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let expected = format!("no link to {nobody} within");
    assert!(said(&output).contains(&expected), "{}", said(&output));
    let bare = trimaran(folder.path(), &["ping", "quic://127.0.0.1:1"]).output().unwrap();
    assert_eq!(bare.status.code(), Some(2));
    assert!(said(&bare).contains("trimaran keys new"), "{}", said(&bare));
}
