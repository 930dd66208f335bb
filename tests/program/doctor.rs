//! `trimaran config check` and `trimaran doctor --config`: each mistake in a deployment is named in one line.

use std::{
    env,
    fs::{self, Permissions},
    io::{Read, Write},
    net::{TcpListener, UdpSocket},
    os::unix::fs::PermissionsExt,
    process::Output,
    thread,
};

use bytes::BytesMut;
use serde_json::Value;
use trimaran_transport::{Refusal, WireVersion};
use trimaran_wire::Message;

use crate::common::ports::unused_port;
use crate::common::program::{Bench, Process, said};

/// A folder with the keys of a relay, a culler and a stranger.
fn bench_with_keys() -> Bench {
    let bench = Bench::empty();
    for name in ["hall", "one", "stranger"] {
        bench.done(&["keys", "new", name]);
    }
    bench
}

/// The flags for checks as the user of the tests, also where the services and their user are installed.
pub(crate) fn as_present_user() -> &'static [&'static str] {
    if nix::unistd::geteuid().is_root() { &["--user", "root"] } else { &[] }
}

fn doctor(bench: &Bench, file: &str, more: &[&str]) -> Output {
    bench.trimaran(&[&["doctor", "--config", file], as_present_user(), more].concat())
}

/// The lines of an output that are not fine.
fn faults(output: &Output) -> Vec<String> {
    let lines = String::from_utf8_lossy(&output.stdout);
    let faults =
        lines.lines().filter(|line| ["MISSING ", "WRONG "].iter().any(|mark| line.starts_with(mark)));
    faults.map(str::to_owned).collect()
}

/// Checks that the output names one fault, with all of `words`.
fn names(output: &Output, code: i32, words: &[&str]) {
    let faults = faults(output);
    let all = || format!("{words:?}\n{}{}", String::from_utf8_lossy(&output.stdout), said(output));
    assert!(faults.len() == 1 && words.iter().all(|word| faults[0].contains(word)), "{}", all());
    assert_eq!(output.status.code(), Some(code), "{}", all());
}

/// A peer that stands for a culler with a scene of its own, and its endpoint.
fn answering(bench: &Bench, endpoint: &str, more: &[&str]) -> (Process, String) {
    let mut process = bench.start(&[&["ping", "--answer", endpoint], more].concat());
    let line = process.says("answers pings on");
    let endpoint = line.trim().rsplit(' ').next().unwrap().to_owned();
    (process, endpoint)
}

/// A listener of a release with another version of the wire.
fn another_release() -> String {
    let mut refusal = BytesMut::new();
    Message::Refuse(Refusal::Busy).encode(&mut refusal);
    // The version stands before the one byte of that refusal.
    let at = refusal.len() - 3;
    assert_eq!(refusal[at..at + 2], WireVersion::LOWEST.0.to_le_bytes());
    refusal[at..at + 2].copy_from_slice(&(WireVersion::CURRENT.0 + 1).to_le_bytes());
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for mut stream in listener.incoming().map(Result::unwrap) {
            let _hello = stream.read(&mut [0; 1024]);
            let _gone = stream.write_all(&refusal);
        }
    });
    endpoint
}

fn relay(upstream: &str, listen: &str, keys: &str) -> String {
    format!("upstream = '{upstream}'\nlisten = '{listen}'\nkeys = '{keys}'\npeers.upstream = ['one.pub']\n")
}

