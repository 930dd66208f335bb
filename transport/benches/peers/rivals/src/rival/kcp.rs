//! KCP, a protocol of games that trades bytes for time, by the crate `kcp`.
//!
//! Its fastest settings: no congestion control, fast retransmission after two later acknowledgements, the
//! shortest interval, a flush after each frame and each datagram. It has no handshake, and encrypts nothing.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use kcp::Kcp;
use parking_lot::Mutex;

use super::{Rival, RunFuture, driver};
use crate::meter::{Ends, FRAME_BYTES};

const CONVERSATION: u32 = 7;
/// The largest datagram over Ethernet.
const DATAGRAM: usize = 1472;
const WINDOW: u16 = 1024;
/// The least timeout for retransmissions, milliseconds; its default is 30.
const LEAST_TIMEOUT: u32 = 15;

/// The rival.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KcpRival;

impl Rival for KcpRival {
    fn name(&self) -> &'static str {
        "KCP"
    }

    fn run(&self, ends: Ends) -> RunFuture {
        driver::run(ends, |_| Ok([Machine::new()?, Machine::new()?]))
    }
}

/// Datagrams to send.
#[derive(Debug, Clone, Default)]
struct Output(Arc<Mutex<Vec<Vec<u8>>>>);

impl Write for Output {
    fn write(&mut self, datagram: &[u8]) -> io::Result<usize> {
        self.0.lock().push(datagram.to_vec());
        Ok(datagram.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

struct Machine {
    kcp: Kcp<Output>,
    output: Output,
    /// Something was sent or has come: it need not wait for the next interval.
    is_fresh: bool,
}

impl Machine {
    fn new() -> anyhow::Result<Self> {
        let output = Output::default();
        let mut kcp = Kcp::new(CONVERSATION, output.clone());
        kcp.set_nodelay(true, 10, 2, true);
        kcp.set_rx_minrto(LEAST_TIMEOUT);
        kcp.set_wndsize(WINDOW, WINDOW);
        kcp.set_mtu(DATAGRAM)?;
        kcp.set_maximum_resend_times(u32::MAX);
        Ok(Self { kcp, output, is_fresh: false })
    }
}

impl driver::Machine for Machine {
    fn send(&mut self, _now: Duration, frame: Vec<u8>) {
        // Refused only where it has too many fragments, which a frame has not.
        let _sent = self.kcp.send(&frame);
        self.is_fresh = true;
    }

    fn input(&mut self, now: Duration, datagram: &[u8]) {
        // The time of acknowledgements is that of the last update.
        let _updated = self.kcp.update(now.as_millis() as u32);
        let _taken = self.kcp.input(datagram);
        self.is_fresh = true;
    }

    fn advance(&mut self, now: Duration, out: &mut Vec<Vec<u8>>, frames: &mut Vec<Vec<u8>>) {
        let _updated = self.kcp.update(now.as_millis() as u32);
        if std::mem::take(&mut self.is_fresh) {
            let _flushed = self.kcp.flush();
        }
        out.append(&mut self.output.0.lock());
        let mut room = vec![0; FRAME_BYTES + 4];
        while let Ok(length) = self.kcp.recv(&mut room) {
            frames.push(room.get(..length).unwrap_or_default().to_vec());
        }
    }

    fn wake(&self, now: Duration) -> Duration {
        let wait = self.kcp.check(now.as_millis() as u32).max(1);
        // The next whole millisecond, which is its unit.
        Duration::from_millis(now.as_millis() as u64 + u64::from(wait))
    }
}
