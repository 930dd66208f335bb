//! A partial scene: a display's parts of a scene that it has no file of.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bytemuck::{Pod, Zeroable};
use bytes::Bytes;
use elsa::sync::FrozenMap;
use parking_lot::RwLock;
use thiserror::Error;
use trimaran_proto::{DrawableId, SceneOutline};

use super::file::SceneFile;
use super::{Drawable, Geometry, GeometryError, GeometryPlace, Node, NodeId, ReadError, Scene, Sides};

/// A record of a drawable and its node, for drawing.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DrawableEntry {
    /// World box of the drawable, lower corner, metres: see [`Scene::part`].
    pub world_min: [f64; 3],
    /// Upper corner.
    pub world_max: [f64; 3],
    /// [`Node::origin`], metres.
    pub origin: [f64; 3],
    /// [`Node::linear`].
    pub linear: [f32; 9],
    /// The drawable.
    pub id: u32,
    /// Its node.
    pub node: u32,
    /// [`Drawable::geometry`].
    pub geometry: u32,
    /// [`Drawable::triangles`].
    pub triangles: u32,
    /// [`Drawable::sides`].
    pub sides: Sides,
    /// An object that the drawable shows. A level of several objects is drawn only if all of them look alike,
    /// so any of them suffices.
    pub object: u32,
    /// How many objects the drawable shows, 1 for an object and for a part of one; plus
    /// [`SEE_THROUGH`](Self::SEE_THROUGH) if the model has these see-through.
    pub objects: u32,
    /// The first drawable of its level.
    pub level: u32,
    /// How many drawables its level consists of.
    pub pieces: u32,
}

/// Why data was rejected.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum GiveError {
    /// A number of a drawable, node, piece of geometry or object exceeds the outline.
    #[error("it has {what} {number}, and the scene only {count} of these")]
    Number {
        /// Its kind.
        what: &'static str,
        /// Its number.
        number: u32,
        /// The scene's count.
        count: u32,
    },
    /// A record holds a value that no cooked scene has.
    #[error("{0} is malformed: {1}")]
    Malformed(DrawableId, &'static str),
    /// A record differs from an earlier one.
    #[error("{0} came once more, and is another one")]
    Other(DrawableId),
    /// A piece of geometry differs from an earlier one.
    #[error("the geometry {0} came once more, and is another one")]
    OtherGeometry(u32),
    /// A piece of geometry cannot be unpacked.
    #[error("the geometry {number} is malformed")]
    Geometry {
        /// Its number.
        number: u32,
        /// The error.
        #[source]
        cause: GeometryError,
    },
    /// A drawable and its geometry do not match.
    #[error("{0} has another number of triangles than its geometry")]
    Triangles(DrawableId),
}

/// A node, and whether the model has its objects see-through.
#[derive(Debug, Clone, Copy, PartialEq)]
struct GivenNode {
    node: Node,
    see_through: bool,
}

/// A drawable with its box.
#[derive(Debug, Clone, Copy, PartialEq)]
struct GivenDrawable {
    drawable: Drawable,
    world_min: [f64; 3],
    world_max: [f64; 3],
}

/// The received parts.
#[derive(Debug)]
pub(super) struct Given {
    outline: SceneOutline,
    nodes: FrozenMap<u32, Box<GivenNode>>,
    has_see_through: AtomicBool,
    drawables: FrozenMap<u32, Box<GivenDrawable>>,
    pub(super) places: FrozenMap<u32, Box<GeometryPlace>>,
    geometry: RwLock<HashMap<u32, Bytes>>,
}

impl GiveError {
    /// Whether earlier data may be the wrong one. It stays, so right data cannot replace it.
    #[must_use]
    pub const fn doubts_what_is_there(&self) -> bool {
        matches!(self, Self::Other(_) | Self::OtherGeometry(_) | Self::Triangles(_))
    }
}

impl DrawableEntry {
    /// The bit of [`objects`](Self::objects) for objects that the model has see-through.
    pub const SEE_THROUGH: u32 = 1 << 31;

