//! A session of three processes that loses one of them: it goes on with the frame that was due once all have joined again, or begins
//! when all are there.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

#[path = "../transport/tests/common/ports.rs"]
mod ports;

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::PathBuf,
    process::{Child, ChildStderr, Command, Stdio},
    thread,
    time::Duration,
};

use ports::unused_port;
use tempfile::TempDir;

/// How many frames the sessions have.
const FRAMES: usize = 1000;

/// A folder with a scene, keys and a configuration a role.
struct Deployment {
    dir: TempDir,
}

/// A running role and what it says.
struct Role {
    child: Child,
    stderr: BufReader<ChildStderr>,
    said: String,
}

impl Deployment {
    fn new(transport: &str) -> Self {
        let deployment = Self { dir: tempfile::tempdir().unwrap() };
        deployment.run(&["generate", "plant", "--objects", "300", "-o", "plant.scene"]);
        for name in ["display", "first", "second"] {
            deployment.run(&["keys", "new", name, "--out", "."]);
        }
        let [display, pair] = [(); 2].map(|()| format!("{transport}://127.0.0.1:{}", unused_port()));
        let write = |name: &str, text: String| fs::write(deployment.dir.path().join(name), text).unwrap();
        write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\nlisten = '{display}'\nout = 'walk'\nkeys = 'display.key'\nmetrics = '127.0.0.1:0'\n\
                 peers.first = 'first.pub'\npeers.second = 'second.pub'\n\
                 [session]\nframes = {FRAMES}\nwidth = 64\nheight = 64\naudit_every = 200\n"
            ),
        );
        for (seat, other) in [("first", "second"), ("second", "first")] {
            write(
                &format!("{seat}.toml"),
                format!(
                    "scene = 'plant.scene'\nseat = '{seat}'\ndisplay = '{display}'\npair = '{pair}'\nkeys = '{seat}.key'\n\
                     peers.display = 'display.pub'\npeers.other = '{other}.pub'\n"
                ),
            );
        }
        deployment
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trimaran"));
        command.args(args).current_dir(self.dir.path());
        command
    }

    fn run(&self, args: &[&str]) {
        assert!(self.command(args).output().unwrap().status.success(), "{args:?}");
    }

    fn start(&self, name: &str, more: &[&str]) -> Role {
        let kind = if name == "display" { "display" } else { "switch" };
        let mut command = self.command(&["role", kind, "--config", &format!("{name}.toml")]);
        // What is gone without a word is missed soon.
        command.env("TRIMARAN_LOG", "info").env("TRIMARAN_LINK_LEASE_S", "4");
        let mut child = command.args(more).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Role { child, stderr, said: String::new() }
    }

    fn report(&self) -> serde_json::Value {
        let path: PathBuf = self.dir.path().join("walk/report.json");
        serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
    }
}

