//! What a display knows of a scene before it holds any of it.

use serde::{Deserialize, Serialize};

use crate::SceneHash;

/// Which scene, and how many records of each kind it has: whoever holds none of it judges by this what it
/// is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SceneOutline {
    /// The scene's fingerprint.
    pub hash: SceneHash,
    /// How many nodes its tree has.
    pub nodes: u32,
    /// How many drawables: the most ids that a frame can have.
    pub drawables: u32,
    /// How many pieces of geometry.
    pub geometries: u32,
    /// How many objects.
    pub objects: u32,
}

impl From<SceneHash> for SceneOutline {
    /// A scene of which nothing but its fingerprint matters.
    fn from(hash: SceneHash) -> Self {
        Self { hash, ..Self::default() }
    }
}
