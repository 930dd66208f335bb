//! Carries packets from device to device at their time.
#![allow(clippy::disallowed_methods, reason = "packets of the kernel keep the kernel's time")]

use parking_lot::{Mutex, MutexGuard};
use std::io;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant as Clock};

use hdrhistogram::{CreationError, Histogram};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::setpriority_process;
use rustix::thread::set_current_timer_slack;
use serde::Serialize;
use trimaran_netsim::link::{Ecn, LinkTally, Parcel};
use trimaran_netsim::{HostId, Relay, Topology, Totals};
use trimaran_transport::Instant;
use tun_rs::SyncDevice;

use super::ip::{Header, mark_congested};

/// The carrier is woken this long before a packet's time and spins for the rest: waking a sleeping thread
/// takes about that long.
const WATCHFUL: Duration = Duration::from_micros(60);
/// How often, at least, the carrier checks whether to stop.
const GLANCE: Duration = Duration::from_millis(50);
/// Packets that are later count as this: a minute, nanoseconds.
const LATEST_NS: u64 = 60_000_000_000;
/// The largest IP packet.
const LARGEST: usize = 65_535;

/// The work of an emulation so far.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The delivery status of all packets.
    pub totals: Totals,
    /// Packets that are for none of the machines; the kernel looks for routers and neighbours.
    pub strangers: u64,
    /// How late packets came out, compared with the link models.
    pub late: Lateness,
    /// The delivery status of the packets of each direction of each link.
    pub links: Vec<LinkReport>,
}

/// How late packets came out, microseconds: until the kernel had them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Lateness {
    /// Half are at most this.
    pub p50_us: f64,
    /// 99 % are at most this.
    pub p99_us: f64,
    /// All are at most this.
    pub max_us: f64,
}

/// One direction of a link.
#[derive(Debug, Clone, Serialize)]
pub struct LinkReport {
    /// The machines that it joins.
    pub name: String,
    /// The delivery status of its packets.
    #[serde(flatten)]
    pub tally: LinkTally,
}

/// The packets between devices, shared by the carrier and by readers of its counters.
#[derive(Debug)]
pub(super) struct Cargo {
    topology: Topology,
    start: Clock,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    relay: Relay<Vec<u8>>,
    strangers: u64,
    /// Nanoseconds.
    late: Histogram<u64>,
}

/// A machine's device.
pub(super) struct Device {
    pub(super) host: HostId,
    pub(super) tun: SyncDevice,
}

impl Cargo {
    pub(super) fn new(topology: Topology, seed: u64) -> Result<Self, CreationError> {
        let relay = Relay::new(&topology, seed);
        let late = Histogram::new_with_bounds(1, LATEST_NS, 3)?;
        Ok(Self { topology, start: Clock::now(), state: Mutex::new(State { relay, strangers: 0, late }) })
    }

    pub(super) fn report(&self) -> Report {
        let state = self.state();
        let micros = |share| state.late.value_at_quantile(share) as f64 / 1e3;
        let link = |(name, tally)| LinkReport { name, tally };
        Report {
            totals: state.relay.totals(),
            strangers: state.strangers,
            late: Lateness { p50_us: micros(0.5), p99_us: micros(0.99), max_us: micros(1.0) },
            links: self.topology.link_names().zip(state.relay.links()).map(link).collect(),
        }
    }

    /// Carries packets until `stop` is set; it needs a thread of its own.
    ///
    /// # Errors
    /// When a device can no longer be read.
    pub(super) fn carry(&self, devices: &[Device], stop: &AtomicBool) -> io::Result<()> {
        // Both need privileges and are optional: without them packets come out a little later.
        let _slack = set_current_timer_slack(NonZeroU64::new(1));
        let _priority = setpriority_process(None, -20);
        let mut buffer = vec![0; LARGEST];
        while !stop.load(Ordering::Relaxed) {
            self.put_out(devices);
            for device in devices {
                self.take_in(device, &mut buffer)?;
            }
            let until = self.state().relay.next_at();
            let now = self.now();
            match until {
                Some(at) if at <= now => {}
                Some(at) => wait(devices, at.since(now).saturating_sub(WATCHFUL).min(GLANCE))?,
                None => wait(devices, GLANCE)?,
            }
        }
        Ok(())
    }

    /// Hands the arrived packets to the kernel.
    fn put_out(&self, devices: &[Device]) {
        let mut state = self.state();
        while let Some(mut arrival) = state.relay.arrival(self.now()) {
            let Some(device) = devices.iter().find(|device| device.host == arrival.to) else { continue };
            if arrival.ecn == Ecn::Experienced {
                mark_congested(&mut arrival.packet);
            }
            // A packet that the kernel does not take now is lost, as in a network card without room.
            if device.tun.send(&arrival.packet).is_ok() {
                state.late.saturating_record(
                    u64::try_from(self.now().since(arrival.at).as_nanos()).unwrap_or(u64::MAX),
                );
            }
        }
    }

    /// Takes over the packets that the kernel sends.
    fn take_in(&self, device: &Device, buffer: &mut [u8]) -> io::Result<()> {
        loop {
            let length = match device.tun.recv(buffer) {
                Ok(length) => length,
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(e),
            };
            let now = self.now();
            let packet = buffer.get(..length).unwrap_or_default();
            let mut state = self.state();
            let header = Header::of(packet);
            let to = header.and_then(|header| self.topology.at(header.to)).filter(|to| *to != device.host);
            match (header, to) {
                (Some(Header { ecn, .. }), Some(to)) => {
                    let (from, packet, ip_bytes) = (device.host, packet.to_vec(), length as u32);
                    state.relay.offer(now, Parcel { from, to, ip_bytes, ecn, token: None, packet });
                }
                _ => state.strangers += 1,
            }
        }
    }

    fn now(&self) -> Instant {
        Instant::from_nanos(0).after(self.start.elapsed())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }
}

/// Waits for packets, but not longer than `time`.
fn wait(devices: &[Device], time: Duration) -> io::Result<()> {
    if time.is_zero() {
        return Ok(());
    }
    let mut ready: Vec<_> = devices.iter().map(|device| PollFd::new(&device.tun, PollFlags::IN)).collect();
    let time = Timespec { tv_sec: 0, tv_nsec: time.subsec_nanos().into() };
    match poll(&mut ready, Some(&time)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(e) => Err(e.into()),
    }
}
