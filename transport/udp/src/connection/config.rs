//! The configuration of a connection.

use std::time::Duration;

use trimaran_wire::{BatchSize, Format};

use crate::repair::Repair;

/// The configuration of a connection. Both ends must agree on the window.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// The sizes of the application's values. Both ends must agree on them.
    pub format: Format,
    /// The most items delivered at once. Default 256.
    pub batch: BatchSize,
    /// Whether batches of frames sent from here may be coded. Default not.
    pub coded: bool,
    /// Bytes of the frames lane that the receiver buffers for a slow reader. Default 4 MiB.
    pub window: u64,
    /// Bytes that the sender keeps until they are acknowledged. Default 4 MiB.
    pub send_buffer: usize,
    /// How long an acknowledgement may be delayed. Default 1 ms.
    pub ack_delay: Duration,
    /// The time without any arrival, or without an acknowledgement of sent data, after which the peer counts
    /// as dead. Default 20 s; a quarter of it without traffic sends a ping.
    pub idle_timeout: Duration,
    /// How long after its end a frame sent from here is worth sending. Data that cannot arrive in time is
    /// given up, and the peer gets the frame with gaps. `None`, the default, for ever.
    pub frame_deadline: Option<Duration>,
    /// When frames sent from here get forward error correction. Default while packets are lost.
    pub repair: Repair,
    /// The largest cost of repair, percent of the bytes without it: its packets, and the headers of those
    /// that are smaller for it. Default 15; 0 for none.
    pub repair_percent: u8,
    /// The initial window in packets, at least 2; ten leave at once, the rest over the round trip. Default
    /// 20: a frame of 16 kB and its repair are 17. RFC 9002 (section 7.2) recommends 10.
    pub initial_window: u16,
    /// The largest datagram that is probed, bytes; 1,200 are always used. Default 1,452: Ethernet's 1,500
    /// less the headers of IPv6 and UDP.
    pub max_datagram: usize,
}

impl Config {
    /// The defaults for values of these sizes.
    #[must_use]
    pub fn new(format: Format) -> Self {
        Self {
            format,
            batch: BatchSize::default(),
            coded: false,
            window: 4 << 20,
            send_buffer: 4 << 20,
            ack_delay: Duration::from_millis(1),
            idle_timeout: Duration::from_secs(20),
            frame_deadline: None,
            repair: Repair::default(),
            repair_percent: 15,
            initial_window: 20,
            max_datagram: 1452,
        }
    }
}
