//! The network is cut while machines walk: briefly, and for longer than their timeouts. The walk goes on
//! either way.
//!
//! Needs Linux and root; elsewhere the tests say that they are skipped, and fail if `TRIMARAN_REQUIRE_NETNS`
//! is 1.

use std::{env, process::Command, thread, time::Duration};

use trimaran::netem::{Emulation, Namespace};
use trimaran_netsim::Profile;

use crate::common::deployment::{Deployment, Place, culled_by, notes};
use crate::common::program::Process;

/// Two cullers and a display on a network of their own, if possible.
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
    Deployment::at(transport, [4000, 4000], [place(0), place(1), place(2)])
}

/// Takes a machine off the network, or puts it back.
fn set(machine: &Namespace, state: &str) {
    let words = ["-n", machine.name(), "link", "set", "net0", state];
    assert!(Command::new("ip").args(words).status().unwrap().success());
}

/// Starts all, and waits until they walk: the display and its cullers.
fn walking(deployment: &Deployment, more: &[&str]) -> (Process, [Process; 2]) {
    let cullers = deployment.start_cullers(more);
    let display = deployment.start("display", more);
    deployment.shows(50);
    (display, cullers)
}

#[test]
fn a_cut_that_is_shorter_than_the_idle_timeout_loses_nobody() {
    let Some(emulation) = machines("short") else { return };
    for transport in ["tcp", "udp", "quic"] {
        for (cut, late) in [(1, &["culler 2"][..]), (2, &["culler 1", "culler 2"])] {
            let deployment = deploy(&emulation, transport);
            let (display, _cullers) = walking(&deployment, &["-o", "link.idle_timeout_s=60"]);
            let machine = &emulation.machines()[cut].1;
            set(machine, "down");
            thread::sleep(Duration::from_secs(1));
            deployment.shows(20);
            set(machine, "up");
            deployment.shows(20);
            let (report, said) = deployment.interrupted(display);
            assert!(!said.contains("was lost before"), "{transport}, {cut}: {said}");
            for culler in late {
                assert!(notes(&report, &[culler, "was late"]), "{transport}, {cut}: {}", report["run"]);
            }
        }
    }
}

#[test]
fn cullers_are_taken_back_after_a_longer_cut() {
    let Some(emulation) = machines("long") else { return };
    for transport in ["tcp", "udp", "quic"] {
        for (cut, lost) in [(1, 1), (2, 2)] {
            let deployment = deploy(&emulation, transport);
            let (mut display, _cullers) = walking(&deployment, &["-o", "link.idle_timeout_s=3"]);
            let machine = &emulation.machines()[cut].1;
            set(machine, "down");
            for _ in 0..lost {
                display.says("was lost before");
            }
            deployment.shows(20);
            set(machine, "up");
            for _ in 0..lost {
                display.says("came before");
            }
            deployment.shows(20);
            let (report, _) = deployment.interrupted(display);
            assert!(notes(&report, &["culler 2 came before"]), "{transport}, {cut}: {}", report["run"]);
            let machines =
                if cut == 2 { &["culler 1", "culler 2", "display"][..] } else { &["culler 1", "culler 2"] };
            assert!(
                machines.iter().all(|machine| culled_by(&report).contains(machine)),
                "{transport}, {cut}"
            );
            if transport == "tcp" {
                deployment.whole_report();
            }
        }
    }
}
