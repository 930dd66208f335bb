//! The latest lane, in both directions: the newest value, and the end of the lane.

use bytes::BytesMut;
use trimaran_wire::{ChannelNumber, CloseReason, Decoder, FixedBytes, Format, Message};

use crate::chunk::Chunk;
use crate::recovery::{Content, Contents};

/// How many further packets carry a copy of a value.
const COPIES: u32 = 2;
/// The most bytes of a value or an end beside its contents.
const OVERHEAD: usize = 16;

/// How the peer's latest lane ended.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum LatestEnd {
    /// It closed the link.
    Closed(CloseReason),
    /// It ended without a close.
    Gone,
}

/// Sending values: only the newest counts.
#[derive(Debug, Default)]
pub(crate) struct LatestOut {
    /// The channel, unless it is the latest lane.
    channel: Option<ChannelNumber>,
    /// The number of the newest value, from 1, and its bytes; whether it must be sent; and has arrived.
    newest: Option<(u64, FixedBytes)>,
    due: bool,
    arrived: bool,
    /// How many more packets carry a copy, in case the first one is lost.
    copies: u32,
    end: Option<End>,
}

#[derive(Debug)]
struct End {
    close: BytesMut,
    due: bool,
    arrived: bool,
}

impl LatestOut {
    /// Those of a channel.
    pub(crate) fn of(channel: ChannelNumber) -> Self {
        Self { channel: Some(channel), ..Self::default() }
    }

    /// Replaces the value before.
    pub(crate) fn publish(&mut self, value: FixedBytes) {
        self.newest = Some((self.number() + 1, value));
        self.due = true;
        self.arrived = false;
        self.copies = COPIES;
    }

    /// Ends the lane behind the newest value. The first call counts.
    pub(crate) fn end(&mut self, reason: Option<CloseReason>) {
        let mut close = BytesMut::new();
        if let Some(reason) = reason {
            Message::Close(reason).encode(&mut close);
        }
        self.end.get_or_insert(End { close, due: true, arrived: false });
    }

    pub(crate) fn is_due(&self) -> bool {
        self.due || self.end.as_ref().is_some_and(|end| end.due)
    }

    /// Whether everything has arrived.
    pub(crate) fn is_drained(&self) -> bool {
        (self.newest.is_none() || self.arrived) && self.end.as_ref().is_none_or(|end| end.arrived)
    }

    /// Writes what is due.
    pub(crate) fn write(&mut self, room: usize, out: &mut Vec<u8>, contents: &mut Contents) {
        let before = out.len();
        let size = self.newest.as_ref().map_or(0, |(_, value)| value.len());
        if self.due && room >= size + OVERHEAD && self.write_newest(out, contents) {
            self.due = false;
        }
        let (channel, number) = (self.channel, self.number());
        let room = room.saturating_sub(out.len() - before);
        if let Some(end) = self.end.as_mut().filter(|end| end.due && room >= end.close.len() + OVERHEAD) {
            end.due = false;
            Chunk::LastLatest { channel, number, close: &end.close }.write(out);
            contents.push(Content::LastLatest { channel });
        }
    }

    /// Writes a copy of the newest value into a packet that leaves anyway, if one is wanted: a reader need
    /// not wait until its loss is noticed.
    pub(crate) fn write_copy(&mut self, room: usize, out: &mut Vec<u8>, contents: &mut Contents) {
        let Some((number, value)) = &self.newest else { return };
        let wanted = self.copies > 0 && !self.due && !self.arrived;
        let channel = self.channel;
        let fits = room >= value.len() + OVERHEAD;
        if wanted && fits && !contents.contains(&Content::Latest { channel, number: *number }) {
            self.copies -= 1;
            self.write_newest(out, contents);
        }
    }

