//! The release before, beside this one: the machines of a walk are upgraded one after the other, and put
//! back. Each frame is there once, and its picture is that of a walk in one process.

use std::{env, fs, path::Path};

use serde_json::Value;

use crate::common::deployment::{CULLERS, Deployment, culled_by};
use crate::common::ports::unused_port;
use crate::common::program::Process;

const NOW: &str = env!("CARGO_BIN_EXE_trimaran");
/// Frames behind each step, in which each culler has its turn.
const SHOWN: usize = 30;
const WALK: [&str; 3] = ["--width=96", "--height=96", "--audit-every=20"];
/// Longer than a test may wait: a display that is held is not lost.
const IDLE: [&str; 2] = ["-o", "link.idle_timeout_s=600"];

/// The program of the release before. Without the variable a test says that it is skipped, unless
/// `TRIMARAN_REQUIRE_BEFORE` is 1.
fn release_before() -> Option<String> {
    let program = env::var("TRIMARAN_BEFORE").ok();
    if program.is_none() {
        assert_ne!(env::var("TRIMARAN_REQUIRE_BEFORE").as_deref(), Ok("1"), "TRIMARAN_BEFORE is not set");
        println!("skipped: TRIMARAN_BEFORE is not set; `./x before` prints it");
    }
    program
}

/// The processes of a walk, each by one of two programs.
struct Machines {
    deployment: Deployment,
    cullers: [Option<Process>; 2],
    display: Option<Process>,
    /// The frames behind each step: the first, and the one after the last.
    behind: Vec<(usize, usize)>,
}

impl Machines {
    fn start(transport: &str, program: &str) -> Self {
        let deployment = Deployment::here(transport, [(); 2].map(|()| unused_port()));
        let cullers = CULLERS.map(|culler| Some(deployment.start_by(program, culler, &IDLE)));
        let mut machines = Self { deployment, cullers, display: None, behind: Vec::new() };
        machines.start_display(program, &["--resumable"]);
        machines
    }

    fn start_display(&mut self, program: &str, more: &[&str]) {
        let mut display = self.deployment.start_by(program, "display", &[&WALK, &IDLE[..], more].concat());
        for _ in CULLERS {
            display.says("has come");
        }
        self.display = Some(display);
        self.walk_on();
    }

    /// The walk goes on for some frames.
    fn walk_on(&mut self) {
        let from = self.deployment.shown();
        self.deployment.shows(SHOWN);
        self.behind.push((from, from + SHOWN));
    }

    /// The display is held meanwhile, so that no machine is fast enough to come to the end of its path.
    fn replace_culler(&mut self, index: usize, program: &str) {
        let display = self.display.as_mut().unwrap();
        display.signal("STOP");
        let old = self.cullers[index].take().unwrap();
        old.interrupt();
        old.ends(0);
        let mut culler = self.deployment.start_by(program, CULLERS[index], &IDLE);
        culler.says("listens on");
        display.signal("CONT");
        display.says(&format!("culler {} came before", index + 1));
        self.cullers[index] = Some(culler);
        self.walk_on();
    }

    fn replace_display(&mut self, program: &str, more: &[&str]) {
        let old = self.display.take().unwrap();
        old.interrupt();
        old.ends(3);
        self.start_display(program, more);
    }

    /// Ends the walk and returns its report, which has every frame once and in order.
    fn end(&mut self, before: &str) -> Value {
        let (_, said) = self.deployment.interrupted(self.display.take().unwrap());
        self.deployment.complete_by(before, "walk");
        let report = self.deployment.whole_report();
        for (from, to) in &self.behind {
            let frames = &report["frames"].as_array().unwrap()[*from..*to];
            for culler in ["culler 1", "culler 2"] {
                let culled = frames.iter().any(|frame| frame["culled_by"] == culler);
                assert!(culled, "{culler} has no frame from {from} to {to}: {said}");
            }
        }
        report
    }
}

fn picture(folder: &Path, frame: usize) -> Vec<u8> {
    fs::read(folder.join(format!("frames/{frame:05}.png"))).unwrap()
}

/// The walk in one process has the same pictures.
fn is_as_in_one_process(deployment: &Deployment, frames: usize) {
    let alone = [&WALK[..], &["--out", "alone", "--join-timeout", "0.1"]].concat();
    let display = deployment.start("display", &alone);
    while deployment.shown_in("alone") < frames {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    display.interrupt();
    display.ends(3);
    deployment.complete_by(NOW, "alone");
    assert_eq!(culled_by(&deployment.report("alone")), ["display"]);
    let folders = ["walk", "alone"].map(|out| deployment.path(out));
    for frame in 0..frames {
        let [walked, alone] = folders.each_ref().map(|folder| picture(folder, frame));
        assert!(walked == alone, "another picture of frame {frame}");
    }
}

fn upgraded_and_put_back(transport: &str) {
    let Some(before) = release_before() else { return };
    let mut machines = Machines::start(transport, &before);
    machines.replace_culler(0, NOW);
    machines.replace_display(NOW, &["--resumable"]);
    machines.replace_culler(1, NOW);
    machines.replace_culler(1, &before);
    machines.replace_display(&before, &[]);
    machines.replace_culler(0, &before);
    let report = machines.end(&before);
    let frames = report["frames"].as_array().unwrap().len();
    // Both programs resumed the walk of the other one.
    let notes = report["run"]["notes"].as_array().unwrap();
    let resumed = notes.iter().filter(|note| note.as_str().unwrap().contains("and went on after"));
    assert_eq!(resumed.count(), 2, "{notes:?}");
    drop(machines.cullers.each_mut().map(Option::take));
    is_as_in_one_process(&machines.deployment, frames);
}

#[test]
fn a_walk_over_tcp_is_upgraded_and_put_back() {
    upgraded_and_put_back("tcp");
}

#[test]
fn a_walk_over_udp_is_upgraded_and_put_back() {
    upgraded_and_put_back("udp");
}

#[test]
fn a_walk_over_quic_is_upgraded_and_put_back() {
    upgraded_and_put_back("quic");
}
