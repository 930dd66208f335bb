//! Faults on three machines: a cable is unplugged, a disk is full, a culler starts again and again.

use std::env;
use std::fs;

use crate::common::deployment::{culled_by, notes};
use crate::deployment::{DISPLAY, ONE, REPORT, TWO, Walk};
use crate::machine::Machine;
use crate::trio::{Trio, faults, fill, small_disk, value};

const BOTH: [&str; 2] = ["culler 1", "culler 2"];
/// How often a culler starts again, unless the variable says otherwise.
const RESTARTS: (&str, usize) = ("TRIMARAN_TEST_RESTARTS", 10);
/// The most memory that a process may take more after the restarts, bytes: allocators keep some freed pages.
const MORE_MEMORY: u64 = 16 << 20;
/// The most that a display keeps of a frame until its report is written, bytes.
const OF_A_FRAME: u64 = 2 << 10;

#[test]
fn a_machine_whose_cable_is_unplugged_is_taken_back_and_no_frame_is_missing() {
    let walk = Walk::endless();
    let Some(trio) = Trio::install("unplugged", &walk, |_| String::new()) else { return };
    for transport in ["quic", "udp"] {
        if transport == "udp" {
            for (service, machine) in [(ONE.0, &trio.one), (TWO.0, &trio.two), (DISPLAY.0, &trio.show)] {
                machine
                    .run(&format!("sed -i s/quic:/udp:/g /etc/trimaran/*.toml; systemctl restart {service}"));
            }
            trio.has_cullers(&BOTH);
            trio.walks_on();
        }
        trio.network.set("one", "down");
        trio.has_cullers(&BOTH[1..]);
        trio.walks_on();
        trio.network.set("one", "up");
        trio.has_cullers(&BOTH);
        trio.walks_on();
        trio.network.set("show", "down");
        trio.has_cullers(&[]);
        trio.walks_on();
        trio.network.set("show", "up");
        trio.has_cullers(&BOTH);
        trio.walks_on();
        let report = walk.is_stopped(&trio.show);
        for culler in BOTH {
            for event in ["was lost before", "came before"] {
                assert!(notes(&report, &[culler, event]), "{transport}: {}", report["run"]["notes"]);
            }
        }
        assert_eq!(culled_by(&report), ["culler 1", "culler 2", "display"], "{transport}");
        // They have waited for the display, and nothing else happened to them.
        for (service, machine) in [(ONE.0, &trio.one), (TWO.0, &trio.two)] {
            assert_eq!(machine.run(&format!("systemctl show -P NRestarts {service}")), "0", "{transport}");
        }
    }
}

/// A resumable walk goes on once there is room.
#[test]
fn a_full_disk_ends_the_walk_once_and_it_goes_on_when_there_is_room() {
    let walk = Walk::endless();
    let more = |role: &str| if role == "display" { "resumable = true".to_owned() } else { String::new() };
    let Some(trio) = Trio::install("full", &walk, more) else { return };
    let Trio { one, show, .. } = &trio;
    walk.is_stopped(show);
    // A culler writes only its driver's compiled shaders.
    let (cache, state) = ("/var/cache/trimaran", "/var/lib/trimaran");
    small_disk(one, cache, "64k");
    fill(one, cache);
    one.run(&format!("systemctl restart {}", ONE.0));
    small_disk(show, state, "32m");
    show.run(&format!("systemctl start {}", DISPLAY.0));
    trio.has_cullers(&BOTH);
    trio.walks_on();
    fill(show, state);
    show.wait_for("the end of the walk", || {
        (show.run(&format!("systemctl show -P ActiveState {}", DISPLAY.0)) == "failed").then_some(())
    });
    let shown = |key: &str| show.run(&format!("systemctl show -P {key} {}", DISPLAY.0));
    assert_eq!((&*shown("ExecMainStatus"), &*shown("NRestarts")), ("3", "0"));
    let mut said = faults(show, DISPLAY.0);
    said.retain(|line| line.contains("no space left"));
    let [said] = &said[..] else { panic!("one fault: {said:?}") };
    for word in [REPORT, "unfinished/", "no space left; free some"] {
        assert!(said.contains(word), "{said}");
    }
    let report = Walk::report(show);
    assert_eq!(report["summary"]["ended"]["how"], "not_recorded");
    let frames = report["frames"].as_array().unwrap().len();
    assert!(frames >= 20, "{frames}");
    let recorded = recorded(show);
    // A few frames may have waited for the disk.
    assert!((1..=frames).contains(&recorded), "{recorded} of {frames}");
    for (machine, service) in [(one, ONE.0), (&trio.two, TWO.0)] {
        lost_only_displays(machine, service);
    }

    show.run(&format!("rm {state}/filler; systemctl start {}", DISPLAY.0));
    trio.has_cullers(&BOTH);
    trio.walks_on();
    assert!(self::recorded(show) > recorded);
    let report = walk.is_stopped(show);
    assert!(notes(&report, &[&format!("the display stopped before frame {recorded}")]), "{}", report["run"]);
    assert!(notes(&report, &["went on after"]), "{}", report["run"]);

    one.run(&format!("rm {cache}/filler; systemctl restart {}", ONE.0));
    lost_only_displays(one, ONE.0);
    assert_ne!(one.run(&format!("find {cache} -type f -size +0")), "", "the driver keeps its shaders again");
}