    /// The record of a drawable of `scene`; `None` if it does not exist.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn of(scene: &Scene, id: DrawableId) -> Result<Option<Self>, ReadError> {
        scene.reading(|| Self::find(scene, id))
    }

    fn find(scene: &Scene, id: DrawableId) -> Option<Self> {
        let (drawable, node) = scene.part(id)?;
        let object = an_object(scene, &node)?;
        let see_through =
            if scene.is_see_through(NodeId(drawable.node), object) { Self::SEE_THROUGH } else { 0 };
        Some(Self {
            world_min: node.world_min,
            world_max: node.world_max,
            origin: node.origin,
            linear: node.linear,
            id: id.0,
            node: drawable.node,
            geometry: drawable.geometry,
            triangles: drawable.triangles,
            sides: drawable.sides,
            object,
            objects: node.objects | see_through,
            level: drawable.level(id).first().0,
            pieces: drawable.pieces.into(),
        })
    }

    fn drawable(&self) -> GivenDrawable {
        let Self { world_min, world_max, node, geometry, triangles, sides, .. } = *self;
        // They fit, as was checked.
        let (piece, pieces) = (self.id.wrapping_sub(self.level) as u16, self.pieces as u16);
        let drawable = Drawable { error: 0.0, node, geometry, triangles, sides, piece, pieces };
        GivenDrawable { drawable, world_min, world_max }
    }

    fn node(&self) -> GivenNode {
        let Self { origin, linear, object, .. } = *self;
        let objects = self.objects & !Self::SEE_THROUGH;
        let node = Node { origin, linear, object, objects, ..Node::default() };
        GivenNode { node, see_through: objects != self.objects }
    }

    fn check(&self, outline: &SceneOutline) -> Result<(), GiveError> {
        let SceneOutline { nodes, drawables, geometries, objects, .. } = *outline;
        let within = |what, number, count| match number < count {
            true => Ok(()),
            false => Err(GiveError::Number { what, number, count }),
        };
        within("drawable", self.id, drawables)?;
        within("node", self.node, nodes)?;
        within("geometry", self.geometry, geometries)?;
        within("object", self.object, objects)?;
        let malformed = |why| Err(GiveError::Malformed(DrawableId(self.id), why));
        let finite = self.linear.iter().all(|x| x.is_finite()) && self.origin.iter().all(|x| x.is_finite());
        let corners = || self.world_min.iter().zip(&self.world_max);
        if !finite || !corners().all(|(min, max)| min.is_finite() && max.is_finite()) {
            malformed("a number is not finite")
        } else if !corners().all(|(min, max)| min <= max) {
            malformed("its box is inside out")
        } else if !self.sides.is_known() {
            malformed("its sides are unknown")
        } else if self.triangles == 0 {
            malformed("it has no triangles")
        } else if self.pieces > u16::MAX.into()
            || !(self.level..self.level.saturating_add(self.pieces)).contains(&self.id)
        {
            malformed("it is no piece of its level")
        } else {
            Ok(())
        }
    }
}

/// The object that a node is a part of, or one of those below it.
fn an_object(scene: &Scene, node: &Node) -> Option<u32> {
    let mut below = node;
    while below.object == Node::NONE && !below.is_leaf() {
        below = scene.nodes().get(below.first_child as usize)?;
    }
    Some(below.object)
}

impl Scene {
    /// A scene with only the parts [given](Self::give) to it. Its nodes have no boxes and else the fields of
    /// [`DrawableEntry`]; a node of several objects names one of them.
    #[must_use]
    pub fn empty(outline: SceneOutline) -> Self {
        let given = Given {
            outline,
            nodes: FrozenMap::new(),
            has_see_through: AtomicBool::new(false),
            drawables: FrozenMap::new(),
            places: FrozenMap::new(),
            geometry: RwLock::default(),
        };
        Self::of_nothing(Arc::new(SceneFile::absent(&outline)), Some(given))
    }

    /// The outline, which a receiver needs before any part.
    #[must_use]
    pub fn outline(&self) -> SceneOutline {
        let count = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        SceneOutline {
            hash: self.hash(),
            nodes: count(self.nodes().len()),
            drawables: count(self.drawables().len()),
            geometries: count(self.places().len()),
            objects: count(self.objects().len()),
        }
    }