#[test]
fn each_mistake_in_a_deployment_is_named_in_one_line() {
    let bench = bench_with_keys();
    let (_culler, culler) = answering(&bench, "tcp://127.0.0.1:0", &[]);
    let known = ["--keys", "one.key", "--peer", "hall.pub"];
    let (_encrypted, encrypted) = answering(&bench, "quic://127.0.0.1:0", &known);
    let own = format!("tcp://127.0.0.1:{}", unused_port());
    let [tcp, silent] = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    let [udp, dropping] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    let [tcp, silent] = [&tcp, &silent].map(|socket| format!("tcp://{}", socket.local_addr().unwrap()));
    let [udp, dropping] = [&udp, &dropping].map(|socket| socket.local_addr().unwrap());
    let soon = &["--timeout", "0.3"][..];
    let later = &["--timeout", "60"][..];
    for (file, more, words) in [
        // The port of another program.
        (relay(&culler, &tcp, "hall.key"), later, &["port", &tcp, "in use"][..]),
        (
            relay(&encrypted, &format!("udp://{udp}"), "hall.key"),
            later,
            &["port", &udp.to_string(), "in use"],
        ),
        // Packets that nobody answers.
        (relay(&silent, &own, "hall.key"), soon, &["peer", &silent, "no answer", "a firewall drops TCP"]),
        (
            relay(&format!("quic://{dropping}"), &own, "hall.key"),
            soon,
            &["peer", &dropping.to_string(), "no answer", "a firewall drops UDP"],
        ),
        // Keys that the peer does not know.
        (
            relay(&encrypted, &own, "stranger.key"),
            later,
            &["peer", &encrypted, "does not expect our certificate"],
        ),
        // Another release.
        (
            relay(&another_release(), &own, "hall.key"),
            later,
            &["peer", "version 6", "install the same release"],
        ),
        // A name without an address.
        (
            relay("tcp://oen.invalid:7400", &own, "hall.key"),
            later,
            &["peer", "oen.invalid", "check the name"],
        ),
        // A role that has not been started.
        (
            relay(&format!("tcp://127.0.0.1:{}", unused_port()), &own, "hall.key"),
            later,
            &["peer", "nothing listens there"],
        ),
    ] {
        bench.write("hall.toml", file);
        // Without a name server a name would take as long as a silent peer.
        let mut command =
            bench.command(&[&["doctor", "--config", "hall.toml"], as_present_user(), more].concat());
        names(&command.env("RES_OPTIONS", "timeout:1 attempts:1").output().unwrap(), 1, words);
    }
    bench.write("hall.toml", relay(&culler, &own, "hall.key"));
    let fine = doctor(&bench, "hall.toml", later);
    assert!(fine.status.success() && faults(&fine).is_empty(), "{}", said(&fine));
    let lines = String::from_utf8_lossy(&fine.stdout).into_owned();
    assert!(lines.contains(&format!("peer    upstream: {culler} is a culler\n")), "{lines}");
}

#[test]
fn a_key_that_others_may_read_and_a_misspelt_key_are_named_before_the_start() {
    let bench = bench_with_keys();
    let file = |more: &str| relay("quic://127.0.0.1:1", "tcp://127.0.0.1:0", "hall.key") + more;
    let check = || bench.trimaran(&["config", "check", "hall.toml"]);
    bench.write("hall.toml", file(""));
    let fine = check();
    let lines = String::from_utf8_lossy(&fine.stdout);
    assert!(fine.status.success() && lines.contains("hall.toml is a relay's"), "{lines}");
    assert!(lines.contains("this machine is hall, and knows one"), "{lines}");
    for (mistake, words) in [
        ("upstraem = 'tcp://one:7400'\n", &["file", "hall.toml", "upstraem", "line 5"][..]),
        ("limits.peers = 'many'\n", &["file", "line 5", "many"]),
        ("udp.mode = 'deadline'\n", &["file", "udp.mode"]),
    ] {
        bench.write("hall.toml", file(mistake));
        names(&check(), 2, words);
    }
    bench.write("hall.toml", file(""));
    fs::set_permissions(bench.path("hall.key"), Permissions::from_mode(0o644)).unwrap();
    names(&check(), 2, &["keys", "others may read", "hall.key", "mode 644", "chmod 600"]);
    names(&doctor(&bench, "hall.toml", &["--timeout", "60"]), 2, &["keys", "mode 644"]);
    names(&bench.trimaran(&["config", "check", "none.toml"]), 2, &["file", "none.toml"]);
    let as_another = bench.trimaran(&["config", "check", "hall.toml", "--role", "watcher"]);
    names(&as_another, 2, &["file", "unknown key", "read as a watcher's"]);
}

