//! The parts of a scene that culling decides on, from the root down.

use std::borrow::Cow;

use trimaran_proto::DrawableId;
use trimaran_scene::NodeId;

use crate::boxes::{BoxMaker, Prepared};
use crate::lod_cut::{Choice, LodCut};

/// A node or a piece: each is tested by its own box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reached {
    /// A node of the tree.
    Node(NodeId),
    /// A piece of a level that is drawn, one of several.
    Piece(DrawableId),
}

impl Reached {
    /// How it would be drawn in the cut, and its box. `None` if the scene lacks it.
    #[must_use]
    pub fn find(self, cut: &LodCut<'_>, maker: &BoxMaker) -> Option<(Choice, Prepared)> {
        let scene = cut.scene();
        let part = match self {
            Self::Node(id) => Cow::Borrowed(scene.nodes().get(id.0 as usize)?),
            Self::Piece(id) => Cow::Owned(scene.part(id)?.1),
        };
        if cut.outside(&part) {
            return Some((Choice::Nothing, Prepared::Outside));
        }
        let choice = match self {
            Self::Node(id) => cut.choose(id, &part),
            Self::Piece(id) => Choice::Draw(scene.drawables().get(id.index())?.level(id)),
        };
        let prepared = if choice == Choice::Nothing { Prepared::Outside } else { maker.prepare(&part) };
        Some((choice, prepared))
    }
}
