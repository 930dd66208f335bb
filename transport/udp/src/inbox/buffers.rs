//! What the lane's bytes lie in on their way to the reader: buffers that are used again and again, so that in steady state nothing is
//! allocated for what arrives.

use bytes::{Bytes, BytesMut};
use trimaran_proto::{Decoder, Message};

use super::LaneViolation;
use crate::spare::Spare;

/// Room for ids that is made at once. A reader that keeps a batch keeps all that shares its room.
const PAGE: usize = 16 * 1024;

#[derive(Debug, Default)]
pub(super) struct Buffers {
    /// For units.
    pub(super) spare: Spare,
    /// For batches of ids: used again from its beginning once the reader has dropped all that lie in it.
    page: BytesMut,
    /// For messages, in the same way.
    decoder: Decoder,
}

impl Buffers {
    /// A copy for the reader to keep.
    pub(super) fn copy(&mut self, bytes: &[u8]) -> Bytes {
        if self.page.capacity() < bytes.len() {
            self.page.reserve(bytes.len().max(PAGE));
        }
        self.page.extend_from_slice(bytes);
        self.page.split().freeze()
    }

    /// The one message that `bytes` are.
    pub(super) fn decode(&mut self, bytes: &[u8]) -> Result<Message, LaneViolation> {
        self.decoder.push(bytes);
        let message = self.decoder.next_message()?;
        message.filter(|_| self.decoder.pending() == 0).ok_or(LaneViolation::Unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_used_again_once_nobody_holds_a_part_of_it_and_not_before() {
        let mut buffers = Buffers::default();
        let first = buffers.copy(&[1; PAGE / 2]);
        let at = first.as_ptr();
        drop((first, buffers.copy(&[2; PAGE / 2])));
        let again = buffers.copy(&[3; PAGE]);
        assert_eq!(again.as_ptr(), at, "the same room");
        let elsewhere = buffers.copy(&[4; PAGE]);
        assert_ne!(elsewhere.as_ptr(), at);
        assert!(again.iter().all(|byte| *byte == 3), "what is held does not change");
    }
}
