//! A display that is killed and restarted resumes: its report has every frame once, and the pictures are
//! those of an uninterrupted walk.

use std::{
    fs::{self, File},
    io::Write,
    path::Path,
};

use serde_json::Value;

use crate::common::deployment::{Deployment, culled_by, notes};
use crate::common::ports::unused_port;
use crate::common::program::Process;

const FRAMES: usize = 150;
const WALK: [&str; 4] = ["--frames", "150", "--width=200", "--height=200"];
const AUDITED: [&str; 2] = ["--audit-every", "1"];
const LIVE: [&str; 2] = ["--live", "30"];
/// Longer than a test may wait: only the display's key frees its slot, and there is one.
const ONE_PLACE: [&str; 4] = ["-o", "link.idle_timeout_s=600", "-o", "limits.peers=1"];
const WENT_ON: &str = "the display stopped before frame";

fn deploy(transport: &str) -> Deployment {
    Deployment::here(transport, [(); 2].map(|()| unused_port()))
}

fn start(deployment: &Deployment, more: &[&str]) -> Process {
    deployment.start("display", &[&WALK, &ONE_PLACE[..], more].concat())
}

/// Starts a display and kills it once it has shown this many frames.
fn killed_after(deployment: &Deployment, frames: usize, more: &[&str]) {
    let display = start(deployment, more);
    deployment.shows(frames);
    display.kill();
}

fn pictures(out: &Path) -> Vec<Vec<u8>> {
    (0..FRAMES).map(|frame| fs::read(out.join(format!("frames/{frame:05}.png"))).unwrap()).collect()
}

/// The notes on resumptions of the walk.
fn stops(report: &Value) -> usize {
    let notes = report["run"]["notes"].as_array().unwrap();
    notes.iter().filter(|note| note.as_str().unwrap().contains(WENT_ON)).count()
}

/// The eyes of the frames.
fn eyes(report: &Value) -> Vec<&Value> {
    report["frames"].as_array().unwrap().iter().map(|frame| &frame["eye"]).collect()
}

#[test]
fn a_display_that_is_killed_goes_on_where_it_was() {
    for transport in ["tcp", "quic", "udp"] {
        let deployment = deploy(transport);
        let _cullers = deployment.start_cullers(&ONE_PLACE);
        killed_after(&deployment, 30, &AUDITED);
        let journal = deployment.path("walk/unfinished/walk.jsonl");
        // As if the power failed while a line was being written.
        let mut torn = File::options().append(true).open(&journal).unwrap();
        torn.write_all(b"{\"frame\":31,\"eye\":[0.0,").unwrap();
        drop(torn);
        killed_after(&deployment, 30, &AUDITED);

        let mut display = start(&deployment, &[&AUDITED[..], &["--join-timeout", "10"]].concat());
        display.says_all(&[WENT_ON]);
        display.says("has come");
        display.says("has come");
        let said = display.ends(0);
        assert!(!said.contains("begins without"), "{transport}: {said}");
        assert!(!deployment.path("walk/unfinished").exists(), "{transport}");
        let report = deployment.whole_report();
        let frames = report["frames"].as_array().unwrap();
        assert_eq!(frames.len(), FRAMES, "{transport}");
        assert_eq!(report["summary"]["audited_frames"], FRAMES, "{transport}");
        assert_eq!(report["summary"]["cut_mismatch_pixels_total"], 0, "{transport}");
        assert_eq!((stops(&report), culled_by(&report)), (2, vec!["culler 1", "culler 2"]), "{transport}");
        for frame in frames {
            assert!(frame["latency_ms"].as_f64().unwrap() >= 0.0 && frame["nodes_drawn"] != 0, "{frame}");
        }

        start(&deployment, &["--audit-every", "0", "--out", "whole"]).ends(0);
        let killed = pictures(&deployment.path("walk"));
        assert!(killed == pictures(&deployment.path("whole")), "{transport}: other pictures");
    }
}

/// Of several killed walks the last two are kept, and each begins at its beginning.
#[test]
fn another_walk_does_not_go_on() {
    let deployment = deploy("tcp");
    let _cullers = deployment.start_cullers(&ONE_PLACE);
    killed_after(&deployment, 10, &[]);
    let mut display = start(&deployment, &["--seed", "2"]);
    display.says_all(&["the unfinished walk is another one"]);
    display.says_all(&["left no report", "unfinished.before"]);
    display.ends(0);
    let report = deployment.whole_report();
    assert_eq!((report["frames"].as_array().unwrap().len(), stops(&report)), (FRAMES, 0));
    let before = fs::read_to_string(deployment.path("walk/unfinished.before/walk.jsonl")).unwrap();
    assert!(before.lines().count() > 10, "{before}");
}

/// Only its report is missing: the display needs no culler.
#[test]
fn a_display_that_is_killed_while_it_reports_reports_again() {
    let deployment = deploy("tcp");
    let cullers = deployment.start_cullers(&ONE_PLACE);
    killed_after(&deployment, FRAMES, &AUDITED);
    drop(cullers);
    let said = start(&deployment, &[&AUDITED[..], &["--join-timeout", "600"]].concat()).ends(0);
    assert!(said.contains(WENT_ON), "{said}");
    assert_eq!(deployment.whole_report()["summary"]["audited_frames"], FRAMES);
}

/// As a scheduler stops a job that it starts again.
#[test]
fn a_display_that_is_stopped_goes_on_if_it_is_resumable() {
    let deployment = deploy("tcp");
    let _cullers = deployment.start_cullers(&ONE_PLACE);
    let mut shown = 0;
    for _ in 0..2 {
        let display = start(&deployment, &["--resumable"]);
        deployment.shows(20);
        display.interrupt();
        display.ends(3);
        // It has a report so far, and keeps its records.
        let report = deployment.report("walk");
        assert_eq!(report["summary"]["ended"]["how"], "interrupted");
        let frames = report["frames"].as_array().unwrap().len();
        assert!(frames >= shown + 20 && frames == deployment.shown(), "{frames} after {shown}");
        shown = frames;
    }
    let said = start(&deployment, &["--resumable", "--join-timeout", "10"]).ends(0);
    assert!(said.contains(WENT_ON) && !said.contains("begins without"), "{said}");
    assert!(!deployment.path("walk/unfinished").exists());
    let report = deployment.whole_report();
    assert_eq!((report["frames"].as_array().unwrap().len(), stops(&report)), (FRAMES, 2));
    start(&deployment, &["--out", "whole"]).ends(0);
    assert!(pictures(&deployment.path("walk")) == pictures(&deployment.path("whole")), "other pictures");
}

#[test]
fn a_walk_by_the_clock_goes_on_at_its_time() {
    let deployment = deploy("tcp");
    let _cullers = deployment.start_cullers(&ONE_PLACE);
    start(&deployment, &["--out", "whole"]).ends(0);
    let path = deployment.report("whole");
    killed_after(&deployment, 20, &LIVE);
    let killed = deployment.shown();
    start(&deployment, &LIVE).ends(0);
    let report = deployment.whole_report();
    assert!(notes(&report, &[WENT_ON]), "{}", report["run"]["notes"]);
    let path = eyes(&path);
    let at: Vec<_> =
        eyes(&report).into_iter().map(|eye| path.iter().position(|pose| *pose == eye).unwrap()).collect();
    // A busy machine shows no picture of the very last poses.
    assert!(at.is_sorted() && at.last() > Some(&(FRAMES - FRAMES / 4)), "{at:?}");
    assert!(at[killed] - at[killed - 1] < FRAMES / 4, "the walk has jumped at {killed}: {at:?}");
}
