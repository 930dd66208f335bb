//! The coded form of batches of [`Robot`](super::Robot): runs of equal differences to a prediction.
//!
//! The prediction is the item at the same place of an earlier frame, or else the number before.

use std::collections::VecDeque;

use bytes::{BufMut, Bytes, BytesMut};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_wire::{
    Batch, BatchDecoder, BatchEncoder, BatchError, BatchSize, CodingError, Delivery, FrameEnd, FrameNumber,
};

/// How many frames either side remembers: the sender refers only to frames that the receiver still has.
const KEPT: usize = 8;

/// A batch in coded form.
#[derive(Debug, Serialize, Deserialize)]
struct Coded {
    /// How many numbers back the frame is that it refers to.
    back: Option<u32>,
    /// The place in its own frame where it begins.
    at: u32,
    /// Wrapping differences, and the length of each run.
    runs: Vec<(i32, u32)>,
}

/// Why a coded batch is invalid.
#[derive(Debug, Error)]
enum Fault {
    #[error("it is malformed")]
    Malformed(#[from] postcard::Error),
    #[error("it refers to the frame {0} numbers back, which is not known")]
    Unknown(u32),
    #[error("the frame has more than {0} points")]
    TooMany(u32),
    #[error(transparent)]
    Batch(#[from] BatchError),
}

/// The number of points in a coded batch.
pub(super) fn count(bytes: &[u8]) -> Option<usize> {
    postcard::from_bytes::<Coded>(bytes).ok().map(|coded| coded.count() as usize)
}

impl Coded {
    fn count(&self) -> u64 {
        self.runs.iter().map(|(_, count)| u64::from(*count)).sum()
    }
}

/// Past frames, and the open one.
#[derive(Debug, Default)]
struct Frames {
    kept: VecDeque<(FrameNumber, Vec<u32>)>,
    open: Vec<u32>,
}

impl Frames {
    fn get(&self, number: FrameNumber) -> Option<&[u32]> {
        self.kept.iter().find(|(kept, _)| *kept == number).map(|(_, points)| points.as_slice())
    }

    /// Keeps the open frame if it is complete, in place of the oldest.
    fn end(&mut self, end: &FrameEnd) {
        if self.open.len() == end.items as usize {
            let oldest = if self.kept.len() == KEPT { self.kept.pop_back() } else { None };
            let next = oldest.map(|(_, points)| points).unwrap_or_default();
            self.kept.push_front((end.frame, std::mem::replace(&mut self.open, next)));
        }
    }
}

#[derive(Debug)]
pub(super) struct Encoder {
    delivery: Delivery,
    frame: FrameNumber,
    frames: Frames,
    /// The newest frame that the receiver is known to have.
    reference: Option<FrameNumber>,
}

impl Encoder {
    pub(super) fn new(delivery: Delivery) -> Self {
        Self { delivery, frame: FrameNumber(0), frames: Frames::default(), reference: None }
    }
}

impl BatchEncoder<u32> for Encoder {
    fn begin(&mut self, frame: FrameNumber) {
        self.frame = frame;
        self.frames.open.clear();
    }

    fn encode(&mut self, batch: &Batch<u32>) -> Option<Bytes> {
        let at = self.frames.open.len();
        let known = self.reference.filter(|number| self.frames.get(*number).is_some());
        let back = known.and_then(|number| self.frame.0.checked_sub(number.0));
        let earlier = known.filter(|_| back.is_some()).and_then(|number| self.frames.get(number));
        let (mut runs, mut last) = (Vec::<(i32, u32)>::new(), 0);
        for (place, point) in (at..).zip(batch.iter()) {
            let expected = earlier.and_then(|points| points.get(place)).copied().unwrap_or(last);
            let difference = point.wrapping_sub(expected) as i32;
            match runs.last_mut() {
                Some((same, count)) if *same == difference => *count += 1,
                _ => runs.push((difference, 1)),
            }
            last = point;
        }
        self.frames.open.extend(batch.iter());
        let coded = Coded { back, at: at.try_into().ok()?, runs };
        let bytes = postcard::to_stdvec(&coded).ok()?;
        (bytes.len() < batch.as_bytes().len()).then(|| bytes.into())
    }

    fn end(&mut self, end: &FrameEnd) {
        self.frames.end(end);
        if self.delivery == Delivery::Ordered {
            self.reference = Some(end.frame);
        }
    }

    fn confirmed(&mut self, frame: FrameNumber) {
        self.reference = Some(frame);
    }
}

#[derive(Debug)]
pub(super) struct Decoder {
    max_items: u32,
    frame: FrameNumber,
    frames: Frames,
}

impl Decoder {
    pub(super) fn new(max_items: u32) -> Self {
        Self { max_items, frame: FrameNumber(0), frames: Frames::default() }
    }

    fn read(&mut self, bytes: &[u8]) -> Result<Batch<u32>, Fault> {
        let coded: Coded = postcard::from_bytes(bytes)?;
        let count = coded.count();
        if count + self.frames.open.len() as u64 > self.max_items.into() {
            return Err(Fault::TooMany(self.max_items));
        }
        if count > BatchSize::MAX.items() as u64 {
            return Err(BatchError { bytes: count as usize * 4, item: 4 }.into());
        }
        let earlier = match coded.back {
            Some(back) => {
                let number = self.frame.0.checked_sub(back).map(FrameNumber);
                number.and_then(|number| self.frames.get(number)).ok_or(Fault::Unknown(back))?
            }
            None => &[],
        };
        let differences = coded.runs.iter().flat_map(|(difference, count)| (0..*count).map(|_| *difference));
        let (mut plain, mut last) = (BytesMut::with_capacity(count as usize * 4), 0);
        for (place, difference) in (coded.at as usize..).zip(differences) {
            let expected = earlier.get(place).copied().unwrap_or(last);
            last = expected.wrapping_add_signed(difference);
            plain.put_u32_le(last);
        }
        let batch = Batch::new(plain.freeze())?;
        self.frames.open.extend(batch.iter());
        Ok(batch)
    }
}

impl BatchDecoder<u32> for Decoder {
    fn begin(&mut self, frame: FrameNumber) {
        self.frame = frame;
        self.frames.open.clear();
    }

    fn plain(&mut self, batch: &Batch<u32>) {
        // The link itself checks the limit of a frame.
        let room = (self.max_items as usize).saturating_sub(self.frames.open.len());
        self.frames.open.extend(batch.iter().take(room));
    }

    fn decode(&mut self, bytes: &[u8]) -> Result<Batch<u32>, CodingError> {
        self.read(bytes).map_err(|fault| CodingError(Box::new(fault)))
    }

    fn end(&mut self, end: &FrameEnd) {
        self.frames.end(end);
    }
}
