//! The services of `deploy/systemd` under a real systemd: installed as in docs/operations.md, started in any
//! order, killed and restarted, on one machine and on three.
//!
//! Needs Linux, root and systemd. Elsewhere the tests say that they are skipped, and fail if
//! `TRIMARAN_REQUIRE_SYSTEMD` is 1.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]
#![allow(clippy::disallowed_methods, reason = "services keep the system's time")]

#[path = "../common/mod.rs"]
mod common;
mod deployment;
mod faults;
mod machine;
mod network;
mod package;
mod trio;

use std::fs;

use deployment::{DISPLAY, ONE, Over, PAGES, TWO, Walk, install_pages};
use machine::Machine;
use trio::faults;

/// The three services in every order.
const ORDERS: [[(&str, u16); 3]; 6] = [
    [DISPLAY, ONE, TWO],
    [DISPLAY, TWO, ONE],
    [ONE, DISPLAY, TWO],
    [TWO, DISPLAY, ONE],
    [ONE, TWO, DISPLAY],
    [TWO, ONE, DISPLAY],
];

#[test]
fn services_start_in_any_order_and_show_what_one_process_shows() {
    for over in [Over::Quic, Over::Unix] {
        let Some(machine) = Machine::boot("order") else { return };
        let walk = Walk::in_one_process(20);
        walk.install(&machine, over);
        walk.is_shown(&machine); // as the page started them
        for order in ORDERS {
            machine.run("systemctl stop 'trimaran-*'");
            for (service, _) in order {
                machine.run(&format!("systemctl start {service}"));
            }
            walk.is_shown(&machine);
        }
    }
}

/// Waits until the present process of a service takes part in a walk.
fn walks(machine: &Machine, (service, port): (&str, u16)) {
    machine.wait_for(&format!("{service} in a walk"), || {
        let links: serde_json::Value = serde_json::from_str(&machine.get(port, "/links")?).ok()?;
        let frames = |direction: &str| links[0][direction]["frames"].as_u64();
        (frames("received")? + frames("sent")? >= 5).then_some(())
    });
}

/// Acts on each service in turn during a walk. Each is then replaced by another process, and no frame is
/// missing. The next display `goes_on` with the walk, or begins anew.
fn in_walks(name: &str, goes_on: bool, act: impl Fn(&Machine, &str)) {
    let walk = Walk::endless();
    for over in [Over::Quic, Over::Unix] {
        let Some(machine) = Machine::boot(name) else { return };
        walk.install(&machine, over);
        let replace = |service: (&str, u16)| {
            walks(&machine, service);
            let before = machine.main_process(service.0);
            act(&machine, service.0);
            machine.wait_for_another_process(service.0, &before);
            walks(&machine, service);
        };
        [ONE, TWO, DISPLAY].into_iter().for_each(replace);
        let report = walk.is_stopped(&machine);
        let notes = report["run"]["notes"].to_string();
        for note in ["culler 1 was lost before", "the display stopped before"] {
            assert_eq!(notes.contains(note), goes_on, "{over:?}: {notes}");
        }
        machine.run("systemctl start trimaran-display");
        // A culler may still have the killed earlier display.
        walks(&machine, DISPLAY);
        replace(ONE);
        let report = walk.is_stopped(&machine);
        let notes = report["run"]["notes"].to_string();
        assert!(notes.contains("culler 1 was lost before"), "{over:?}: {notes}");
    }
}

#[test]
fn a_service_that_is_killed_in_a_walk_takes_its_place_again_and_no_frame_is_missing() {
    in_walks("killed", true, |machine, service| {
        machine.run(&format!("systemctl kill --signal=KILL {service}"));
    });
}

#[test]
fn a_service_that_is_restarted_in_a_walk_takes_its_place_again_and_no_frame_is_missing() {
    in_walks("restarted", false, |machine, service| {
        machine.run(&format!("systemctl restart {service}"));
    });
}

/// systemd knows whether a service works, what it does and whether it has hung.
#[test]
fn a_service_tells_when_it_works_and_is_restarted_when_it_hangs() {
    let walk = Walk::endless();
    let Some(machine) = Machine::boot("told") else { return };
    walk.install(&machine, Over::Quic);
    machine.run("sed 's/^listen/lisen/' /etc/trimaran/one.toml > /etc/trimaran/wrong.toml");
    machine.run("! systemctl start trimaran-culler@wrong");
    let fault = faults(&machine, "trimaran-culler@wrong");
    let [line] = &fault[..] else { panic!("{fault:?}") };
    assert!(line.contains("lisen") && line.contains("wrong.toml"), "{line}");
    let status = |(service, _): (&str, u16)| machine.run(&format!("systemctl show -P StatusText {service}"));
    machine.wait_for("the display's frame and rate", || {
        let status = status(DISPLAY);
        (status.starts_with("frame ") && status.ends_with(" frames a second, cullers: 2")).then_some(())
    });
    assert!(status(ONE).ends_with("plant.scene, displays: 1"), "{}", status(ONE));
    for (service, _) in [ONE, TWO, DISPLAY] {
        assert_eq!(faults(&machine, service), [""; 0], "{service}");
    }
    machine.run(&format!("mkdir -p /etc/systemd/system/{}.service.d", ONE.0));
    let section = "[Service]\nWatchdogSec=2\n";
    fs::write(machine.path(&format!("/etc/systemd/system/{}.service.d/soon.conf", ONE.0)), section).unwrap();
    machine.run(&format!("systemctl daemon-reload; systemctl restart {}", ONE.0));
    walks(&machine, ONE);
    let before = machine.main_process(ONE.0);
    machine.run(&format!("systemctl kill --signal=STOP {}", ONE.0));
    machine.wait_for_another_process(ONE.0, &before);
    walks(&machine, ONE);
    assert_eq!(machine.run(&format!("systemctl show -P NRestarts {}", ONE.0)), "1");
    walk.is_stopped(&machine);
}

