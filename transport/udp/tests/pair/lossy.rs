//! What frames cost where packets are lost: time and bytes.

use std::time::Duration;

use trimaran_udp::{Config, Repair};

use crate::network::{Network, Pair, SEALED};
use crate::talk::{RELIABLE, Reader, stream};

/// What UDP and IPv4 add to a packet, bytes.
const BELOW: u64 = 28;

/// The time that all but one frame in a thousand take at most.
fn slowest(reader: &Reader) -> Duration {
    let latencies = reader.latencies();
    latencies[latencies.len() - 1 - latencies.len() / 1000]
}

/// The bytes of both directions, headers of the layers below included.
fn bytes(pair: &Pair) -> u64 {
    pair.bytes.iter().sum::<u64>() + pair.sent * BELOW
}

/// One packet in a hundred is lost, 5 ms one way: a frame that waits for a repetition takes 15 ms.
#[test]
fn with_repair_one_frame_in_a_thousand_waits_for_one_repetition_at_most() {
    for seed in 1..4 {
        let lossy = Network { loss: 10, mtu: 1500, seed, ..SEALED };
        let (plain, waiting) = stream(lossy, Config { repair: Repair::Off, ..RELIABLE }, 60);
        let (repaired, reader) = stream(lossy, RELIABLE, 60);
        assert_eq!((waiting.gaps.len(), reader.gaps.len()), (0, 0));
        let (without, with) = (slowest(&waiting), slowest(&reader));
        assert!(with <= Duration::from_millis(16), "{with:?}");
        assert!(without >= Duration::from_millis(20), "{without:?}: there is nothing to gain");
        let (without, with) = (bytes(&plain), bytes(&repaired));
        assert!(with * 1000 <= without * 1160, "{with} bytes where without repair they are {without}");
    }
}
