//! Used buffers, kept for later.

use bytes::BytesMut;

/// How many are kept: few frames are open at once.
const KEPT: usize = 4;
/// The largest kept buffer. A larger one is freed.
const LARGEST: usize = 256 * 1024;

/// A few empty buffers with allocated room.
#[derive(Debug, Default)]
pub(crate) struct Spare(Vec<BytesMut>);

impl Spare {
    /// An empty buffer, with room if available.
    pub(crate) fn take(&mut self) -> BytesMut {
        self.0.pop().unwrap_or_default()
    }

    /// Takes back a buffer that nobody else shares.
    pub(crate) fn put(&mut self, mut buffer: BytesMut) {
        buffer.clear();
        // Room before the beginning, left by data taken from the front, counts as well.
        let has_room = buffer.try_reclaim(1);
        if has_room && buffer.capacity() <= LARGEST && self.0.len() < KEPT {
            self.0.push(buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use bytes::Buf;

    use super::*;

    #[test]
    fn room_comes_back_whole() {
        let mut spare = Spare::default();
        let mut buffer = spare.take();
        buffer.extend_from_slice(&[1; 5000]);
        let (at, room) = (buffer.as_ptr(), buffer.capacity());
        buffer.advance(5000);
        spare.put(buffer);
        let again = spare.take();
        assert_eq!((again.as_ptr(), again.len(), again.capacity()), (at, 0, room));
        assert_eq!(spare.take().capacity(), 0, "there was one");
    }

    #[test]
    fn a_burst_does_not_keep_its_memory() {
        let mut spare = Spare::default();
        for useless in [BytesMut::with_capacity(LARGEST + 1), BytesMut::new()] {
            spare.put(useless);
            assert!(spare.0.is_empty());
        }
        (0..KEPT + 3).for_each(|_| spare.put(BytesMut::with_capacity(1000)));
        let kept = std::iter::repeat_with(|| spare.take()).take_while(|buffer| buffer.capacity() > 0);
        assert_eq!(kept.count(), KEPT);
    }
}
