//! The inputs of the LOD cut beside the view: the level rule, and hidden and see-through objects.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use trimaran_proto::{Appearance, DrawableId, ObjectSet, ViewState};
use trimaran_scene::{Node, NodeId, Scene};

use crate::LodRule;

/// The level rule, and the appearance of objects. A [`LodRule`] alone draws all of them normally.
#[derive(Debug, Clone)]
pub struct CutRule {
    lod: LodRule,
    /// Set if some objects are not drawn normally.
    nodes: Option<Arc<NodeAppearances>>,
}

/// The appearance of a scene's nodes.
#[derive(Debug)]
struct NodeAppearances {
    state: ViewState,
    /// The appearance of nodes without an object or an entry of `groups`.
    others: NodeAppearance,
    /// Nodes of several objects not all of which are as `others`.
    groups: HashMap<u32, NodeAppearance>,
}

/// The appearance of everything below a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeAppearance {
    Solid,
    SeeThrough,
    Hidden,
    /// Mixed, so that no level of the node itself can be drawn.
    Mixed,
}

impl CutRule {
    /// The rule for `state` in `scene`. Visits the objects that differ from most, and their ancestors.
    /// Numbers without an object are ignored.
    #[must_use]
    pub fn new(scene: &Scene, state: &ViewState) -> Self {
        // A scene from a link carries its see-through objects with it.
        let is_solid = state.is_all_solid(scene.is_whole() && !scene.has_see_through());
        let nodes = (!is_solid).then(|| Arc::new(NodeAppearances::new(scene, state)));
        Self { lod: state.lod, nodes }
    }

    /// The rule for levels of detail.
    #[must_use]
    pub const fn lod(&self) -> LodRule {
        self.lod
    }

    /// Whether this drawable of `scene` is see-through, and so hides nothing.
    #[must_use]
    pub fn is_see_through(&self, scene: &Scene, id: DrawableId) -> bool {
        let Some(nodes) = &self.nodes else { return false };
        let drawable = scene.drawables().get(id.index());
        let node = drawable
            .and_then(|drawable| Some((NodeId(drawable.node), scene.nodes().get(drawable.node as usize)?)));
        node.is_some_and(|(id, node)| nodes.of(scene, id, node) == NodeAppearance::SeeThrough)
    }

    /// Keeps the drawables that can hide something.
    pub fn retain_solid(&self, scene: &Scene, ids: &mut Vec<DrawableId>) {
        if self.has_see_through(scene) {
            ids.retain(|id| !self.is_see_through(scene, *id));
        }
    }

