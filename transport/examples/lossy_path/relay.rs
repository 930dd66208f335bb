//! Carries packets from one device to the other, late or never.
#![allow(clippy::disallowed_methods, reason = "packets of the kernel keep the kernel's time")]

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use tun_rs::SyncDevice;

/// The one-way delay.
const ONE_WAY: Duration = Duration::from_millis(5);

/// A loss model: two states (Gilbert and Elliott), the chances in 1/1000.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Loss {
    pub(crate) word: &'static str,
    pub(crate) name: &'static str,
    to_bad: u64,
    to_good: u64,
    lost_in_good: u64,
    lost_in_bad: u64,
}

/// The paths.
pub(crate) const LOSSES: &[Loss] = &[
    Loss { word: "none", name: "none", to_bad: 0, to_good: 1000, lost_in_good: 0, lost_in_bad: 0 },
    Loss { word: "random", name: "1 %, random", to_bad: 0, to_good: 1000, lost_in_good: 10, lost_in_bad: 0 },
    // A burst each 300 packets, of 4 on average, three of four lost.
    Loss {
        word: "bursts",
        name: "1 %, bursts of 4",
        to_bad: 3,
        to_good: 250,
        lost_in_good: 0,
        lost_in_bad: 750,
    },
];

impl Loss {
    pub(crate) const fn is_none(self) -> bool {
        self.lost_in_good == 0 && self.lost_in_bad == 0
    }
}

/// Packets and bytes carried.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) packets: AtomicU64,
    pub(crate) bytes: AtomicU64,
    pub(crate) lost: AtomicU64,
}

/// Carries packets from `from` to `to` until `from` is removed.
pub(crate) fn carry(from: Arc<SyncDevice>, to: Arc<SyncDevice>, loss: Loss, seed: u64, tally: Arc<Tally>) {
    let (late, due) = mpsc::channel::<(Instant, Vec<u8>)>();
    thread::spawn(move || {
        for (at, packet) in due {
            thread::sleep(at.saturating_duration_since(Instant::now()));
            if to.send(&packet).is_err() {
                return;
            }
        }
    });
    thread::spawn(move || -> io::Result<()> {
        let (mut fate, mut packet) = (Fate { loss, bad: false, state: seed }, vec![0; 2000]);
        loop {
            let length = from.recv(&mut packet)?;
            let bytes = packet.get(..length).unwrap_or_default();
            // Only IPv4 belongs to the experiment; the system looks for routers over IPv6.
            if bytes.first().is_none_or(|byte| byte >> 4 != 4) {
                continue;
            }
            tally.packets.fetch_add(1, Ordering::Relaxed);
            tally.bytes.fetch_add(length as u64, Ordering::Relaxed);
            if fate.loses() {
                tally.lost.fetch_add(1, Ordering::Relaxed);
            } else if late.send((Instant::now() + ONE_WAY, bytes.to_vec())).is_err() {
                return Ok(());
            }
        }
    });
}

/// Decides the loss of each packet.
struct Fate {
    loss: Loss,
    bad: bool,
    state: u64,
}

impl Fate {
    fn loses(&mut self) -> bool {
        let Loss { to_bad, to_good, lost_in_good, lost_in_bad, .. } = self.loss;
        let turn = if self.bad { to_good } else { to_bad };
        self.bad ^= self.chance(turn);
        let share = if self.bad { lost_in_bad } else { lost_in_good };
        self.chance(share)
    }

    /// Splitmix64.
    fn chance(&mut self, per_mille: u64) -> bool {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) % 1000 < per_mille
    }
}
