//! What decides the LOD cut beside the view: the level rule, and which objects are hidden or seen through.

use std::borrow::Cow;
use std::sync::Arc;

use trimaran_proto::{Appearance, DrawableId, ViewState};
use trimaran_scene::{Node, NodeId, Scene};

use crate::LodRule;

/// The level rule, and how the objects of a scene are drawn. A [`LodRule`] alone draws all of them as they
/// are.
#[derive(Debug, Clone)]
pub struct CutRule {
    lod: LodRule,
    /// Where not all objects are drawn as they are: how each node is.
    nodes: Option<Arc<[NodeAppearance]>>,
}

/// How what is below a node is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeAppearance {
    Solid,
    SeeThrough,
    Hidden,
    /// Not all of it alike, so that no level of the node itself can be drawn.
    Mixed,
}

impl CutRule {
    /// What `state` asks for in `scene`; goes through the scene's nodes if not all objects are drawn as they
    /// are. Numbers that are none of the scene's objects mean nothing.
    #[must_use]
    pub fn new(scene: &Scene, state: &ViewState) -> Self {
        let nodes = (!state.is_all_solid()).then(|| appearances(scene.nodes(), state));
        Self { lod: state.lod, nodes }
    }

    /// When a level of detail is good enough.
    #[must_use]
    pub const fn lod(&self) -> LodRule {
        self.lod
    }

    /// Whether what is behind this drawable of `scene` shines through it. It hides nothing.
    #[must_use]
    pub fn is_see_through(&self, scene: &Scene, id: DrawableId) -> bool {
        let node = || scene.drawables().get(id.index()).map(|drawable| NodeId(drawable.node));
        self.nodes.is_some() && node().is_some_and(|node| self.appearance(node) == NodeAppearance::SeeThrough)
    }

    /// Keeps what can hide something.
    pub fn retain_solid(&self, scene: &Scene, ids: &mut Vec<DrawableId>) {
        if self.nodes.is_some() {
            ids.retain(|id| !self.is_see_through(scene, *id));
        }
    }

    /// Divides what is drawn front to back: gives what is solid, in the same order, and leaves in
    /// `see_through` what is seen through, from back to front.
    #[must_use]
    pub fn divide<'i>(
        &self,
        scene: &Scene,
        ids: &'i [DrawableId],
        see_through: &mut Vec<DrawableId>,
    ) -> Cow<'i, [DrawableId]> {
        see_through.clear();
        if self.nodes.is_none() {
            return Cow::Borrowed(ids);
        }
        see_through.extend(ids.iter().rev().filter(|id| self.is_see_through(scene, **id)));
        Cow::Owned(ids.iter().copied().filter(|id| !self.is_see_through(scene, *id)).collect())
    }

    pub(crate) fn appearance(&self, node: NodeId) -> NodeAppearance {
        let known = self.nodes.as_ref().and_then(|nodes| nodes.get(node.0 as usize));
        known.copied().unwrap_or(NodeAppearance::Solid)
    }
}

impl From<LodRule> for CutRule {
    fn from(lod: LodRule) -> Self {
        Self { lod, nodes: None }
    }
}

impl From<&Self> for CutRule {
    fn from(rule: &Self) -> Self {
        rule.clone()
    }
}

/// How each node is drawn: an object's nodes like the object, the others like all below them.
fn appearances(nodes: &[Node], state: &ViewState) -> Arc<[NodeAppearance]> {
    let mut known: Vec<Option<NodeAppearance>> = vec![None; nodes.len()];
    // Children stand after their parents, so one pass from the end comes to them first.
    for (index, node) in nodes.iter().enumerate().rev() {
        let of_object = (node.object != Node::NONE).then(|| match state.appearance(node.object) {
            Appearance::Solid => NodeAppearance::Solid,
            Appearance::SeeThrough => NodeAppearance::SeeThrough,
            Appearance::Hidden => NodeAppearance::Hidden,
        });
        let below = known.get(index).copied().flatten();
        let own = of_object.or(below).unwrap_or(NodeAppearance::Solid);
        if let Some(slot) = known.get_mut(index) {
            *slot = Some(own);
        }
        if let Some(parent) = known.get_mut(node.parent as usize) {
            *parent = match *parent {
                Some(other) if other != own => Some(NodeAppearance::Mixed),
                _ => Some(own),
            };
        }
    }
    known.into_iter().map(|own| own.unwrap_or(NodeAppearance::Solid)).collect()
}
