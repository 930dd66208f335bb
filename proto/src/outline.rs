//! A scene's outline, which a display knows before it holds any of the scene.

use serde::{Deserialize, Serialize};

use crate::SceneHash;

/// A scene's fingerprint and its number of records of each kind. A display without the scene checks what it
/// receives against these.
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
    /// An outline where only the fingerprint matters.
    fn from(hash: SceneHash) -> Self {
        Self { hash, ..Self::default() }
    }
}
