//! Batches as changes: an application's coding for these tests.
//!
//! A coded batch is a sequence of words of 32 bits, first the number of its reference frame. The rest are
//! items, or, with the highest bit set, runs of that frame: 15 bits for a run's start, 16 bits for its
//! length.

use std::collections::BTreeMap;

use bytes::Bytes;
use trimaran_wire::FrameNumber;

const RUN: u32 = 1 << 31;

/// The number of items in a coded batch.
pub(crate) fn count(bytes: &[u8]) -> Option<usize> {
    let (_, changes) = bytes.split_first_chunk::<4>()?;
    let one = |word| if word & RUN == 0 { 1 } else { (word & 0xffff) as usize };
    bytes.len().is_multiple_of(4).then(|| words(changes).map(one).sum())
}

fn words(bytes: &[u8]) -> impl Iterator<Item = u32> {
    bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap()))
}

/// The reference frames of changes.
#[derive(Default)]
pub(crate) struct Changes(BTreeMap<FrameNumber, Vec<u32>>);

impl Changes {
    pub(crate) fn remember(&mut self, frame: FrameNumber, items: &[u32]) {
        self.0.insert(frame, items.to_vec());
    }

    pub(crate) fn newest(&self) -> Option<FrameNumber> {
        self.0.keys().next_back().copied()
    }

    /// The items as changes against a frame of rising items, if that is shorter.
    pub(crate) fn encode(&self, reference: Option<FrameNumber>, plain: &[u8]) -> Option<Bytes> {
        let frame = reference?;
        let (before, mut changes) = (self.0.get(&frame)?, vec![frame.0]);
        for item in words(plain) {
            let at = before.binary_search(&item).ok().filter(|at| *at < 1 << 15);
            let run = at.map(|at| RUN | (at as u32) << 16 | 1);
            match (changes.last_mut(), run) {
                // The place behind the current run.
                (Some(last), Some(run)) if *last & RUN != 0 && run_of(*last).1 == run_of(run).0 => *last += 1,
                (_, run) => changes.push(run.or((item & RUN == 0).then_some(item))?),
            }
        }
        (changes.len() * 4 < plain.len()).then(|| changes.into_iter().flat_map(u32::to_le_bytes).collect())
    }

    /// The items of a coded batch.
    pub(crate) fn decode(&self, bytes: &[u8]) -> Bytes {
        let mut words = words(bytes);
        let before = &self.0[&FrameNumber(words.next().unwrap())];
        let mut items = Vec::new();
        for word in words {
            match run_of(word) {
                _ if word & RUN == 0 => items.push(word),
                (from, to) => items.extend_from_slice(&before[from..to]),
            }
        }
        items.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

/// The start and the end of the run `word`.
const fn run_of(word: u32) -> (usize, usize) {
    let from = (word >> 16 & 0x7fff) as usize;
    (from, from + (word & 0xffff) as usize)
}
