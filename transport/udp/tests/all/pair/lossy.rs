//! The cost of frames where packets are lost: time and bytes, on the path of the example `lossy_path`, but in
//! virtual time. With `--nocapture` the tests print it.

use std::time::Duration;

use trimaran_net::Instant;
use trimaran_udp::{Config, Repair};

use super::network::{Network, ONE_WAY, Pair, SEALED};
use super::talk::{RELIABLE, Reader, Sender, items};

/// The headers of UDP and IPv4, bytes.
const BELOW: u64 = 28;
/// Frames per run.
const FRAMES: u32 = 3600;
const CLEAN: Network = Network { mtu: 1500, ..SEALED };
const RANDOM: Network = Network { loss: 10, ..CLEAN };
const BURSTS: Network = Network { bursts: 3, ..CLEAN };
/// A frame that takes longer than this waited for a round trip.
const WAITED: Duration = Duration::from_millis(10);

/// Several runs.
struct Runs {
    /// Rising.
    latencies: Vec<Duration>,
    /// With the headers of the layers below.
    bytes: u64,
    /// Frames that did not arrive complete.
    gaps: usize,
}

impl Runs {
    /// Three runs without gaps.
    fn of(network: Network, repair: Repair) -> Self {
        let runs = Self::many(1..4, network, Config { repair, ..RELIABLE });
        assert_eq!(runs.gaps, 0);
        runs
    }

    /// One run for each seed.
    fn many(seeds: impl IntoIterator<Item = u64>, network: Network, config: Config) -> Self {
        let mut runs = Self { latencies: Vec::new(), bytes: 0, gaps: 0 };
        for seed in seeds {
            let (pair, reader) = run(Network { seed, ..network }, config);
            assert_eq!(reader.frames.len(), FRAMES as usize);
            runs.latencies.extend(reader.latencies());
            runs.bytes += pair.bytes.iter().sum::<u64>() + pair.sent * BELOW;
            runs.gaps += reader.gaps.len();
        }
        runs.latencies.sort_unstable();
        println!(
            "{} in 1000 lost, {} bursts, repair {:?}, deadline {:?}: of {} frames {} waited, {} have gaps, p99.9 {:?}, slowest {:?}, \
             {} bytes each",
            network.loss,
            network.bursts,
            config.repair,
            config.frame_deadline,
            runs.latencies.len(),
            runs.waited(),
            runs.gaps,
            runs.p999(),
            runs.slowest(),
            runs.bytes / runs.latencies.len() as u64,
        );
        runs
    }

    fn waited(&self) -> usize {
        self.latencies.iter().filter(|latency| **latency > WAITED).count()
    }

    fn slowest(&self) -> Duration {
        self.latencies.last().copied().unwrap_or_default()
    }

    /// All but one frame in a thousand take at most this.
    fn p999(&self) -> Duration {
        self.latencies[self.latencies.len() - 1 - self.latencies.len() / 1000]
    }
}

/// Sixty frames of 4,000 items a second, and nothing else.
fn run(network: Network, config: Config) -> (Pair, Reader) {
    let mut pair = Pair::new(network, config);
    let (mut sender, mut reader) = (Sender::new(config), Reader::default());
    let items = items(4000);
    for frame in 0..=FRAMES {
        let due = Instant::from_nanos(u64::from(frame) * 1_000_000_000 / 60);
        let wake = if frame < FRAMES { due } else { due.after(Duration::from_secs(2)) };
        while pair.step_until(wake, wake) {
            reader.now = pair.now;
            reader.read(&mut pair.ends[1]);
        }
        if frame < FRAMES {
            reader.begun.push(pair.now);
            sender.send(&mut pair.ends[0], frame, &items);
        }
    }
    (pair, reader)
}

/// The first one is larger than the initial burst: the rest of it is spread over the round trip of the
/// handshake.
#[test]
fn without_loss_every_frame_takes_the_way_and_the_first_one_no_round_trip_more() {
    let clean = Runs::of(CLEAN, Repair::Auto);
    assert_eq!((clean.waited(), clean.p999()), (0, ONE_WAY));
    assert!(clean.slowest() < ONE_WAY + Duration::from_millis(2), "{:?}", clean.slowest());

    // With the window that RFC 9002 recommends it waits for an acknowledgement.
    let ten = Runs::many(1..4, CLEAN, Config { initial_window: 10, ..RELIABLE });
    assert_eq!((ten.waited(), ten.slowest()), (3, 3 * ONE_WAY));
}

#[test]
fn repair_spares_almost_all_frames_a_wait_for_a_seventh_more_bytes() {
    let clean = Runs::of(CLEAN, Repair::Auto).bytes;
    let (plain, repaired) = (Runs::of(RANDOM, Repair::Off), Runs::of(RANDOM, Repair::Auto));
    assert!(plain.waited() > 1000, "{}: there is nothing to gain", plain.waited());
    assert!(plain.bytes * 1000 < clean * 1015, "{} and {clean} bytes", plain.bytes);
    // Except for those of a run that loses its first packet.
    assert!(repaired.waited() <= 3 + 9, "{} of {}", repaired.waited(), 3 * FRAMES);
    assert!(repaired.slowest() < Duration::from_millis(30), "{:?}", repaired.slowest());
    assert!(repaired.bytes * 1000 <= clean * 1150, "{} and {clean} bytes", repaired.bytes);
}

#[test]
fn bursts_make_few_frames_wait_and_no_link_stand_still() {
    let clean = Runs::of(CLEAN, Repair::Auto).bytes;
    let (plain, repaired) = (Runs::of(BURSTS, Repair::Off), Runs::of(BURSTS, Repair::Auto));
    assert!(repaired.waited() * 5 < plain.waited() * 4, "{} and {}", repaired.waited(), plain.waited());
    assert!(repaired.p999() < Duration::from_millis(60), "{:?}", repaired.p999());
    assert!(repaired.bytes * 1000 <= clean * 1150, "{} and {clean} bytes", repaired.bytes);
}

/// A burst of losses may take the acknowledgements of several frames, as they are few: a sender without them
/// has no room in its window.
#[test]
fn no_frame_is_late_for_lost_acknowledgements() {
    let deadline = Config { frame_deadline: Some(Duration::from_millis(50)), ..RELIABLE };
    for repair in [Repair::Off, Repair::Auto] {
        // The last seed has a long burst that finds the window full.
        let runs = Runs::many((1..6).chain([22]), BURSTS, Config { repair, ..deadline });
        assert_eq!(runs.gaps, 0);
        assert!(runs.slowest() <= Duration::from_millis(50), "{:?}", runs.slowest());
    }
}
