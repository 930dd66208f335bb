//! ENet, a protocol of games, by the crate `rusty_enet`.
//!
//! Frames are reliable packets on one channel, cut into fragments. It encrypts nothing, and has no fast
//! retransmission: lost fragments wait for a timer.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::time::Duration;

use rusty_enet::{Event, Host, HostSettings, MTU_MAX, Packet, PacketReceived, PeerID, Socket};

use super::{Rival, RunFuture, driver};
use crate::meter::Ends;

/// The largest datagram over Ethernet.
const DATAGRAM: u16 = 1472;
/// How often it looks at its timers.
const STEP: Duration = Duration::from_millis(1);

/// The rival.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EnetRival;

impl Rival for EnetRival {
    fn name(&self) -> &'static str {
        "ENet"
    }

    fn run(&self, ends: Ends) -> RunFuture {
        driver::run(ends, |[sender, receiver]| {
            Ok([Machine::new(receiver, false)?, Machine::new(sender, true)?])
        })
    }
}

/// Datagrams that have come, and those to send.
#[derive(Debug, Clone)]
struct Queues {
    peer: SocketAddr,
    came: Rc<RefCell<VecDeque<Vec<u8>>>>,
    out: Rc<RefCell<Vec<Vec<u8>>>>,
}

impl Socket for Queues {
    type Address = SocketAddr;
    type Error = io::Error;

    fn send(&mut self, _to: SocketAddr, datagram: &[u8]) -> io::Result<usize> {
        self.out.borrow_mut().push(datagram.to_vec());
        Ok(datagram.len())
    }

    fn receive(&mut self, room: &mut [u8; MTU_MAX]) -> io::Result<Option<(SocketAddr, PacketReceived)>> {
        let Some(datagram) = self.came.borrow_mut().pop_front() else { return Ok(None) };
        let Some(room) = room.get_mut(..datagram.len()) else {
            return Ok(Some((self.peer, PacketReceived::Partial)));
        };
        room.copy_from_slice(&datagram);
        Ok(Some((self.peer, PacketReceived::Complete(datagram.len()))))
    }
}

struct Machine {
    host: Host<Queues>,
    queues: Queues,
    now: Rc<Cell<Duration>>,
    peer: Option<PeerID>,
}

impl Machine {
    fn new(peer: SocketAddr, connects: bool) -> anyhow::Result<Self> {
        let queues = Queues { peer, came: Rc::default(), out: Rc::default() };
        let now = Rc::new(Cell::new(Duration::from_secs(1)));
        let clock = Rc::clone(&now);
        let settings = HostSettings {
            peer_limit: 1,
            channel_limit: 1,
            time: Box::new(move || clock.get()),
            seed: Some(7),
            ..HostSettings::default()
        };
        let mut host = Host::new(queues.clone(), settings).map_err(|e| anyhow::anyhow!("ENet: {e:?}"))?;
        host.set_mtu(DATAGRAM).map_err(|e| anyhow::anyhow!("ENet's MTU: {e:?}"))?;
        if connects {
            host.connect(peer, 1, 0).map_err(|e| anyhow::anyhow!("ENet: {e:?}"))?;
        }
        Ok(Self { host, queues, now, peer: None })
    }
}

impl driver::Machine for Machine {
    fn send(&mut self, _now: Duration, frame: Vec<u8>) {
        if let Some(peer) = self.peer {
            // Refused only where the peer is gone: then the frame counts as late.
            let _sent = self.host.peer_mut(peer).send(0, &Packet::reliable(frame.as_slice()));
        }
    }

    fn input(&mut self, _now: Duration, datagram: &[u8]) {
        self.queues.came.borrow_mut().push_back(datagram.to_vec());
    }

    fn advance(&mut self, now: Duration, out: &mut Vec<Vec<u8>>, frames: &mut Vec<Vec<u8>>) {
        self.now.set(now + Duration::from_secs(1));
        while let Ok(Some(event)) = self.host.service() {
            match event {
                Event::Connect { peer, .. } => {
                    let _fits = peer.set_mtu(DATAGRAM);
                    self.peer = Some(peer.id());
                }
                Event::Disconnect { .. } => self.peer = None,
                Event::Receive { packet, .. } => frames.push(packet.data().to_vec()),
            }
        }
        self.host.flush();
        out.append(&mut self.queues.out.borrow_mut());
    }

    fn wake(&self, now: Duration) -> Duration {
        now + STEP
    }

    fn is_connected(&self) -> bool {
        self.peer.is_some()
    }
}
