//! The segments that a connection sends.

use trimaran_net::Instant;

use super::super::segment::{Class, Segment};
use super::super::sender::Outgoing;
use super::{Reset, Socket, State};

impl Socket {
    /// The next segment to be sent.
    pub(crate) fn transmit(&mut self, now: Instant) -> Option<Segment> {
        let timestamp = now.as_nanos() / 1_000_000;
        match &mut self.state {
            State::Closed => {
                if self.reset != Reset::Due {
                    return None;
                }
                self.reset = Reset::Done;
                let (seq, echo, class) = (self.sender.next, self.echo, Class::Handshake);
                Some(Segment { seq, rst: true, timestamp, echo, class, ..Segment::default() })
            }
            State::Opening { answering, send, tries, .. } => {
                if !std::mem::take(send) {
                    return None;
                }
                *tries += 1;
                let (echo, class) = (self.echo, Class::Handshake);
                let mut segment = Segment { syn: true, timestamp, echo, class, ..Segment::default() };
                self.receiver.acknowledge(&mut segment);
                segment.ack = segment.ack.filter(|_| *answering);
                Some(segment)
            }
            State::Open => {
                let Outgoing { seq, data, fin, class } = self.next_outgoing(now)?;
                let mut segment =
                    Segment { seq, data, fin, class, timestamp, echo: self.echo, ..Segment::default() };
                self.receiver.acknowledge(&mut segment);
                if !segment.data.is_empty() || segment.fin {
                    self.sender.entered(self.ip_bytes(&segment));
                }
                Some(segment)
            }
        }
    }

    /// The next segment of an open connection.
    fn next_outgoing(&mut self, now: Instant) -> Option<Outgoing> {
        if let Some(out) = self.sender.transmit(now) {
            if !out.data.is_empty() {
                self.receiver.acks.answered(now);
            }
            return Some(out);
        }
        if std::mem::take(&mut self.probe) {
            return Some(Outgoing::empty(self.sender.acknowledged - 1, Class::Probe));
        }
        self.receiver.ack_now.then(|| Outgoing::empty(self.sender.next, Class::Acknowledgement))
    }

    fn ip_bytes(&self, segment: &Segment) -> u64 {
        u64::from(self.config.ip_header + segment.header()) + segment.data.len() as u64
    }
}
