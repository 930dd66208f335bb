//! Real packets between network namespaces, over the simulator's links.
//!
//! Needs Linux and root; elsewhere the tests say that they are skipped, and fail if `TRIMARAN_REQUIRE_NETNS`
//! is 1.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use trimaran::netem::{Emulation, Namespace, Report};
use trimaran_netsim::Profile;

/// Whether namespaces are available; reports it if not.
fn possible() -> bool {
    let Err(missing) = Emulation::possible() else { return true };
    assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none_or(|value| value != "1"), "{missing}");
    println!("skipped: {missing}");
    false
}

/// Names unique to the test.
fn names(test: &str, count: usize) -> Vec<String> {
    (0..count).map(|index| format!("trimaran-{test}-{index}-{}", std::process::id())).collect()
}

fn profile(up: &str, down: &str) -> Profile {
    let text = format!("about = \"a\"\nsources = []\n[up]\n{up}\n[down]\n{down}\n");
    Profile::parse("test", &text).unwrap()
}

/// Runs `act` in a namespace. Sockets made there stay there.
fn inside<T: Send>(namespace: &Namespace, act: impl FnOnce() -> T + Send) -> T {
    let act = || {
        namespace.enter().unwrap();
        act()
    };
    thread::scope(|scope| scope.spawn(act).join().unwrap())
}

/// Waits for a datagram. Suspending the whole machine for a moment interrupts the wait.
fn receive(socket: &UdpSocket, buffer: &mut [u8]) -> (usize, SocketAddr) {
    loop {
        match socket.recv_from(buffer) {
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            received => return received.unwrap(),
        }
    }
}

fn socket(namespace: &Namespace, at: IpAddr) -> UdpSocket {
    let socket = inside(namespace, || UdpSocket::bind((at, 0)).unwrap());
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    socket
}

/// Sockets at the first machine and the last, IPv4 or IPv6.
fn ends(emulation: &Emulation, v4: bool) -> [UdpSocket; 2] {
    let machines = emulation.machines();
    let (first, last) = (&machines[0], &machines[machines.len() - 1]);
    [first, last].map(|(host, namespace)| socket(namespace, if v4 { host.v4() } else { host.v6() }))
}