    /// Whether all of it is present or can be read: it was not [empty](Self::empty) at first.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.given.is_none()
    }

    /// Takes a drawable's record, in a scene that was [empty](Self::empty).
    ///
    /// # Errors
    /// If it does not fit this scene; nothing is taken then.
    pub fn give(&self, entry: &DrawableEntry) -> Result<(), GiveError> {
        let Some(given) = &self.given else { return Ok(()) };
        entry.check(&given.outline)?;
        let (drawable, node) = (entry.drawable(), entry.node());
        let other_node = given.nodes.get(&entry.node).is_some_and(|known| *known != node);
        if other_node || given.drawables.get(&entry.id).is_some_and(|known| *known != drawable) {
            return Err(GiveError::Other(DrawableId(entry.id)));
        }
        // Of two concurrent ones, the first is kept.
        let same_node = *given.nodes.insert(entry.node, Box::new(node)) == node;
        given.has_see_through.fetch_or(node.see_through, Ordering::Relaxed);
        match *given.drawables.insert(entry.id, Box::new(drawable)) == drawable && same_node {
            true => Ok(()),
            false => Err(GiveError::Other(DrawableId(entry.id))),
        }
    }

    /// Takes a piece of geometry as stored in the file, in a scene that was [empty](Self::empty).
    ///
    /// # Errors
    /// If it does not fit this scene; nothing is taken then.
    pub fn give_geometry(&self, number: u32, packed: Bytes) -> Result<(), GiveError> {
        let Some(given) = &self.given else { return Ok(()) };
        let count = given.outline.geometries;
        if number >= count {
            return Err(GiveError::Number { what: "geometry", number, count });
        }
        let malformed = |cause| GiveError::Geometry { number, cause };
        let geometry = Geometry::unpack(&packed).map_err(malformed)?;
        let place = GeometryPlace::alone(&geometry, packed.len());
        if *given.places.insert(number, Box::new(place)) != place {
            return Err(GiveError::OtherGeometry(number));
        }
        given.geometry.write().insert(number, packed);
        Ok(())
    }

    /// Removes a given piece of geometry; returns its size in bytes. Its sizes stay known.
    pub fn take_back_geometry(&self, number: u32) -> usize {
        let given = self.given.as_ref();
        given.and_then(|given| given.geometry.write().remove(&number)).map_or(0, |bytes| bytes.len())
    }

    /// Whether a drawable can be drawn: a scene from a file has all of its own.
    ///
    /// # Errors
    /// If its parts do not match.
    pub fn has(&self, id: DrawableId) -> Result<bool, GiveError> {
        let Some(given) = &self.given else { return Ok(id.index() < self.drawables().len()) };
        let Some(drawable) = given.drawable(id.0) else { return Ok(false) };
        if !given.geometry.read().contains_key(&drawable.geometry) {
            return Ok(false);
        }
        match given.places.get(&drawable.geometry) {
            Some(place) if place.triangles == drawable.triangles => Ok(true),
            _ => Err(GiveError::Triangles(id)),
        }
    }
}

impl Given {
    /// Bytes of records and packed geometry.
    pub(super) fn bytes(&self) -> usize {
        let pieces = self.geometry.read();
        self.nodes.len() * size_of::<GivenNode>()
            + self.drawables.len() * size_of::<GivenDrawable>()
            + pieces.values().map(Bytes::len).sum::<usize>()
    }

    /// A drawable, if it was given.
    pub(super) fn drawable(&self, number: u32) -> Option<&Drawable> {
        self.drawables.get(&number).map(|given| &given.drawable)
    }

    /// The drawable's node with the boxes of the drawable, if it was given.
    pub(super) fn part(&self, id: DrawableId, node: &Node) -> Option<Node> {
        let GivenDrawable { world_min, world_max, .. } = *self.drawables.get(&id.0)?;
        Some(Node { world_min, world_max, ..*node })
    }

    /// A node, if it was given.
    pub(super) fn node(&self, number: u32) -> Option<&Node> {
        self.nodes.get(&number).map(|given| &given.node)
    }

    /// Whether the model has the objects of any node see-through.
    pub(super) fn has_see_through(&self) -> bool {
        self.has_see_through.load(Ordering::Relaxed)
    }

    /// Whether the model has the objects of this node see-through.
    pub(super) fn is_see_through(&self, node: u32) -> bool {
        self.nodes.get(&node).is_some_and(|node| node.see_through)
    }

    /// A piece of geometry, if present.
    pub(super) fn geometry(&self, number: u32) -> Option<Bytes> {
        self.geometry.read().get(&number).cloned()
    }
}

#[cfg(test)]
#[path = "given_tests.rs"]
mod tests;
