//! Identifiers that travel between the roles.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A scene node at one of its levels of detail: what a role draws.
///
/// It indexes the drawables of the scene that all three roles hold (their [`SceneHash`]es agree), so a `u32`
/// says everything. The paper (section 3.3) sends node ids and lets each receiver choose a level; naming the
/// level makes HC and RVG agree bit for bit.
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

/// The number of a frame, counted from 0 and agreed on by the three roles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[repr(transparent)]
pub struct FrameNumber(pub u32);

impl FrameNumber {
    /// The frame after this one; `None` after frame `u32::MAX` (828 days at 60 frames a second).
    #[must_use]
    pub const fn next(self) -> Option<Self> {
        match self.0.checked_add(1) {
            Some(n) => Some(Self(n)),
            None => None,
        }
    }
}

impl fmt::Display for FrameNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "frame {}", self.0)
    }
}

/// The fingerprint of a cooked scene (XXH3-128 of its content): peers that hold different scenes refuse each
/// other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct SceneHash(pub u128);

impl fmt::Display for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}
