//! Hosts that are down.

use std::io;
use std::task::Waker;

use super::{Core, World};
use crate::host::HostId;

impl World {
    /// Takes a host down: its sockets are gone without a word to their peers, and its tasks end.
    pub(crate) fn crash(&self, host: HostId) {
        let waiting = self.core().crash(host);
        self.executor.end(host);
        waiting.into_iter().for_each(Waker::wake);
    }
}

impl Core {
    /// Fails while a host is down.
    pub(crate) fn check_up(&self, host: HostId) -> io::Result<()> {
        if self.fabric.is_down(host) { Err(io::ErrorKind::NetworkDown.into()) } else { Ok(()) }
    }

    /// Takes a host down. Returns the wakers of all that wait for its sockets.
    fn crash(&mut self, host: HostId) -> Vec<Waker> {
        self.fabric.take_down(host);
        self.udp_ports.retain(|(of, _), _| *of != host);
        self.tcp_ports.retain(|(of, ..), _| *of != host);
        let sockets = self.sockets.extract_if(.., |_, socket| socket.host() == host);
        let mut waiting: Vec<_> = sockets.flat_map(|(_, socket)| socket.into_wakers()).collect();
        let connections = self.tcp.extract_if(.., |_, state| state.host() == host);
        waiting.extend(connections.flat_map(|(_, state)| state.into_wakers()));
        let listeners = self.listeners.extract_if(.., |(of, _), _| *of == host);
        waiting.extend(listeners.filter_map(|(_, listener)| listener.waker));
        waiting
    }
}
