//! Real packets between network namespaces, over the simulator's links.
//!
//! Needs Linux and root; elsewhere the tests say that they are skipped, and fail if `TRIMARAN_REQUIRE_NETNS`
//! is 1.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]
#![allow(clippy::disallowed_methods, reason = "packets of the kernel keep the kernel's time")]

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use trimaran::netem::{Emulation, Namespace, NetemError, Report};
use trimaran_netsim::Profile;

/// Whether namespaces can be had; says so if not.
fn possible() -> bool {
    let Err(missing) = Emulation::possible() else { return true };
    assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none_or(|value| value != "1"), "{missing}");
    println!("skipped: {missing}");
    false
}

/// Names that no other test has.
fn names(test: &str, count: usize) -> Vec<String> {
    (0..count).map(|index| format!("trimaran-{test}-{index}-{}", std::process::id())).collect()
}

fn profile(up: &str, down: &str) -> Profile {
    let text = format!("about = \"a\"\nsources = []\n[up]\n{up}\n[down]\n{down}\n");
    Profile::parse("test", &text).unwrap()
}

/// What is done in a namespace. A socket that is made there stays there wherever it goes.
fn inside<T: Send>(namespace: &Namespace, act: impl FnOnce() -> T + Send) -> T {
    let act = || {
        namespace.enter().unwrap();
        act()
    };
    thread::scope(|scope| scope.spawn(act).join().unwrap())
}

/// Waits for a datagram. What suspends the whole machine for a moment interrupts the wait.
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
    let link = report.links.iter().find(|link| link.name == "first to switch").unwrap();
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

/// Two machines, 10.1.0.1 and 10.1.0.2, each with a veth pair whose other end, `end0` and `end1`, is in a
/// third place between them.
fn veth_pairs(test: &str) -> [Namespace; 3] {
    let names = names(test, 3);
    let places: Vec<_> = names.iter().map(|name| Namespace::find_or_make(name).unwrap()).collect();
    let places: [Namespace; 3] = places.try_into().unwrap();
    for index in [0, 1] {
        let (machine, end, address) =
            (&names[index], format!("end{index}"), format!("10.1.0.{}/24", index + 1));
        ip(&["-n", &names[2], "link", "add", &end, "type", "veth", "peer", "name", "eth0", "netns", machine]);
        ip(&["-n", machine, "address", "add", &address, "dev", "eth0"]);
        ip(&["-n", machine, "link", "set", "eth0", "up"]);
    }
    places
}

fn ends_of_veth() -> Vec<String> {
    vec!["end0".to_owned(), "end1".to_owned()]
}

#[test]
fn a_network_between_interfaces_carries_frames_of_any_kind() {
    if !possible() {
        return;
    }
    let [here, there, between] = veth_pairs("veth");
    let slow = profile("delay = \"10ms\"", "delay = \"15ms\"");
    let report = inside(&between, || {
        let emulation = Emulation::between(&slow, &ends_of_veth(), 1).unwrap();
        // Datagrams: after addresses were asked for, in frames that are not of IP.
        let [one, other] = [(&here, [10, 1, 0, 1]), (&there, [10, 1, 0, 2])]
            .map(|(place, address)| socket(place, IpAddr::from(address)));
        let mut buffer = [0; 2000];
        for size in [0, 1, 1400] {
            let start = Instant::now();
            one.send_to(&vec![7; size], other.local_addr().unwrap()).unwrap();
            assert_eq!(receive(&other, &mut buffer), (size, one.local_addr().unwrap()));
            assert!(start.elapsed() >= Duration::from_millis(25), "{:?}", start.elapsed());
        }
        // A stream, of which the kernel makes packets larger than any frame, whose checksums it leaves to the
        // card.
        let listener = inside(&there, || TcpListener::bind("10.1.0.2:0").unwrap());
        let mut stream = inside(&here, || TcpStream::connect(listener.local_addr().unwrap()).unwrap());
        let (mut peer, _) = listener.accept().unwrap();
        let sent: Vec<u8> = (0..1_000_000_u32).map(|byte| byte as u8 ^ (byte >> 9) as u8).collect();
        let got = thread::scope(|scope| {
            scope.spawn(|| {
                stream.write_all(&sent).unwrap();
                drop(stream);
            });
            let mut got = Vec::new();
            peer.read_to_end(&mut got).unwrap();
            got
        });
        assert!(got == sent, "{} bytes", got.len());
        let names: Vec<_> =
            emulation.interfaces().iter().map(|interface| interface.name().to_owned()).collect();
        assert_eq!(names, ends_of_veth());
        let report = emulation.finish().unwrap();
        let left = ip(&["-j", "link", "show"]);
        assert!(left.contains("end0") && !left.contains("master") && !left.contains("tmbr"), "{left}");
        report
    });
    let [sent, _, delivered, lost] = totals(&report);
    assert!(sent > 700 && delivered + report.totals.underway == sent && lost == 0, "{report:?}");
}

