//! A network that is cut while three machines walk: for a moment, and for longer than they wait for each
//! other.
//!
//! Needs Linux and root; elsewhere the tests say that they are skipped, and fail if `TRIMARAN_REQUIRE_NETNS`
//! is 1.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

#[path = "common/deployment.rs"]
mod deployment;
#[path = "common/program.rs"]
mod program;

use std::{env, process::Command, thread, time::Duration};

use deployment::{Deployment, FRAMES, Place};
use program::Process;
use trimaran::netem::{Emulation, Namespace};
use trimaran_netsim::Profile;

/// Three machines on a network of their own, if that can be had.
fn machines(test: &str) -> Option<Emulation> {
    if let Err(missing) = Emulation::possible() {
        assert!(env::var_os("TRIMARAN_REQUIRE_NETNS").is_none_or(|value| value != "1"), "{missing}");
        println!("skipped: {missing}");
        return None;
    }
    let names = [0, 1, 2].map(|index| format!("trimaran-{test}-{index}-{}", std::process::id()));
    let lan = "about = \"a\"\nsources = []\n[up]\ndelay = \"0.1ms\"\n[down]\ndelay = \"0.1ms\"\n";
    Some(Emulation::start(&Profile::parse("lan", lan).unwrap(), &names, 1).unwrap())
}

fn deploy(emulation: &Emulation, transport: &str) -> Deployment {
    let place = |index: usize| {
        let (host, namespace) = &emulation.machines()[index];
        Place { address: host.v4().to_string(), namespace: Some(namespace.name().to_owned()) }
    };
    Deployment::at(transport, [4000, 4001], [place(0), place(1), place(2)])
}

/// Takes a machine off the network, or puts it back.
fn set(machine: &Namespace, state: &str) {
    let words = ["-n", machine.name(), "link", "set", "net0", state];
    assert!(Command::new("ip").args(words).status().unwrap().success());
}

/// Starts all three, and waits until they walk. Gives the display first.
fn walking(deployment: &Deployment, display_at: &Namespace, more: &[&str]) -> [Process; 3] {
    let mut display = deployment.start("display", more);
    let pair = ["first", "second"].map(|index| deployment.start(index, more));
    let display = thread::scope(|scope| {
        let shows = scope.spawn(|| {
            // Its metrics are reached from its own machine.
            display_at.enter().unwrap();
            display.shows(5);
            display
        });
        shows.join().unwrap()
    });
    let [first, second] = pair;
    [display, first, second]
}

fn assert_whole(deployment: &Deployment, transport: &str) {
    let report = deployment.report();
    assert_eq!(report["summary"]["ended"]["how"], "finished", "{transport}");
    let frames: Vec<_> = report["frames"].as_array().unwrap().iter().map(|frame| &frame["frame"]).collect();
    assert_eq!(frames, (0..FRAMES).collect::<Vec<_>>(), "{transport}");
}

#[test]
fn a_walk_goes_on_after_a_cut_that_is_shorter_than_the_idle_timeout() {
    let Some(emulation) = machines("short") else { return };
    for transport in ["tcp", "udp", "quic"] {
        for cut in [1, 2] {
            let deployment = deploy(&emulation, transport);
            let display_at = &emulation.machines()[2].1;
            let roles = walking(&deployment, display_at, &["-o", "link.idle_timeout_s=60"]);
            set(&emulation.machines()[cut].1, "down");
            thread::sleep(Duration::from_secs(1));
            set(&emulation.machines()[cut].1, "up");
            for role in roles {
                let said = role.ends(0);
                assert!(
                    !said.contains("join again") && !said.contains("joining again"),
                    "{transport}, {cut}: {said}"
                );
            }
            assert_whole(&deployment, transport);
            let waited = |frame: &serde_json::Value| frame["frame_ms"].as_f64().is_some_and(|ms| ms > 500.0);
            let frames = &deployment.report()["frames"];
            assert!(frames.as_array().unwrap().iter().any(waited), "{transport}, {cut}: it was not cut");
        }
    }
}

#[test]
fn a_walk_goes_on_when_the_network_comes_back_after_a_longer_cut() {
    let Some(emulation) = machines("long") else { return };
    for transport in ["tcp", "udp", "quic"] {
        let deployment = deploy(&emulation, transport);
        let display_at = &emulation.machines()[2].1;
        let [mut display, first, second] = walking(&deployment, display_at, &["-o", "link.idle_timeout_s=3"]);
        set(display_at, "down");
        display.says("waiting 60 s for all to join again");
        set(display_at, "up");
        for role in [first, second] {
            assert!(role.ends(0).contains("joining again"), "{transport}");
        }
        display.ends(0);
        assert_whole(&deployment, transport);
    }
}