fn lost_only_displays(machine: &Machine, culler: &str) {
    assert_eq!(machine.run(&format!("systemctl show -P ActiveState {culler}")), "active");
    let said = faults(machine, culler);
    assert!(said.iter().all(|line| line.starts_with("display ") && line.contains("is gone")), "{said:?}");
}

/// How many frames the records of a walk have.
fn recorded(show: &Machine) -> usize {
    let records = fs::read_to_string(show.path(&format!("{REPORT}/unfinished/walk.jsonl"))).unwrap();
    records.matches("\n{\"frame\":").count()
}

/// Resources that a process has taken.
#[derive(Debug, Clone, Copy)]
struct Taken {
    descriptors: usize,
    threads: u64,
    /// Resident, bytes.
    memory: u64,
}

impl Taken {
    fn by(machine: &Machine, service: &str) -> Self {
        let process = format!("/proc/{}", machine.main_process(service));
        let status = machine.run(&format!("cat {process}/status"));
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
            line.unwrap().split_whitespace().next().unwrap().parse::<u64>().unwrap()
        };
        Self {
            descriptors: machine.run(&format!("ls {process}/fd")).lines().count(),
            threads: field("Threads"),
            memory: field("VmRSS") << 10,
        }
    }
}

/// A culler has one place, which the display takes again after each restart.
#[test]
fn a_culler_that_starts_again_and_again_takes_nothing_from_the_others() {
    let (name, usual) = RESTARTS;
    let count = env::var(name).map_or(usual, |count| count.parse().unwrap());
    let walk = Walk::longer(500 * count);
    let more = |role: &str| if role == "display" { String::new() } else { "[limits]\npeers = 1".to_owned() };
    let Some(trio) = Trio::install("restarts", &walk, more) else { return };
    let restart = |number: usize| {
        let before = trio.one.main_process(ONE.0);
        if number.is_multiple_of(2) {
            trio.one.run(&format!("systemctl restart {}", ONE.0));
        } else {
            trio.one.run(&format!("systemctl kill --signal=KILL {}", ONE.0));
        }
        trio.one.wait_for_another_process(ONE.0, &before);
        trio.one.wait_for("its link", || (trio.links(ONE.0)?.len() == 1).then_some(()));
    };
    let others = [(DISPLAY.0, &trio.show), (TWO.0, &trio.two)];
    let taken = || others.map(|(service, machine)| Taken::by(machine, service));
    let shown = || value(&trio.metrics(DISPLAY.0), "trimaran_frames_total{stage=\"rvg\"}") as u64;
    let series = || others.map(|(service, _)| trio.metrics(service).lines().count());
    (0..3).for_each(restart);
    let (before, series_before, first) = (taken(), series(), shown());
    (0..count).for_each(restart);
    trio.walks_on();
    trio.has_cullers(&BOTH);
    for (place, (service, machine)) in others.into_iter().enumerate() {
        // A connection to the metrics and a thread without work go after some seconds.
        machine.wait_for(&format!("descriptors and threads of {service} as in {:?}", before[place]), || {
            let Taken { descriptors, threads, .. } = Taken::by(machine, service);
            (descriptors <= before[place].descriptors && threads <= before[place].threads).then_some(())
        });
    }
    let (after, series_after, frames) = (taken(), series(), shown() - first);
    println!("after {count} restarts and {frames} frames {after:?}, before {before:?}");
    for (place, (service, _)) in others.into_iter().enumerate() {
        let (before, after) = (before[place], after[place]);
        let kept = if service == DISPLAY.0 { frames * OF_A_FRAME } else { 0 };
        assert!(after.memory <= before.memory + MORE_MEMORY + kept, "{service}: {after:?}, {before:?}");
        let metrics = trio.metrics(service);
        for limit in ["peers", "handshakes", "handshakes_per_s_per_address", "handshakes_per_s"] {
            let series = format!("trimaran_link_turned_away_total{{limit=\"{limit}\"}}");
            assert!(value(&metrics, &series) == 0.0, "{service}: {metrics}");
        }
    }
    assert_eq!(series_after, series_before);
    assert!(value(&trio.metrics(TWO.0), "trimaran_sessions") == 1.0);
    let report = walk.is_stopped(&trio.show);
    let lost = report["run"]["notes"].as_array().unwrap().iter();
    let lost = lost.filter(|note| note.as_str().unwrap().starts_with("culler 1 was lost before")).count();
    assert!(lost >= count + 3, "{lost}: {}", report["run"]["notes"]);
}
