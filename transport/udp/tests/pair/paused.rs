//! A sender that a busy machine lets run only now and then.

use std::time::Duration;

use trimaran_proto::Instant;

use crate::network::{Network, ONE_WAY, Pair, SEALED};
use crate::talk::{RELIABLE, Reader, Sender, ids};

const FRAMES: u32 = 600;
/// More than a frame's time, and more than a round trip.
const PAUSE: Duration = Duration::from_millis(20);

/// It has to catch up with a frame and a quarter each time: more packets than may leave at once after a time in which none was due.
#[test]
fn a_sender_that_runs_seldom_falls_behind_by_what_it_sleeps_and_no_more() {
    let mut pair = Pair::new(Network { mtu: 1500, ..SEALED }, RELIABLE);
    let (mut sender, mut reader) = (Sender::new(RELIABLE), Reader::default());
    let ids = ids(4000);
    let due = |frame: u32| Instant::from_nanos(u64::from(frame) * 1_000_000_000 / 60);
    let mut frames = 0..FRAMES;
    while reader.frames.len() < FRAMES as usize {
        assert!(pair.now < due(2 * FRAMES), "{} of {FRAMES} frames have come", reader.frames.len());
        while due(frames.start) <= pair.now
            && let Some(frame) = frames.next()
        {
            reader.begun.push(pair.now);
            sender.send(&mut pair.ends[0], frame, &ids);
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
    let latencies = reader.latencies();
    let median = latencies[latencies.len() / 2];
    assert!(median <= ONE_WAY + PAUSE, "{median:?}");

    // The first ones wait for the window to grow.
    let slowest = latencies[latencies.len() - 1];
    assert!(slowest <= PAUSE * 5, "{slowest:?}");
}
