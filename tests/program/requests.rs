//! The cost of HTTP requests to a service of pages.

use std::{
    fs,
    io::{Read, Write},
    net::TcpStream,
    thread,
    time::Duration,
};

use crate::common::page::{Service, TOKEN};
use crate::common::program::Bench;

/// How often the service's CPU time is read, and for how many readings it must be idle.
const PAUSE: Duration = Duration::from_millis(100);
const IDLE: usize = 10;

/// Ticks of processors that a process has taken.
fn ticks(process: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    [11, 12].iter().map(|field| fields[*field].parse::<u64>().unwrap()).sum()
}

/// The same once it has nothing to do.
fn ticks_at_rest(process: u32) -> u64 {
    let (mut before, mut idle) = (ticks(process), 0);
    while idle < IDLE {
        thread::sleep(PAUSE);
        let now = ticks(process);
        idle = if now == before { idle + 1 } else { 0 };
        before = now;
    }
    before
}

fn tile(x: i32, z: i32) -> String {
    format!("/tile?token={TOKEN}&x={x}&z={z}")
}

/// A client that asks and goes away leaves no work behind, and delays nobody.
#[test]
fn work_for_askers_that_are_gone_is_given_up() {
    const GONE: u64 = 200;
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "4000", "--triangles", "4000000", "-o", "plant.scene"]);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let process = service.process();
    let mut before = ticks_at_rest(process);
    let mut costs = Vec::new();
    // The most expensive of all tiles.
    for (x, z) in (-3..=3).flat_map(|x| (-3..=3).map(move |z| (x, z))) {
        assert!(service.status(&tile(x, z), "").starts_with("HTTP/1.1 200"));
        let now = ticks(process);
        costs.push((now - before, x, z));
        before = now;
    }
    let (cost, x, z) = costs.into_iter().max().unwrap();
    // Another service has not made it yet.
    drop(service);
    let service = Service::start(&bench, "127.0.0.1:0").unwrap();
    let process = service.process();
    let before = ticks_at_rest(process);
    for _ in 0..GONE {
        let mut stream = TcpStream::connect(&service.at).unwrap();
        write!(stream, "GET {} HTTP/1.1\r\nHost: {}\r\n\r\n", tile(x, z), service.at).unwrap();
        // It is requested before they go.
        thread::sleep(Duration::from_millis(2));
    }
    let answer = service.status(&format!("/part?token={TOKEN}&object=0"), "");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    let spent = ticks_at_rest(process) - before;
    println!("a tile takes {cost} ticks, {GONE} abandoned requests {spent}");
    assert!(cost >= 2 && spent < GONE * cost / 4, "{spent} ticks, and a tile takes {cost}");
}

/// Every question is answered or told to come again.
#[test]
fn many_questions_at_once_are_answered_or_told_to_come_again() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let ask = |number: i32| {
        let mut stream = TcpStream::connect(&service.at).unwrap();
        let target = tile(number, 0);
        write!(stream, "GET {target} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", service.at).unwrap();
        stream
    };
    let streams: Vec<TcpStream> = (0..250).map(ask).collect();
    for mut stream in streams {
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let is_told = answer.starts_with("HTTP/1.1 503") && answer.contains("retry-after: 1");
        assert!(answer.starts_with("HTTP/1.1 200") || is_told, "{answer:.200}");
    }
    assert!(service.status(&tile(0, 0), "").starts_with("HTTP/1.1 200"));
}