    /// Divides front-to-back drawables: returns the solid ones in the same order, and leaves the see-through
    /// ones in `see_through`, from back to front.
    #[must_use]
    pub fn divide<'i>(
        &self,
        scene: &Scene,
        ids: &'i [DrawableId],
        see_through: &mut Vec<DrawableId>,
    ) -> Cow<'i, [DrawableId]> {
        see_through.clear();
        if !self.has_see_through(scene) {
            return Cow::Borrowed(ids);
        }
        see_through.extend(ids.iter().rev().filter(|id| self.is_see_through(scene, **id)));
        Cow::Owned(ids.iter().copied().filter(|id| !self.is_see_through(scene, *id)).collect())
    }

    /// Whether anything of `scene` can be see-through.
    fn has_see_through(&self, scene: &Scene) -> bool {
        self.nodes.as_ref().is_some_and(|nodes| match &nodes.state.see_through {
            Some(set) => !set.is_empty(),
            None => scene.has_see_through(),
        })
    }

    /// Whether both draw all objects alike, whatever their levels. Equal view states of two rules may be told
    /// apart.
    #[must_use]
    pub fn looks_like(&self, other: &Self) -> bool {
        match (&self.nodes, &other.nodes) {
            (None, None) => true,
            (Some(own), Some(other)) => Arc::ptr_eq(own, other),
            _ => false,
        }
    }

    /// The appearances of 16 nodes from `first` on, for a device: two bits each, the first ones lowest. 0 is
    /// solid, 1 see-through, 2 hidden, and 3 a mixture, so that no level of the node itself can be drawn.
    #[must_use]
    pub fn appearance_bits(&self, scene: &Scene, first: u32) -> u32 {
        if self.nodes.is_none() {
            return 0;
        }
        let nodes = (first..first.saturating_add(16)).zip((0..).step_by(2));
        let bits = nodes.filter_map(|(id, bit)| {
            let node = scene.nodes().get(id as usize)?;
            let code = match self.appearance(scene, NodeId(id), node) {
                NodeAppearance::Solid => 0,
                NodeAppearance::SeeThrough => 1,
                NodeAppearance::Hidden => 2,
                NodeAppearance::Mixed => 3,
            };
            Some(code << bit)
        });
        bits.fold(0, |word, code| word | code)
    }

    /// The appearance of a node of `scene`.
    pub(crate) fn appearance(&self, scene: &Scene, id: NodeId, node: &Node) -> NodeAppearance {
        self.nodes.as_ref().map_or(NodeAppearance::Solid, |nodes| nodes.of(scene, id, node))
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

/// Counts the differing appearances of a node's children.
#[derive(Debug, Clone, Copy)]
struct Tally {
    alike: NodeAppearance,
    count: u32,
}

impl NodeAppearances {
    /// Goes up from the objects that differ from most.
    fn new(scene: &Scene, state: &ViewState) -> Self {
        let nodes = scene.nodes();
        let others = if state.isolated.is_some() { NodeAppearance::Hidden } else { NodeAppearance::Solid };
        let mut above = BTreeMap::new();
        let add = |parent: u32, own: NodeAppearance, above: &mut BTreeMap<u32, Tally>| {
            let tally = above.entry(parent).or_insert(Tally { alike: own, count: 0 });
            tally.count += 1;
            if tally.alike != own {
                tally.alike = NodeAppearance::Mixed;
            }
        };
        let exceptions: [Option<&ObjectSet>; 2] = match &state.isolated {
            Some(isolated) => [Some(isolated), None],
            None => [Some(&state.hidden), Some(state.see_through.as_ref().unwrap_or(scene.see_through()))],
        };
        let known = |object: &u32| (*object as usize) < scene.objects().len();
        let mut objects: Vec<u32> =
            exceptions.into_iter().flatten().flat_map(|set| set.iter().take_while(known)).collect();
        objects.sort_unstable();
        objects.dedup();
        for object in objects {
            let Some(record) = scene.objects().get(object as usize) else { continue };
            let own = object_appearance(scene, state, NodeId(record.node), object);
            if let Some(node) = nodes.get(record.node as usize).filter(|_| own != others) {
                add(node.parent, own, &mut above);
            }
        }
        // Parents stand before their children, so the last one is complete.
        let mut groups = HashMap::new();
        while let Some((id, tally)) = above.pop_last() {
            let Some(node) = nodes.get(id as usize) else { continue }; // above the root
            let own = if tally.count == node.child_count { tally.alike } else { NodeAppearance::Mixed };
            groups.insert(id, own);
            add(node.parent, own, &mut above);
        }
        Self { state: state.clone(), others, groups }
    }

    fn of(&self, scene: &Scene, id: NodeId, node: &Node) -> NodeAppearance {
        if node.object == Node::NONE {
            self.groups.get(&id.0).copied().unwrap_or(self.others)
        } else {
            object_appearance(scene, &self.state, id, node.object)
        }
    }
}

/// The appearance of an object. The model's own set is asked only if the view state has none.
fn object_appearance(scene: &Scene, state: &ViewState, node: NodeId, object: u32) -> NodeAppearance {
    let modelled_see_through = state.see_through.is_none() && scene.is_see_through(node, object);
    state.appearance(object, modelled_see_through).into()
}

impl From<Appearance> for NodeAppearance {
    fn from(appearance: Appearance) -> Self {
        match appearance {
            Appearance::Solid => Self::Solid,
            Appearance::SeeThrough => Self::SeeThrough,
            Appearance::Hidden => Self::Hidden,
        }
    }
}
