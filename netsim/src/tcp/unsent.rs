//! Data written by a program and not sent yet.

use std::collections::VecDeque;

use bytes::{Bytes, BytesMut};

/// Bytes in order, in the pieces in which they were written. Taking bytes copies them only if they span
/// several pieces.
#[derive(Debug, Default)]
pub(super) struct Unsent {
    /// No piece is empty.
    pieces: VecDeque<Bytes>,
    bytes: usize,
}

impl Unsent {
    pub(super) const fn len(&self) -> usize {
        self.bytes
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.bytes == 0
    }

    pub(super) fn write(&mut self, data: &[u8]) {
        if !data.is_empty() {
            self.bytes += data.len();
            self.pieces.push_back(Bytes::copy_from_slice(data));
        }
    }

    /// Takes the first `count` bytes, or all if there are fewer.
    pub(super) fn take(&mut self, count: usize) -> Bytes {
        let count = count.min(self.bytes);
        self.bytes -= count;
        match self.pieces.front_mut() {
            Some(first) if first.len() > count => first.split_to(count),
            Some(first) if first.len() == count => self.pieces.pop_front().unwrap_or_default(),
            _ => self.gather(count),
        }
    }

    fn gather(&mut self, count: usize) -> Bytes {
        let mut gathered = BytesMut::with_capacity(count);
        while gathered.len() < count
            && let Some(first) = self.pieces.front_mut()
        {
            let part = first.split_to(first.len().min(count - gathered.len()));
            gathered.extend_from_slice(&part);
            if first.is_empty() {
                self.pieces.pop_front();
            }
        }
        gathered.freeze()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_taken_is_what_was_written_whatever_the_pieces(
            steps in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..20), 0_usize..30), 0..50),
        ) {
            let (mut unsent, mut written, mut taken) = (Unsent::default(), Vec::new(), Vec::new());
            for (data, count) in steps {
                unsent.write(&data);
                written.extend(data);
                let left = written.len() - taken.len();
                prop_assert_eq!((unsent.len(), unsent.is_empty()), (left, left == 0));
                let some = unsent.take(count);
                prop_assert_eq!(some.len(), count.min(left));
                taken.extend(some);
                prop_assert_eq!(&taken[..], &written[..taken.len()]);
                prop_assert!(unsent.pieces.iter().all(|piece| !piece.is_empty()));
            }
        }
    }
}
