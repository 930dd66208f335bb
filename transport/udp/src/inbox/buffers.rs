//! Reused buffers for a lane's data on its way to the reader, so that in steady state arrivals allocate
//! nothing.

use bytes::{Bytes, BytesMut};
use trimaran_wire::{Decoder, Format, Message};

use super::LaneViolation;
use super::store::Pool;

/// The allocation unit for items. A reader that keeps a batch keeps its whole page.
const PAGE: usize = 16 * 1024;

#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) format: Format,
    /// For units.
    pub(super) pool: Pool,
    /// For batches: reused from the beginning once the reader has dropped all in it.
    page: BytesMut,
    /// For messages, in the same way.
    decoder: Decoder,
}

impl Buffers {
    pub(super) fn new(format: Format) -> Self {
        let (pool, page) = (Pool::default(), BytesMut::new());
        Self { format, pool, page, decoder: Decoder::new(format) }
    }

    /// A copy of `length` bytes from several pieces, for the reader to keep.
    pub(super) fn copy<'a>(&mut self, length: usize, pieces: impl Iterator<Item = &'a [u8]>) -> Bytes {
        if self.page.capacity() < length {
            self.page.reserve(length.max(PAGE));
        }
        pieces.for_each(|piece| self.page.extend_from_slice(piece));
        self.page.split().freeze()
    }

    /// Decodes the one message in the pieces.
    pub(super) fn decode<'a>(
        &mut self,
        pieces: impl Iterator<Item = &'a [u8]>,
    ) -> Result<Message, LaneViolation> {
        pieces.for_each(|piece| self.decoder.push(piece));
        let message = self.decoder.next_message()?;
        message.filter(|_| self.decoder.pending() == 0).ok_or(LaneViolation::Unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_used_again_once_nobody_holds_a_part_of_it_and_not_before() {
        let mut buffers = Buffers::new(crate::samples::FORMAT);
        let mut copy = |bytes: &[u8]| buffers.copy(bytes.len(), bytes.chunks(1000));
        let first = copy(&[1; PAGE / 2]);
        let at = first.as_ptr();
        drop((first, copy(&[2; PAGE / 2])));
        let again = copy(&[3; PAGE]);
        assert_eq!(again.as_ptr(), at, "the same room");
        let elsewhere = copy(&[4; PAGE]);
        assert_ne!(elsewhere.as_ptr(), at);
        assert!(again.iter().all(|byte| *byte == 3), "what is held does not change");
    }
}
