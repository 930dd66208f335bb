//! A session of three processes that loses one of them: it goes on with the frame that was due once all have
//! joined again, or begins when all are there.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

#[path = "common/deployment.rs"]
mod deployment;
#[path = "../transport/tests/common/ports.rs"]
mod ports;
#[path = "common/program.rs"]
mod program;

use deployment::{Deployment, FRAMES};
use ports::unused_port;

fn deploy(transport: &str) -> Deployment {
    Deployment::here(transport, [(); 2].map(|()| unused_port()))
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
        let deployment = deploy(transport);
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

/// As when a machine is suspended: to the others it is lost, and it learns of that once it goes on.
#[test]
fn a_machine_that_sleeps_for_longer_than_its_idle_timeout_joins_again() {
    for transport in ["tcp", "quic", "udp"] {
        let deployment = deploy(transport);
        let mut display = deployment.start("display", &[]);
        let first = deployment.start("first", &[]);
        let second = deployment.start("second", &[]);
        display.shows(5);
        second.signal("STOP");
        display.says("waiting 60 s for all to join again");
        second.signal("CONT");
        for role in [first, second] {
            assert!(role.ends(0).contains("joining again"), "{transport}");
        }
        display.ends(0);
        let frames = deployment.report()["frames"].as_array().unwrap().len();
        assert_eq!(frames, FRAMES, "{transport}");
    }
}

#[test]
fn a_machine_that_is_killed_before_the_other_comes_takes_its_place_again() {
    for (transport, early) in [("tcp", "first"), ("tcp", "second"), ("quic", "first"), ("udp", "second")] {
        let deployment = deploy(transport);
        let mut display = deployment.start("display", &["--frames", "10"]);
        let (late, role) =
            if early == "first" { ("second", "role=first culler") } else { ("first", "role=second culler") };
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
    // Long before its idle timeout ends: it says so itself, though it has no time left.
    let idle = ["-o", "link.idle_timeout_s=100"];
    for transport in ["tcp", "quic", "udp"] {
        let deployment = deploy(transport);
        let mut display = deployment.start("display", &idle);
        display.says("listens on");
        let impatient = deployment.start("first", &[&idle[..], &["--join-timeout", "2"]].concat());
        display.says("role=first culler");
        impatient.ends(1);
        display.says("left before the other one came");
        display.kill();
    }
}

#[test]
fn a_machine_that_waits_for_the_other_joins_the_display_that_is_there_by_then() {
    for (transport, waiting) in [("tcp", "first"), ("udp", "second")] {
        let deployment = deploy(transport);
        let late = if waiting == "first" { "second" } else { "first" };
        let mut gone = deployment.start("display", &[]);
        let mut early = deployment.start(waiting, &[]);
        gone.says("joined");
        gone.kill();
        early.says("the display left before the other culler came");
        let display = deployment.start("display", &["--frames", "10"]);
        deployment.start(late, &[]).ends(0);
        early.ends(0);
        display.ends(0);
        assert_eq!(deployment.report()["frames"].as_array().unwrap().len(), 10, "{transport}");
    }
}

#[test]
fn a_display_that_is_started_again_finds_its_cullers() {
    let deployment = deploy("tcp");
    let mut display = deployment.start("display", &[]);
    let pair = ["first", "second"].map(|index| deployment.start(index, &[]));
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
    let deployment = deploy("tcp");
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
fn a_display_that_is_interrupted_says_so_and_its_cullers_wait_for_it() {
    let deployment = deploy("tcp");
    let mut display = deployment.start("display", &[]);
    let pair = ["first", "second"].map(|index| deployment.start(index, &[]));
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
