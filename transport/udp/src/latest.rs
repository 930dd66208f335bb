//! The latest lane, both ways: the newest camera, and how the lane ends.

use bytes::BytesMut;
use trimaran_proto::{Camera, Decoder, Goodbye, Message};

use crate::chunk::Chunk;
use crate::recovery::{Content, Contents};

/// In how many packets a camera rides along after its own.
const COPIES: u32 = 2;
/// The most that a camera or an end has beside its bytes.
const OVERHEAD: usize = 16;

/// How the peer's latest lane ended.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum LatestEnd {
    /// It said goodbye.
    Goodbye(Goodbye),
    /// It ended without.
    Gone,
}

/// Cameras as they are sent: only the newest counts.
#[derive(Debug, Default)]
pub(crate) struct LatestOut {
    /// The number of the newest camera, from 1, and whether it must be sent; whether it has arrived.
    newest: Option<(u64, Camera)>,
    due: bool,
    arrived: bool,
    /// In how many more packets it rides along, in case that the first one is lost.
    copies: u32,
    end: Option<End>,
}

#[derive(Debug)]
struct End {
    goodbye: BytesMut,
    due: bool,
    arrived: bool,
}

impl LatestOut {
    /// Replaces the camera before.
    pub(crate) fn publish(&mut self, camera: Camera) {
        self.newest = Some((self.number() + 1, camera));
        self.due = true;
        self.arrived = false;
        self.copies = COPIES;
    }

    /// Ends the lane behind the newest camera. The first call counts.
    pub(crate) fn end(&mut self, reason: Option<Goodbye>) {
        let mut goodbye = BytesMut::new();
        if let Some(reason) = reason {
            Message::Goodbye(reason).encode(&mut goodbye);
        }
        self.end.get_or_insert(End { goodbye, due: true, arrived: false });
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
        if let Some((number, camera)) = self.newest.filter(|_| self.due && room >= Camera::SIZE + OVERHEAD) {
            self.due = false;
            Chunk::Camera { number, camera: camera.to_bytes() }.write(out);
            contents.push(Content::Camera { number });
        }
        let number = self.number();
        if let Some(end) =
            self.end.as_mut().filter(|end| end.due && room >= end.goodbye.len() + Camera::SIZE + 2 * OVERHEAD)
        {
            end.due = false;
            Chunk::LastCamera { number, goodbye: &end.goodbye }.write(out);
            contents.push(Content::LastCamera);
        }
    }

    /// Writes a copy of the newest camera into a packet that leaves anyway, if one is wanted: who waits for
    /// it need not wait for its loss to be noticed.
    pub(crate) fn write_copy(&mut self, room: usize, out: &mut Vec<u8>, contents: &mut Contents) {
        let Some((number, camera)) = self.newest.filter(|_| self.copies > 0 && !self.due && !self.arrived)
        else {
            return;
        };
        if room >= Camera::SIZE + OVERHEAD && !contents.contains(&Content::Camera { number }) {
            self.copies -= 1;
            Chunk::Camera { number, camera: camera.to_bytes() }.write(out);
            contents.push(Content::Camera { number });
        }
    }

    pub(crate) fn on_camera_lost(&mut self, number: u64) {
        self.due |= number == self.number() && !self.arrived;
    }

    pub(crate) fn on_camera_arrived(&mut self, number: u64) {
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
        self.newest.map_or(0, |(number, _)| number)
    }
}

/// Cameras as they are received.
#[derive(Debug, Default)]
pub(crate) struct LatestIn {
    /// The newest number seen, and its camera until it is read.
    seen: u64,
    unread: Option<Camera>,
    /// How the lane ends, and behind which camera.
    end: Option<(u64, LatestEnd)>,
}

/// A goodbye that is none.
#[derive(Debug)]
pub(crate) struct NoGoodbye;

impl LatestIn {
    pub(crate) const fn put(&mut self, number: u64, camera: Camera) {
        if number > self.seen {
            self.seen = number;
            self.unread = Some(camera);
        }
    }

    pub(crate) fn put_end(&mut self, number: u64, goodbye: &[u8]) -> Result<(), NoGoodbye> {
        let end = if goodbye.is_empty() {
            LatestEnd::Gone
        } else {
            let mut decoder = Decoder::new();
            decoder.push(goodbye);
            match decoder.next_message() {
                Ok(Some(Message::Goodbye(reason))) if decoder.pending() == 0 => LatestEnd::Goodbye(reason),
                _ => return Err(NoGoodbye),
            }
        };
        self.end.get_or_insert((number, end));
        Ok(())
    }

    pub(crate) const fn take(&mut self) -> Option<Camera> {
        self.unread.take()
    }

    /// The end, once the camera before it has come.
    pub(crate) fn end(&self) -> Option<&LatestEnd> {
        self.end.as_ref().filter(|(number, _)| self.seen >= *number).map(|(_, end)| end)
    }

    /// Whether there is something that a reader has not seen.
    pub(crate) fn is_readable(&self) -> bool {
        self.unread.is_some() || self.end().is_some()
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::FrameNumber;

    use super::*;

    fn camera(frame: u32) -> Camera {
        Camera::new([1.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(frame)).unwrap()
    }

    #[test]
    fn only_the_newest_camera_is_sent_again() {
        let (mut lane, mut out, mut contents) = (LatestOut::default(), Vec::new(), Contents::new());
        lane.publish(camera(0));
        lane.write(1000, &mut out, &mut contents);
        lane.publish(camera(1));
        lane.write(1000, &mut out, &mut contents);
        assert_eq!(contents[..], [Content::Camera { number: 1 }, Content::Camera { number: 2 }]);
        lane.on_camera_lost(1);
        assert!(!lane.is_due());
        lane.on_camera_lost(2);
        assert!(lane.is_due());
        lane.on_camera_arrived(1);
        assert!(!lane.is_drained(), "the first one is not the newest");
        lane.on_camera_arrived(2);
        assert!(lane.is_drained() && !lane.is_due());
        lane.on_camera_lost(2);
        assert!(!lane.is_due(), "a copy of it has arrived");
    }

    #[test]
    fn a_camera_rides_along_twice_until_it_has_arrived() {
        let (mut lane, mut out) = (LatestOut::default(), Vec::new());
        let mut packet = |lane: &mut LatestOut| {
            let mut contents = Contents::new();
            lane.write(1000, &mut out, &mut contents);
            lane.write_copy(1000, &mut out, &mut contents);
            contents
        };
        lane.publish(camera(0));
        let carried: Vec<_> = (0..4).map(|_| packet(&mut lane).len()).collect();
        assert_eq!(carried, [1, 1, 1, 0]);
        lane.publish(camera(1));
        assert_eq!(packet(&mut lane)[..], [Content::Camera { number: 2 }]);
        lane.on_camera_arrived(2);
        assert_eq!(packet(&mut lane)[..], []);
    }

    #[test]
    fn the_end_waits_for_the_camera_before_it() {
        let (mut lane, mut goodbye) = (LatestIn::default(), BytesMut::new());
        Message::Goodbye(Goodbye::Finished).encode(&mut goodbye);
        lane.put_end(2, &goodbye).unwrap();
        lane.put(1, camera(0));
        assert_eq!((lane.take(), lane.end()), (Some(camera(0)), None));
        lane.put(2, camera(1));
        assert_eq!(
            (lane.take(), lane.end()),
            (Some(camera(1)), Some(&LatestEnd::Goodbye(Goodbye::Finished)))
        );
        assert!(lane.put_end(2, &goodbye[..3]).is_err());
        assert!(lane.put_end(2, &[0, 0, 0, 0]).is_err());
    }
}