#[test]
fn another_scene_and_a_device_that_is_not_there_are_named() {
    let bench = Bench::with_plant(60);
    let (_culler, culler) = answering(&bench, "tcp://127.0.0.1:0", &[]);
    let file = |more: &str| format!("scene = 'plant.scene'\ncullers = '{culler}'\nout = 'walk'\n{more}");
    bench.write("show.toml", file(""));
    let diagnosed = doctor(&bench, "show.toml", &["--timeout", "60"]);
    let peer = faults(&diagnosed).into_iter().filter(|line| line.starts_with("MISSING peer "));
    let peer: Vec<_> = peer.collect();
    let words = ["cullers: ", &culler, "the listener holds scene", "same cooked file"];
    assert!(peer.len() == 1 && words.iter().all(|word| peer[0].contains(word)), "{peer:?}");
    assert_eq!(diagnosed.status.code(), Some(1));
    let check = || bench.trimaran(&["config", "check", "show.toml"]);
    let fine = check();
    assert!(fine.status.success() && !bench.path("walk").exists(), "{}", said(&fine));
    bench.write("show.toml", file("device = 'Voodoo 2'\n"));
    names(&check(), 2, &["device", "Voodoo 2", "this machine has: #0 "]);
    bench.write("show.toml", file("[session]\npath = 'nowhere.json'\n"));
    names(&check(), 2, &["walk", "nowhere.json"]);
    let whole = fs::read(bench.path("plant.scene")).unwrap();
    bench.write("show.toml", file(""));
    bench.write("plant.scene", &whole[..whole.len() / 2]);
    names(&check(), 1, &["scene", "plant.scene", "cut short"]);
    let json = bench.trimaran(&["config", "check", "show.toml", "--json"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    let scene =
        json["findings"].as_array().unwrap().iter().find(|finding| finding["what"] == "scene").unwrap();
    assert_eq!(
        (&json["works"], &scene["works"], &scene["must_correct"]),
        (&false.into(), &false.into(), &false.into())
    );
}

/// The card is a file in a `/dev` that only the program sees.
///
/// Needs Linux and root; elsewhere it says that it is skipped, and fails if `TRIMARAN_REQUIRE_NETNS` is 1.
#[cfg(target_os = "linux")]
#[test]
fn a_card_that_the_services_user_may_not_open_is_named() {
    if let Err(missing) = trimaran::netem::Emulation::possible() {
        assert!(env::var_os("TRIMARAN_REQUIRE_NETNS").is_none_or(|value| value != "1"), "{missing}");
        println!("skipped: {missing}");
        return;
    }
    let bench = Bench::with_plant(60);
    bench.write("one.toml", "scene = 'plant.scene'\nlisten = 'tcp://127.0.0.1:0'\n");
    fs::set_permissions(bench.path(""), Permissions::from_mode(0o755)).unwrap();
    let script = "mount -t tmpfs none /dev && mkdir /dev/dri && touch /dev/dri/renderD128 && \
                  chmod 600 /dev/dri/renderD128 && exec \"$0\" doctor --config one.toml --user nobody";
    let program = env!("CARGO_BIN_EXE_trimaran");
    let output = bench.command_of("unshare", &["-m", "sh", "-c", script, program]).output().unwrap();
    let faults = faults(&output);
    let words = ["nodes", "nobody may not open /dev/dri/renderD128", "mode 600", "udev"];
    let named = faults.iter().filter(|line| words.iter().all(|word| line.contains(word))).count();
    assert!(named == 1 && output.status.code() == Some(1), "{faults:?} {}", said(&output));
    assert!(!faults.iter().any(|line| line.contains("scene") || line.contains("access")), "{faults:?}");
}