    fn write_newest(&self, out: &mut Vec<u8>, contents: &mut Contents) -> bool {
        let Some((number, value)) = &self.newest else { return false };
        let channel = self.channel;
        Chunk::Latest { channel, number: *number, value }.write(out);
        contents.push(Content::Latest { channel, number: *number });
        true
    }

    pub(crate) fn on_value_lost(&mut self, number: u64) {
        self.due |= number == self.number() && !self.arrived;
    }

    pub(crate) fn on_value_arrived(&mut self, number: u64) {
        if number == self.number() {
            self.arrived = true;
            self.due = false;
        }
    }

    pub(crate) fn on_end_lost(&mut self) {
        if let Some(end) = &mut self.end {
            end.due = !end.arrived;
        }
    }

    pub(crate) fn on_end_arrived(&mut self) {
        if let Some(end) = &mut self.end {
            end.arrived = true;
            end.due = false;
        }
    }

    fn number(&self) -> u64 {
        self.newest.as_ref().map_or(0, |(number, _)| *number)
    }
}

/// Receiving values.
#[derive(Debug)]
pub(crate) struct LatestIn {
    format: Format,
    /// The newest number seen, and its value until it is read.
    seen: u64,
    unread: Option<FixedBytes>,
    /// The end of the lane, and the last value before it.
    end: Option<(u64, LatestEnd)>,
}

/// An invalid close.
#[derive(Debug)]
pub(crate) struct NoCloseReason;

impl LatestIn {
    pub(crate) const fn new(format: Format) -> Self {
        Self { format, seen: 0, unread: None, end: None }
    }

    pub(crate) fn put(&mut self, number: u64, value: &[u8]) {
        if number > self.seen {
            self.seen = number;
            self.unread = Some(value.into());
        }
    }

    pub(crate) fn put_end(&mut self, number: u64, close: &[u8]) -> Result<(), NoCloseReason> {
        let end = if close.is_empty() {
            LatestEnd::Gone
        } else {
            let mut decoder = Decoder::new(self.format);
            decoder.push(close);
            match decoder.next_message() {
                Ok(Some(Message::Close(reason))) if decoder.pending() == 0 => LatestEnd::Closed(reason),
                _ => return Err(NoCloseReason),
            }
        };
        self.end.get_or_insert((number, end));
        Ok(())
    }

    pub(crate) fn take(&mut self) -> Option<FixedBytes> {
        self.unread.take()
    }

    /// The end, once the last value has come.
    pub(crate) fn end(&self) -> Option<&LatestEnd> {
        self.end.as_ref().filter(|(number, _)| self.seen >= *number).map(|(_, end)| end)
    }

    /// Whether there is anything unread.
    pub(crate) fn is_readable(&self) -> bool {
        self.unread.is_some() || self.end().is_some()
    }
}

#[cfg(test)]
mod tests {
    use trimaran_wire::MAX_FIXED;

    use super::*;
    use crate::samples::{FORMAT, encoded, value};

    #[test]
    fn only_the_newest_value_is_sent_again() {
        let (mut lane, mut out, mut contents) = (LatestOut::default(), Vec::new(), Contents::new());
        lane.publish(value(0));
        lane.write(1000, &mut out, &mut contents);
        lane.publish(value(1));
        lane.write(1000, &mut out, &mut contents);
        assert_eq!(
            contents[..],
            [Content::Latest { channel: None, number: 1 }, Content::Latest { channel: None, number: 2 }]
        );
        lane.on_value_lost(1);
        assert!(!lane.is_due());
        lane.on_value_lost(2);
        assert!(lane.is_due());
        lane.on_value_arrived(1);
        assert!(!lane.is_drained(), "the first one is not the newest");
        lane.on_value_arrived(2);
        assert!(lane.is_drained() && !lane.is_due());
        lane.on_value_lost(2);
        assert!(!lane.is_due(), "a copy of it has arrived");
    }

