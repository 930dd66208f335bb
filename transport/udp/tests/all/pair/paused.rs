//! A sender that rarely gets to run on a busy machine.

use std::time::Duration;

use trimaran_net::Instant;

use super::network::{Network, ONE_WAY, Pair, SEALED};
use super::talk::{RELIABLE, Reader, Sender, items};

/// More than a frame's time, and more than a round trip.
const PAUSE: Duration = Duration::from_millis(20);

/// The latencies of so many frames, rising.
fn latencies(count: u32, network: Network) -> Vec<Duration> {
    let mut pair = Pair::new(network, RELIABLE);
    let (mut sender, mut reader) = (Sender::new(RELIABLE), Reader::default());
    let items = items(4000);
    let due = |frame: u32| Instant::from_nanos(u64::from(frame) * 1_000_000_000 / 60);
    let mut frames = 0..count;
    while reader.frames.len() < count as usize {
        assert!(pair.now < due(2 * count), "{} of {count} frames have come", reader.frames.len());
        while due(frames.start) <= pair.now
            && let Some(frame) = frames.next()
        {
            reader.begun.push(pair.now);
            sender.send(&mut pair.ends[0], frame, &items);
        }
        pair.transmit();
        pair.asleep_until = pair.now.after(PAUSE);
        while pair.step_until(pair.asleep_until, pair.asleep_until) {
            reader.now = pair.now;
            reader.read(&mut pair.ends[1]);
        }
        reader.now = pair.now;
        reader.read(&mut pair.ends[1]);
    }
    reader.latencies()
}

fn median(latencies: &[Duration]) -> Duration {
    latencies[latencies.len() / 2]
}

fn slowest(latencies: &[Duration]) -> Duration {
    latencies[latencies.len() - 1]
}

/// It has to catch up by a frame and a quarter each time: more packets than a burst after an idle time.
#[test]
fn a_sender_that_runs_seldom_falls_behind_by_what_it_sleeps_and_no_more() {
    let latencies = latencies(600, Network { mtu: 1500, ..SEALED });
    let (median, slowest) = (median(&latencies), slowest(&latencies));
    assert!(median <= ONE_WAY + PAUSE, "{median:?}");
    // The first ones wait for the window to grow.
    assert!(slowest <= PAUSE * 5, "{slowest:?}");
}

#[test]
fn bursts_of_loss_do_not_make_it_fall_behind_either() {
    for seed in 1..9 {
        let latencies = latencies(3600, Network { mtu: 1500, bursts: 3, seed, ..SEALED });
        let (median, slowest) = (median(&latencies), slowest(&latencies));
        assert!(median <= ONE_WAY + PAUSE && slowest <= PAUSE * 7, "seed {seed}: {median:?}, {slowest:?}");
    }
}