fn ip(words: &[&str]) -> String {
    let output = Command::new("ip").args(words).output().unwrap();
    assert!(output.status.success(), "{words:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn totals(report: &Report) -> [u64; 4] {
    assert!(report.totals.is_balanced(), "{report:?}");
    [report.totals.sent, report.totals.duplicated, report.totals.delivered, report.totals.lost]
}

#[test]
fn packets_take_the_time_that_the_links_say_and_all_are_accounted_for() {
    if !possible() {
        return;
    }
    let slow = profile("delay = \"30ms\"", "delay = \"20ms\"");
    let emulation = Emulation::start(&slow, &names("time", 3), 1).unwrap();
    for v4 in [true, false] {
        let [here, there] = ends(&emulation, v4);
        for size in [0, 100, 1400] {
            let (message, mut buffer) = (vec![7; size], vec![0; 2000]);
            let start = Instant::now();
            here.send_to(&message, there.local_addr().unwrap()).unwrap();
            let (length, from) = receive(&there, &mut buffer);
            assert!(start.elapsed() >= Duration::from_millis(50), "{:?}", start.elapsed());
            assert_eq!((&buffer[..length], from), (&message[..], here.local_addr().unwrap()));
            there.send_to(&buffer[..length], from).unwrap();
            assert_eq!(receive(&here, &mut buffer).0, size);
            assert!(start.elapsed() >= Duration::from_millis(100), "{:?}", start.elapsed());
        }
    }
    let report = emulation.finish().unwrap();
    assert_eq!(totals(&report), [12, 0, 12, 0]);
    let link = report.links.iter().find(|link| link.name == "culler-1 to switch").unwrap();
    // Three with 20 + 8 bytes of headers and three with 40 + 8, in Ethernet frames of 18 more and 64 at
    // least.
    let bytes = 64 + (100 + 28 + 18) + (1400 + 28 + 18) + (48 + 18) + (100 + 48 + 18) + (1400 + 48 + 18);
    assert_eq!((link.tally.offered.packets, link.tally.offered.bytes), (6, bytes));
    assert!(report.late.p50_us <= report.late.p99_us && report.late.p99_us <= report.late.max_us);
}

#[test]
fn what_a_link_loses_does_not_arrive_and_what_it_doubles_arrives_twice() {
    if !possible() {
        return;
    }
    let names = names("fate", 2);
    let emulation = Emulation::start(&profile("duplicate = 1.0", ""), &names, 1).unwrap();
    let [here, there] = ends(&emulation, true);
    here.send_to(b"twice", there.local_addr().unwrap()).unwrap();
    let mut buffer = [0; 100];
    for _ in 0..2 {
        assert_eq!(receive(&there, &mut buffer).0, 5);
    }
    assert_eq!(totals(&emulation.finish().unwrap()), [1, 1, 2, 0]);

    // The same names again: the first emulation has left nothing behind.
    let emulation = Emulation::start(&profile("", "loss = { independent = 1.0 }"), &names, 1).unwrap();
    let [here, there] = ends(&emulation, true);
    for _ in 0..10 {
        here.send_to(b"never", there.local_addr().unwrap()).unwrap();
    }
    while emulation.report().totals.lost < 10 {
        thread::sleep(Duration::from_millis(5));
    }
    there.set_nonblocking(true).unwrap();
    assert_eq!(there.recv_from(&mut buffer).unwrap_err().kind(), ErrorKind::WouldBlock);
    assert_eq!(totals(&emulation.finish().unwrap()), [10, 0, 0, 10]);
    assert!(names.iter().all(|name| !Path::new("/run/netns").join(name).exists()));
}

#[test]
fn a_namespace_that_was_there_stays() {
    if !possible() {
        return;
    }
    let names = names("mine", 2);
    ip(&["netns", "add", &names[0]]);
    let emulation = Emulation::start(&profile("", ""), &names, 1).unwrap();
    drop(emulation);
    let exists = |name: &String| Path::new("/run/netns").join(name).exists();
    let left = [exists(&names[0]), exists(&names[1])];
    ip(&["netns", "delete", &names[0]]);
    assert_eq!(left, [true, false]);
}

#[test]
fn a_namespace_without_its_name_is_there_as_long_as_somebody_has_it() {
    if !possible() {
        return;
    }
    let names = names("nameless", 2);
    let mut emulation = Emulation::start(&profile("", ""), &names, 1).unwrap();
    emulation.take_names().unwrap();
    assert!(
        names.iter().all(|name| !Path::new("/run/netns").join(name).exists()),
        "killed now, it leaves nothing"
    );
    let [here, there] = ends(&emulation, true);
    here.send_to(b"still here", there.local_addr().unwrap()).unwrap();
    let mut buffer = [0; 100];
    assert_eq!(receive(&there, &mut buffer), (10, here.local_addr().unwrap()));
    assert_eq!(totals(&emulation.finish().unwrap()), [1, 0, 1, 0]);
}

fn interrupt(child: &Child) {
    // The shell's own: some machines lack the program of that name.
    let kill = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(kill.success());
}

fn trimaran(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trimaran")).arg("netem").args(words).output().unwrap()
}

#[test]
fn flags_that_make_no_sense_are_named() {
    for (words, expected) in [
        (&["--profile", "token-ring"][..], "token-ring"),
        (&["--profile", "wifi", "--namespaces", "only"], "1 namespaces"),
        (&["--profile", "wifi", "--namespaces", "a,b,a"], "each once"),
        (&["--profile", "wifi", "--seconds", "-1"], "--seconds"),
    ] {
        let output = trimaran(words);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains(expected), "{words:?}: {said}");
    }
}

#[test]
fn without_the_capability_it_says_which() {
    if !possible() {
        return;
    }
    let program = env!("CARGO_BIN_EXE_trimaran");
    let words = ["--bounding-set", "-net_admin", program, "netem", "--profile", "wifi"];
    let Ok(output) = Command::new("setpriv").args(words).output() else {
        println!("skipped: there is no `setpriv` (util-linux)");
        return;
    };
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("CAP_NET_ADMIN is missing: run it as root"), "{said}");
}

#[test]
fn an_interrupt_ends_it_in_good_order() {
    if !possible() {
        return;
    }
    let names = names("stop", 2);
    let mut child = Command::new(env!("CARGO_BIN_EXE_trimaran"))
        .args(["netem", "--profile", "gigabit", "--json", "--namespaces", &names.join(",")])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The last thing made is the device of the last namespace.
    let made = || {
        let words = ["-n", &names[1], "address", "show", "up"];
        let output = Command::new("ip").args(words).output().unwrap();
        String::from_utf8(output.stdout).unwrap().contains("10.0.0.2")
    };
    while !made() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        thread::sleep(Duration::from_millis(20));
    }
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(output.stderr.is_empty(), "quiet where nobody watches: {output:?}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // The kernel looks for routers and neighbours at any time.
    let count = |what: &str| report["totals"][what].as_u64().unwrap();
    assert_eq!(count("sent"), count("delivered") + count("underway"), "{report}");
    assert_eq!(report["links"].as_array().unwrap().len(), 4);
    assert!(names.iter().all(|name| !Path::new("/run/netns").join(name).exists()));
}