impl Role {
    /// Reads what it says up to a line that holds `words`.
    fn says(&mut self, words: &str) -> String {
        loop {
            let mut line = String::new();
            assert!(self.stderr.read_line(&mut line).unwrap() > 0, "{words:?} is not in: {}", self.said);
            self.said.push_str(&line);
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Waits until this display has received so many frames from one of its machines.
    fn shows(&mut self, frames: u64) {
        let line = self.says("metrics on http://");
        let address = line.split("http://").nth(1).unwrap().split('/').next().unwrap().to_owned();
        loop {
            let mut stream = TcpStream::connect(&address).unwrap();
            stream.write_all(b"GET /links HTTP/1.0\r\n\r\n").unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            let links: serde_json::Value =
                serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
            if links[0]["received"]["frames"].as_u64().is_some_and(|received| received >= frames) {
                return;
            }
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Asks it to stop, as `systemctl restart` does.
    fn interrupt(&self) {
        let kill = format!("kill -TERM {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    }

    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    fn ends(mut self, code: i32) -> String {
        self.stderr.read_to_string(&mut self.said).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(code), "{}", self.said);
        self.said
    }
}

#[test]
fn a_machine_that_is_started_again_takes_its_place_and_no_frame_is_missing() {
    for (transport, lost, killed) in [
        ("tcp", "second", true),
        ("tcp", "first", false),
        ("quic", "second", true),
        ("quic", "second", false),
        ("udp", "first", true),
        ("udp", "second", false),
    ] {
        let deployment = Deployment::new(transport);
        let mut display = deployment.start("display", &[]);
        let kept = deployment.start(if lost == "first" { "second" } else { "first" }, &[]);
        let role = deployment.start(lost, &[]);
        display.shows(5);
        if killed {
            role.kill();
        } else {
            role.interrupt();
            role.ends(0);
        }
        let restarted = deployment.start(lost, &[]);
        assert!(kept.ends(0).contains("joining again"), "{transport}, {lost}, {killed}");
        restarted.ends(0);
        let said = display.ends(0);
        assert!(said.contains("waiting 60 s"), "{transport}, {lost}, {killed}: {said}");

        let report = deployment.report();
        let frames = report["frames"].as_array().unwrap();
        assert_eq!(frames.len(), FRAMES, "{transport}, {lost}, {killed}");
        assert_eq!(report["summary"]["ended"]["how"], "finished");
        for (number, frame) in frames.iter().enumerate() {
            assert_eq!(frame["frame"], number, "{transport}, {lost}, {killed}");
            if number % 200 == 0 {
                assert_eq!(frame["cut_mismatch_pixels"], 0, "{transport}, {lost}, {killed}: {frame}");
            }
        }
        assert!(
            report["run"]["notes"].to_string().contains("the session stopped before"),
            "{}",
            report["run"]
        );
    }
}

#[test]
fn a_machine_that_is_killed_before_the_other_comes_takes_its_place_again() {
    for (transport, early) in [("tcp", "first"), ("tcp", "second"), ("quic", "first"), ("udp", "second")] {
        let deployment = Deployment::new(transport);
        let mut display = deployment.start("display", &["--frames", "10"]);
        let (late, role) =
            if early == "first" { ("second", "role=switch A") } else { ("first", "role=switch B") };
        for _ in 0..2 {
            let killed = deployment.start(early, &[]);
            display.says(role);
            killed.kill();
            display.says("left before the other one came");
        }
        let early = deployment.start(early, &[]);
        display.says(role);
        deployment.start(late, &[]).ends(0);
        early.ends(0);
        let said = display.ends(0);
        assert!(!said.contains("join again"), "{transport}: {said}");
        assert_eq!(deployment.report()["frames"].as_array().unwrap().len(), 10, "{transport}");
    }
}

#[test]
fn a_machine_that_gives_up_is_missed_at_once() {
    // Long before its lease ends: it says so itself, though it has no time left.
    let lease = ["--link-lease", "100"];
    for transport in ["tcp", "quic", "udp"] {
        let deployment = Deployment::new(transport);
        let mut display = deployment.start("display", &lease);
        display.says("listens on");
        let impatient = deployment.start("first", &[&lease[..], &["--patience", "2"]].concat());
        display.says("role=switch A");
        impatient.ends(1);
        display.says("left before the other one came");
        display.kill();
    }
}

#[test]
fn a_machine_that_waits_for_the_other_joins_the_display_that_is_there_by_then() {
    for (transport, waiting) in [("tcp", "first"), ("udp", "second")] {
        let deployment = Deployment::new(transport);
        let late = if waiting == "first" { "second" } else { "first" };
        let mut gone = deployment.start("display", &[]);
        let mut early = deployment.start(waiting, &[]);
        gone.says("joined");
        gone.kill();
        early.says("the display left before the other machine came");
        let display = deployment.start("display", &["--frames", "10"]);
        deployment.start(late, &[]).ends(0);
        early.ends(0);
        display.ends(0);
        assert_eq!(deployment.report()["frames"].as_array().unwrap().len(), 10, "{transport}");
    }
}

#[test]
fn a_display_that_is_started_again_finds_its_pair() {
    let deployment = Deployment::new("tcp");
    let mut display = deployment.start("display", &[]);
    let pair = ["first", "second"].map(|seat| deployment.start(seat, &[]));
    display.shows(5);
    display.kill();
    deployment.start("display", &["--frames", "10"]).ends(0);
    for role in pair {
        assert!(role.ends(0).contains("joining again"));
    }
    assert_eq!(deployment.report()["frames"].as_array().unwrap().len(), 10);
}

#[test]
fn a_peer_that_stays_away_ends_the_session() {
    let deployment = Deployment::new("tcp");
    let mut display = deployment.start("display", &["--reconnect", "1"]);
    let first = deployment.start("first", &["--reconnect", "1"]);
    let second = deployment.start("second", &[]);
    display.shows(5);
    second.kill();
    for (role, code) in [(first, 1), (display, 3)] {
        let said = role.ends(code);
        assert!(said.contains("could not go on within 1 s") && said.contains("lost"), "{said}");
    }
    let ended = &deployment.report()["summary"]["ended"];
    assert_eq!((&ended["how"], &ended["frames_due"]), (&"peer_lost".into(), &FRAMES.into()));
}

/// An interrupted walk is no finished one: its machines wait for the display as for a killed one.
#[test]
fn a_display_that_is_interrupted_says_so_and_its_pair_waits_for_it() {
    let deployment = Deployment::new("tcp");
    let mut display = deployment.start("display", &[]);
    let pair = ["first", "second"].map(|seat| deployment.start(seat, &[]));
    display.shows(5);
    display.interrupt();
    assert!(display.ends(3).contains("it was asked to stop"));
    let report = deployment.report();
    assert_eq!(report["summary"]["ended"]["how"], "interrupted");
    assert!((5..FRAMES).contains(&report["frames"].as_array().unwrap().len()));
    deployment.start("display", &["--frames", "10"]).ends(0);
    for role in pair {
        assert!(role.ends(0).contains("joining again"));
    }
}