    #[test]
    fn a_value_rides_along_twice_until_it_has_arrived() {
        let (mut lane, mut out) = (LatestOut::default(), Vec::new());
        let mut packet = |lane: &mut LatestOut| {
            let mut contents = Contents::new();
            lane.write(1000, &mut out, &mut contents);
            lane.write_copy(1000, &mut out, &mut contents);
            contents
        };
        lane.publish(value(0));
        let carried: Vec<_> = (0..4).map(|_| packet(&mut lane).len()).collect();
        assert_eq!(carried, [1, 1, 1, 0]);
        lane.publish(value(1));
        assert_eq!(packet(&mut lane)[..], [Content::Latest { channel: None, number: 2 }]);
        lane.on_value_arrived(2);
        assert_eq!(packet(&mut lane)[..], []);
    }

    #[test]
    fn the_end_waits_for_the_value_before_it() {
        let (mut lane, reason) = (LatestIn::new(FORMAT), CloseReason::new(0, "over"));
        let close = encoded(&Message::Close(reason.clone()));
        lane.put_end(2, &close).unwrap();
        assert!(!lane.is_readable());
        lane.put(1, &value(0));
        assert!(lane.is_readable());
        assert_eq!((lane.take(), lane.end()), (Some(value(0)), None));
        lane.put(1, &value(0));
        assert_eq!((lane.is_readable(), lane.take()), (false, None), "a copy of what was read");
        lane.put(2, &value(1));
        assert_eq!((lane.take(), lane.end()), (Some(value(1)), Some(&LatestEnd::Closed(reason))));
        assert!(lane.is_readable(), "the end is");
        for no_close in [&close[..3], &[0, 0, 0, 0], &[&close[..], &[0]].concat()] {
            assert!(lane.put_end(2, no_close).is_err(), "{no_close:?}");
        }
    }

    #[test]
    fn a_value_and_the_end_of_a_channel_leave_where_there_is_room_for_them() {
        let channel = Some(ChannelNumber(1));
        let (latest, last) = (Content::Latest { channel, number: 1 }, Content::LastLatest { channel });
        // The value takes 76 bytes, and would not start in less than 88.
        for (room, expected) in [
            (15, &[][..]),
            (16, std::slice::from_ref(&last)),
            (87, std::slice::from_ref(&last)),
            (88, std::slice::from_ref(&latest)),
            (91, std::slice::from_ref(&latest)),
            (92, &[latest.clone(), last.clone()]),
        ] {
            let (mut lane, mut contents) = (LatestOut::of(ChannelNumber(1)), Contents::new());
            lane.publish(value(0));
            lane.end(None);
            lane.write(room, &mut vec![0; 500], &mut contents);
            assert_eq!(&contents[..], expected, "{room} bytes");
        }
    }

    #[test]
    fn the_end_is_said_again_until_it_has_arrived() {
        let mut lane = LatestOut::default();
        lane.end(None);
        lane.write(1000, &mut Vec::new(), &mut Contents::new());
        assert!(!lane.is_due());
        lane.on_end_lost();
        assert!(lane.is_due() && !lane.is_drained());
        lane.on_end_arrived();
        assert!(!lane.is_due() && lane.is_drained());
        lane.on_end_lost();
        assert!(!lane.is_due(), "another copy of it has arrived");
    }

    #[test]
    fn the_largest_value_and_the_longest_close_leave_one_after_the_other() {
        let (mut lane, mut packets) = (LatestOut::default(), Vec::new());
        lane.publish(FixedBytes::from_elem(7, MAX_FIXED));
        lane.end(Some(CloseReason::new(1, &"x".repeat(200))));
        for _ in 0..3 {
            let (mut out, mut contents) = (Vec::new(), Contents::new());
            lane.write(1172, &mut out, &mut contents);
            assert!(out.len() <= 1172, "{} bytes", out.len());
            packets.extend(contents);
        }
        assert_eq!(
            packets,
            [Content::Latest { channel: None, number: 1 }, Content::LastLatest { channel: None }]
        );
    }
}
