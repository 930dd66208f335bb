//! A connection: its beginning, its two halves, its end.

use std::io;
use std::time::Duration;

use trimaran_net::{Instant, TcpOptions};

use super::receiver::Receiver;
use super::segment::{Segment, full_size};
use super::sender::Sender;

mod timers;
mod transmit;

/// How long the first segment waits for its answer; doubled each time (RFC 6298).
const FIRST_WAIT: Duration = Duration::from_secs(1);

/// The configuration of a connection.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Config {
    pub(crate) options: TcpOptions,
    /// The path MTU, and the bytes of the IP header.
    pub(crate) mtu: u32,
    pub(crate) ip_header: u32,
}

/// One end of a connection.
#[derive(Debug)]
pub(crate) struct Socket {
    config: Config,
    state: State,
    sender: Sender,
    receiver: Receiver,
    /// The newest timestamp of the peer, to be echoed.
    echo: u64,
    last_heard: Instant,
    /// The program is gone: arriving data has no reader.
    orphan: bool,
    reset: Reset,
    probes: u32,
    probe: bool,
    failure: Option<io::ErrorKind>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// The first segment or the answer to it was sent: when, how often, and whether to send it now.
    Opening {
        answering: bool,
        due: Instant,
        tries: u32,
        send: bool,
        first: Instant,
    },
    Open,
    Closed,
}

/// Whether the peer is told that the connection is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reset {
    No,
    Due,
    Done,
}

impl Socket {
    /// An end that connects.
    pub(crate) fn connect(now: Instant, config: Config) -> Self {
        Self::new(now, config, false)
    }

    /// The end that answers a first segment.
    pub(crate) fn accept(now: Instant, config: Config, syn: &Segment) -> Self {
        let mut socket = Self::new(now, config, true);
        socket.receiver = socket.fresh_receiver(syn.end());
        socket.sender.set_window(0, syn.window);
        socket.echo = syn.timestamp;
        socket
    }

    fn new(now: Instant, config: Config, answering: bool) -> Self {
        let Config { options, mtu, ip_header } = config;
        let segment = full_size(mtu, ip_header);
        Self {
            config,
            state: State::Opening { answering, due: now.after(FIRST_WAIT), tries: 0, send: true, first: now },
            sender: Sender::new(1, segment, options.send_buffer, options.nodelay),
            receiver: Receiver::new(1, segment, options.recv_buffer),
            echo: 0,
            last_heard: now,
            orphan: false,
            reset: Reset::No,
            probes: 0,
            probe: false,
            failure: None,
        }
    }

    fn fresh_receiver(&self, next: u64) -> Receiver {
        let Config { options, mtu, ip_header } = self.config;
        Receiver::new(next, full_size(mtu, ip_header), options.recv_buffer)
    }

    /// Whether the connection is open.
    pub(crate) const fn is_open(&self) -> bool {
        matches!(self.state, State::Open)
    }

    /// Why it failed.
    pub(crate) const fn failure(&self) -> Option<io::ErrorKind> {
        self.failure
    }

    /// Whether nothing more will happen to it.
    pub(crate) fn is_over(&self) -> bool {
        match self.state {
            State::Closed => self.reset != Reset::Due,
            State::Open => {
                self.orphan && self.sender.has_ended() && self.receiver.has_ended() && !self.receiver.ack_now
            }
            State::Opening { .. } => false,
        }
    }

    /// Whether the program has left it.
    pub(crate) const fn is_abandoned(&self) -> bool {
        self.orphan
    }

    pub(crate) fn is_readable(&self) -> bool {
        self.failure.is_some() || self.receiver.is_readable()
    }

    /// How many bytes wait to be read.
    pub(crate) const fn unread(&self) -> usize {
        self.receiver.unread() as usize
    }

    pub(crate) fn is_writable(&self) -> bool {
        self.failure.is_some() || self.sender.has_much_room()
    }

    /// Reads; 0 bytes are the end of the stream.
    pub(crate) fn read(&mut self, now: Instant, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.receiver.read(now, buffer, self.sender.rtt.smoothed());
        match self.failure {
            Some(kind) if count == 0 && !self.receiver.has_ended() => Err(kind.into()),
            _ => Ok(count),
        }
    }

    /// Writes as much as there is room for.
    pub(crate) fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        if let Some(kind) = self.failure {
            // Writing to a connection that the peer reset is a broken pipe.
            let kind = if kind == io::ErrorKind::ConnectionReset { io::ErrorKind::BrokenPipe } else { kind };
            return Err(kind.into());
        }
        let count = data.len().min(self.sender.room());
        self.sender.write(data.get(..count).unwrap_or_default());
        Ok(count)
    }

    /// Whether small segments go at once.
    pub(crate) const fn set_nodelay(&mut self, nodelay: bool) {
        self.sender.nodelay = nodelay;
    }

    /// The program writes nothing more.
    pub(crate) const fn shutdown(&mut self) {
        self.sender.close();
    }

    /// The program is gone. Unread data is refused with a reset.
    pub(crate) fn close(&mut self) {
        self.orphan = true;
        if self.receiver.unread() > 0 {
            self.abort();
        } else {
            self.sender.close();
        }
    }

    fn abort(&mut self) {
        self.state = State::Closed;
        self.reset = Reset::Due;
    }

    fn fail(&mut self, kind: io::ErrorKind) {
        self.state = State::Closed;
        self.failure.get_or_insert(kind);
    }

    /// A segment came.
    pub(crate) fn receive(&mut self, now: Instant, segment: &Segment) {
        if segment.rst {
            let refused = matches!(self.state, State::Opening { .. });
            self.reset = Reset::Done;
            self.fail(if refused {
                io::ErrorKind::ConnectionRefused
            } else {
                io::ErrorKind::ConnectionReset
            });
            return;
        }
        self.last_heard = now;
        self.probes = 0;
        match self.state {
            State::Closed => return,
            State::Opening { answering, first, tries, .. } => {
                let answered = segment.ack == Some(1);
                if answering && segment.syn {
                    return; // the answer is lost; it is repeated in time
                }
                if !answered {
                    return;
                }
                if tries <= 1 {
                    self.sender.rtt.measure(now, now.since(first), 1, 1);
                }
                self.state = State::Open;
                if segment.syn {
                    self.receiver = self.fresh_receiver(segment.end());
                    self.receiver.ack_now = true;
                }
            }
            State::Open if segment.syn => {
                self.receiver.ack_now = true; // our acknowledgement of the peer's answer was lost
                return;
            }
            State::Open => {}
        }
        if segment.seq <= self.receiver.next {
            self.echo = self.echo.max(segment.timestamp);
        }
        if let Some(ack) = segment.ack {
            self.sender.set_window(ack, segment.window);
            self.sender.acknowledge(now, segment, ack);
        }
        if segment.syn {
            return;
        }
        if self.orphan && segment.data.len() as u64 > 0 && segment.end() > self.receiver.next {
            self.abort();
            return;
        }
        if segment.length() > 0 || segment.seq < self.receiver.next {
            let (rto, smoothed) = (self.sender.rtt.timeout(), self.sender.rtt.smoothed());
            self.receiver.receive(now, segment, rto, smoothed);
        }
    }

    /// So many bytes of this connection have left the host. Returns whether data waited for that.
    pub(crate) const fn left(&mut self, bytes: u64) -> bool {
        self.sender.left(bytes)
    }
}
