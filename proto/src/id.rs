//! Identifiers that travel between the roles.

use std::fmt;

use serde::{Deserialize, Serialize};
use trimaran_wire::{Batch, Item};

/// A scene node at one of its levels of detail: the unit that roles draw.
///
/// It indexes the drawables of the scene that all three roles hold (their [`SceneHash`]es agree), so a `u32`
/// is enough. The paper (section 3.3) sends node ids and lets each receiver choose a level; naming the level
/// makes HC and RVG agree bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct DrawableId(pub u32);

impl DrawableId {
    /// The id as an index into the scene's drawables.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for DrawableId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "drawable {}", self.0)
    }
}

impl Item for DrawableId {
    const SIZE: usize = 4;

    #[inline]
    fn write(self, out: &mut [u8]) {
        self.0.write(out);
    }

    #[inline]
    fn read(bytes: &[u8]) -> Self {
        Self(u32::read(bytes))
    }
}

/// The bytes of one id on the wire: a `u32`, little-endian, never a varint, so that the bandwidth formula is
/// exact.
pub const ID_BYTES: usize = <DrawableId as Item>::SIZE;

/// A batch of ids.
pub type IdBatch = Batch<DrawableId>;

/// The fingerprint of a cooked scene: the first half of the BLAKE3 hash at the root of its tree of hashes.
/// Peers that hold different scenes refuse each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[repr(transparent)]
pub struct SceneHash(pub u128);

impl fmt::Display for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

/// The version of a [view state](crate::ViewState): it counts a session's changes. Version 0 has the
/// [`Settings`](crate::Settings) of the handshake, nothing cut away or hidden, and the model's own
/// see-through objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[repr(transparent)]
pub struct ViewVersion(pub u32);