/// What a user would do: the program between two interfaces, and a link over it.
#[test]
fn a_link_over_a_network_between_interfaces_takes_the_time_that_the_links_say() {
    if !possible() {
        return;
    }
    let [here, there, between] = veth_pairs("link");
    let exec = |place: &Namespace, words: &[&str]| {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", place.name(), env!("CARGO_BIN_EXE_trimaran")]).args(words);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let network = exec(&between, &["netem", "--profile", "wan-20ms", "--between", "end0,end1", "--json"]);
    let mut answering = exec(&there, &["ping", "tcp://10.1.0.2:7500", "--answer"]);
    // It tries again until both are there.
    let words =
        ["ping", "tcp://10.1.0.2:7500", "--count", "5", "--interval", "0", "--timeout", "20", "--json"];
    let pinged = exec(&here, &words).wait_with_output().unwrap();
    answering.kill().unwrap();
    answering.wait().unwrap();
    interrupt(&network);
    let network = network.wait_with_output().unwrap();
    let read = |output: Output| -> serde_json::Value {
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (pinged, network) = (read(pinged), read(network));
    assert_eq!((&pinged["answered"], &pinged["lost"]), (&5.into(), &0.into()), "{pinged}");
    assert!(pinged["min_us"].as_f64().unwrap() >= 20_000.0, "{pinged}");
    let carried = network["totals"]["delivered"].as_u64().unwrap();
    assert!(carried >= 10, "five cameras there and back: {network}");
}

#[test]
fn interfaces_that_will_not_do_are_named() {
    if !possible() {
        return;
    }
    let [_here, _there, between] = veth_pairs("unfit");
    inside(&between, || {
        let refused = |first: &str, second: &str| {
            let names = [first.to_owned(), second.to_owned()];
            let refusal = Emulation::between(&profile("", ""), &names, 1).unwrap_err();
            assert!(refusal.is_usage(), "{refusal}");
            refusal
        };
        let said = refused("end0", "none").to_string();
        assert!(said.contains("no network interface none: `ip link` lists"), "{said}");
        assert!(matches!(refused("end0", "end0"), NetemError::Interfaces { count: 2 }));
        let said = refused("lo", "end1").to_string();
        assert!(said.contains("lo carries no Ethernet frames (loopback)"), "{said}");
        ip(&["address", "add", "10.9.0.1/24", "dev", "end1"]);
        let said = refused("end0", "end1").to_string();
        assert!(said.contains("end1 has the address 10.9.0.1 of this machine"), "{said}");
        ip(&["link", "add", "mine", "type", "bridge"]);
        ip(&["link", "set", "end0", "master", "mine"]);
        let said = refused("end0", "end1").to_string();
        assert!(said.contains("end0 belongs to mine already: free it with"), "{said}");
        assert!(!ip(&["link", "show"]).contains("tmbr"), "nothing is left of what was begun");
    });
}

fn interrupt(child: &Child) {
    // The shell's own: the program of that name is not on every machine.
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
        (&["--profile", "wifi", "--namespaces", "only"], "1 namespaces for three machines"),
        (&["--profile", "wifi", "--namespaces", "a,b,a"], "each once"),
        (&["--profile", "wifi", "--between", "only"], "1 interfaces to put a network between"),
        (&["--profile", "wifi", "--between", "a,b", "--namespaces", "a,b"], "--namespaces"),
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
    // The last thing that is made is the device of the last namespace.
    let made = || {
        let words = ["-n", &names[1], "address", "show", "up"];
        let output = Command::new("ip").args(words).output().unwrap();
        String::from_utf8(output.stdout).unwrap().contains("10.0.0.3")
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
    // The kernel looks for routers and neighbours when it likes.
    let count = |what: &str| report["totals"][what].as_u64().unwrap();
    assert_eq!(count("sent"), count("delivered") + count("underway"), "{report}");
    assert_eq!(report["links"].as_array().unwrap().len(), 6);
    assert!(names.iter().all(|name| !Path::new("/run/netns").join(name).exists()));
}
