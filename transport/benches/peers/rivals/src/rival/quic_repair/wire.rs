//! The datagrams.

use bytes::{Buf, BufMut, Bytes, BytesMut};

/// The bytes of a shard's header.
pub(super) const HEADER: usize = 12;

/// A part of a frame, or of its repair.
#[derive(Debug, Clone)]
pub(super) struct Shard {
    pub(super) frame: u32,
    /// Those from `data` on are repair.
    pub(super) index: u8,
    pub(super) data: u8,
    pub(super) repair: u8,
    /// The bytes of the frame.
    pub(super) length: u32,
    pub(super) bytes: Bytes,
}

impl Shard {
    pub(super) fn encode(&self) -> Bytes {
        let mut out = BytesMut::with_capacity(HEADER + self.bytes.len());
        out.put_u32(self.frame);
        out.put_u8(self.index);
        out.put_u8(self.data);
        out.put_u8(self.repair);
        out.put_u8(0);
        out.put_u32(self.length);
        out.put_slice(&self.bytes);
        out.freeze()
    }

    pub(super) fn decode(mut bytes: Bytes) -> Option<Self> {
        if bytes.len() <= HEADER {
            return None;
        }
        let (frame, index, data, repair) = (bytes.get_u32(), bytes.get_u8(), bytes.get_u8(), bytes.get_u8());
        bytes.advance(1);
        let length = bytes.get_u32();
        let sound = data > 0 && u16::from(index) < u16::from(data) + u16::from(repair);
        sound.then_some(Self { frame, index, data, repair, length, bytes })
    }
}

/// All shards of a frame are judged.
pub(super) const ALL: u8 = u8::MAX;

/// The parts of a frame that have come.
#[derive(Debug, Clone, Copy)]
pub(super) struct Report {
    /// A bit for each shard that has come; all bits where the frame is done.
    pub(super) came: u64,
    /// Missing shards before this one are lost; later ones may be on their way.
    pub(super) judged: u8,
}

/// The receiver's reports. Frames before `below` are done.
#[derive(Debug)]
pub(super) struct Status {
    pub(super) below: u32,
    pub(super) frames: Vec<(u32, Report)>,
}

impl Status {
    pub(super) fn encode(&self) -> Bytes {
        let mut out = BytesMut::new();
        out.put_u32(self.below);
        for (frame, Report { came, judged }) in &self.frames {
            out.put_u32(*frame);
            out.put_u64(*came);
            out.put_u8(*judged);
        }
        out.freeze()
    }

    pub(super) fn decode(mut bytes: &[u8]) -> Option<Self> {
        let below = bytes.try_get_u32().ok()?;
        let mut frames = Vec::new();
        while bytes.len() >= 13 {
            frames.push((bytes.get_u32(), Report { came: bytes.get_u64(), judged: bytes.get_u8() }));
        }
        Some(Self { below, frames })
    }
}
