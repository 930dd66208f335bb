//! The receiver's cost per byte of a packet: ordinary frames, and packets of a peer that knows the key and
//! makes them costly. `cargo bench -p trimaran-udp --bench costs`; packets are in plaintext, so that sealing
//! is not among the costs.
#![allow(clippy::disallowed_methods, reason = "a benchmark keeps the machine's time")]

#[allow(unreachable_pub, dead_code, reason = "a test uses it too")]
#[path = "../tests/adversary/mod.rs"]
mod adversary;

#[allow(unreachable_pub, dead_code, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/wire.rs"]
mod wire;

use std::time::{Duration, Instant};

use adversary::{Attack, Victim, attacks, frames_behind_one_that_never_arrives, ordinary};

/// A longer attack is cut off.
const LONGEST: Duration = Duration::from_secs(1);
/// How often each is tried: for each packet the fastest time counts, as others share the machine.
const TRIES: usize = 7;

fn main() {
    println!("| packets | bytes | ns a byte | dearest packet, us | left open |");
    println!("|---|---|---|---|---|");
    show(|| frames(ordinary(100, 4000)));
    for index in 0..attacks(1).len() {
        show(|| frames(attacks(20_000).swap_remove(index)));
    }
    show(|| {
        let (victim, packets) = frames_behind_one_that_never_arrives(20_000, 2000);
        ("frames behind one that never arrives", victim, packets)
    });
}

fn frames(Attack { name, before, packets }: Attack) -> (&'static str, Victim, Vec<Vec<u8>>) {
    let mut victim = Victim::new();
    before.iter().for_each(|packet| victim.take(packet));
    (name, victim, packets)
}

fn show(mut make: impl FnMut() -> (&'static str, Victim, Vec<Vec<u8>>)) {
    let mut fastest: Vec<Duration> = Vec::new();
    let (mut line, mut bytes) = (None, 0);
    for round in 0..TRIES {
        let (name, mut victim, packets) = make();
        let begun = Instant::now();
        for (at, packet) in packets.iter().enumerate() {
            let before = Instant::now();
            victim.take(packet);
            let took = before.elapsed();
            match fastest.get_mut(at) {
                Some(fastest) => *fastest = took.min(*fastest),
                None if round == 0 && begun.elapsed() < LONGEST => {
                    fastest.push(took);
                    bytes += packet.len();
                }
                None => break,
            }
        }
        line = Some((name, victim.connection.closed().map_or("yes".to_owned(), ToString::to_string)));
    }
    let Some((name, open)) = line else { return };
    let each = fastest.iter().sum::<Duration>().as_nanos() as f64 / bytes.max(1) as f64;
    let dearest = fastest.iter().max().map_or(0, Duration::as_micros);
    println!("| {name} | {bytes} | {each:.1} | {dearest} | {open} |");
}
