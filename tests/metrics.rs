//! What a running session tells a monitoring system and `trimaran stat`.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};

fn trimaran(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trimaran"));
    command.current_dir(folder).args(args);
    command
}

fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// The number behind a line that starts with `series`.
fn value(text: &str, series: &str) -> u64 {
    let line = text.lines().find_map(|line| line.strip_prefix(series));
    line.unwrap_or_else(|| panic!("no {series} in {text}")).trim().parse().unwrap()
}

#[test]
fn a_running_session_shows_what_its_links_carry() {
    let folder = tempfile::tempdir().unwrap();
    let plant = ["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "plant.scene"];
    assert!(trimaran(folder.path(), &plant).output().unwrap().status.success());
    // More frames than there will be time for: it is interrupted at the end.
    let args = [
        "run",
        "plant.scene",
        "--link",
        "tcp",
        "--metrics",
        "127.0.0.1:0",
        "--frames",
        "1000000",
        "--size",
        "32x32",
    ];
    let mut session =
        trimaran(folder.path(), &args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(session.stderr.take().unwrap());
    let address = loop {
        let mut line = String::new();
        assert!(said.read_line(&mut line).unwrap() > 0, "the session ended");
        if let Some((_, rest)) = line.split_once("http://") {
            break rest.trim().trim_end_matches("/metrics").to_owned();
        }
    };
    let received =
        |text: &str| value(text, "trimaran_link_frames_total{peer=\"switch A\",direction=\"received\"}");
    while received(&get(&address, "/metrics")) == 0 {}
    let stat =
        trimaran(folder.path(), &["stat", &address, "--interval", "0.3", "--count", "2"]).output().unwrap();
    let lines = trimaran(folder.path(), &["stat", &address, "--json", "--count", "1"]).output().unwrap();
    let metrics = get(&address, "/metrics");
    let missing = get(&address, "/nowhere");
    // Interrupted once, it writes a report; twice, it leaves.
    for _ in 0..2 {
        // The shell's own: the program of that name is not on every machine.
        Command::new("sh").args(["-c", &format!("kill -INT {}", session.id())]).status().unwrap();
    }
    session.wait().unwrap();

    assert!(metrics.starts_with("HTTP/1.1 200 OK") && metrics.trim_end().ends_with("# EOF"), "{metrics}");
    let frames = received(&metrics);
    let begins =
        value(&metrics, "trimaran_link_bytes_total{peer=\"switch A\",direction=\"received\",kind=\"begin\"}");
    assert!(
        frames > 0 && (76 * frames..=76 * (frames + 1)).contains(&begins),
        "{frames} frames, {begins} bytes"
    );
    assert!(missing.starts_with("HTTP/1.1 404"), "{missing}");
    let table = String::from_utf8(stat.stdout).unwrap();
    assert_eq!(table.lines().filter(|line| line.starts_with("peer")).count(), 2, "{table}");
    assert_eq!(table.lines().filter(|line| line.trim_start().starts_with("received")).count(), 4, "{table}");
    let readings: serde_json::Value = serde_json::from_slice(&lines.stdout).unwrap();
    assert_eq!((&readings[0]["peer"], &readings[1]["peer"]), (&"switch A".into(), &"switch B".into()));
    assert!(readings[0]["received"]["ids"].as_u64().unwrap() > 0);
}

#[test]
fn stat_says_when_nothing_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let output = trimaran(folder.path(), &["stat", "127.0.0.1:1"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("127.0.0.1:1") && said.contains("--metrics"), "{said}");
}