/// The token grants access, and again after the service was killed.
#[test]
fn a_service_of_pages_is_there_again_after_it_was_killed() {
    let Some(machine) = Machine::boot("pages") else { return };
    let token = install_pages(&machine);
    let (service, port) = PAGES;
    let scene = |token: &str| machine.get(port, &format!("/scene?token={token}"));
    let is_there = || {
        machine.wait_for("the service of pages", || {
            if machine.run(&format!("systemctl show -P ActiveState {service}")) == "failed" {
                let said = machine.run(&format!("journalctl --no-pager --output cat --unit {service}"));
                assert!(std::env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{said}");
                assert!(said.contains("./x page"), "{said}");
                return Some(false);
            }
            scene(&token)?.contains(r#""name":"plant""#).then_some(true)
        })
    };
    if !is_there() {
        println!("skipped: the program was built without its page");
        return;
    }
    let refused = scene("0123456789abcdef").unwrap();
    assert!(!refused.contains("plant") && refused.contains("token"), "{refused}");
    let before = machine.main_process(service);
    machine.run(&format!("systemctl kill --signal=KILL {service}"));
    machine.wait_for_another_process(service, &before);
    assert!(is_there());
    // Other users must not read the token.
    assert_eq!(machine.run("stat --format %a:%U /etc/trimaran/plant.env"), "600:root");
    let said = machine.run(&format!("journalctl --no-pager --output cat --unit {service}"));
    assert!(said.contains(&format!(":{port}/")) && !said.contains(&token), "{said}");
}

/// A service's attempts outside its work, and at last its work.
const TRIES: &str = r#"
try() { if eval "$1" >/dev/null 2>&1; then echo "could: $1"; fi; }
try 'ls /home'
try 'ls /proc/1'
try 'cat /run/credentials/trimaran-culler@two.service/keys'
try 'unshare --user true'
try 'perl -e "socket(S, 16, 3, 0) or exit 1"'
try 'taskset --cpu-list --pid 0 $$'
try 'touch /tmp/a && chmod u+s /tmp/a'
try 'ls /tmp/of-others'
try 'dd if=/run/trimaran/device count=0'
try '[ "$(ulimit -H -c)" != 0 ]'
try 'touch /etc/trimaran/a'
try 'touch /run/trimaran/a /var/lib/trimaran/a /var/cache/trimaran/a'
"#;

#[test]
fn a_service_can_do_little_beside_its_work() {
    let Some(machine) = Machine::boot("exposed") else { return };
    Walk::in_one_process(2).install(&machine, Over::Quic);
    // Allowed to everybody except by the service's own limits.
    machine.run(
        "mknod -m 666 /run/trimaran/device c 10 200; mkdir -m 777 /tmp/of-others; chmod 777 /etc/trimaran",
    );
    fs::write(machine.path("/run/tries"), TRIES).unwrap();
    let could = |unit: &str, section: &str| {
        let section =
            format!("[Service]\n{section}\nType=oneshot\nRestart=no\nExecStart=\nExecStart=sh /run/tries\n");
        fs::write(machine.path(&format!("/etc/systemd/system/{unit}")), section).unwrap();
        let service = unit.split(".service").next().unwrap();
        machine.run(&format!("systemctl daemon-reload; systemctl start {service}"));
        let said = machine.run(&format!("journalctl --no-pager --output cat --unit {service}"));
        let lines = said.lines().filter_map(|line| line.strip_prefix("could: ")).map(str::to_owned);
        lines.collect::<Vec<_>>()
    };
    let tries: Vec<&str> =
        TRIES.lines().filter_map(|line| line.strip_prefix("try '")?.strip_suffix('\'')).collect();
    let work = &tries[tries.len() - 1..];
    for service in ["trimaran-culler@tries", "trimaran-display"] {
        machine.run(&format!("mkdir /etc/systemd/system/{service}.service.d; systemctl stop {service}"));
        assert_eq!(could(&format!("{service}.service.d/tries.conf"), ""), work, "{service}");
    }
    assert_eq!(could("unlimited.service", "User=trimaran"), tries);
}
