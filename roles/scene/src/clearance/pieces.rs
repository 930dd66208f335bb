//! Pieces of the finest geometry, with trees over their triangles: as many as fit in memory.

use std::sync::Arc;

use glam::DVec3;
use quick_cache::{Weighter, sync::Cache};
use trimaran_proto::DrawableId;

use super::{
    boxes::{Boxes, Cuboid, Kind, sort_far_first},
    triangles::{Pair, Triangle, closest},
};
use crate::{Geometry, GeometryReader, Node, ReadError, Scene};

/// The most memory of triangles with their trees, bytes.
const MEMORY: u64 = 256 << 20;
/// About the bytes of a piece, for the cache's tables.
const TYPICAL: u64 = 4 << 10;

/// The triangles of a piece, about the origin of its node: so far coordinates cost no digits.
#[derive(Debug)]
pub(super) struct Piece {
    origin: DVec3,
    /// In the tree's order.
    triangles: Vec<Triangle>,
    boxes: Boxes,
}

/// The shortest distance so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Its square. Only shorter ones are looked for.
    pub(super) square: f64,
    /// Its ends in the world, on the first and on the second object; none before there is one.
    pub(super) points: Option<[DVec3; 2]>,
}

impl Near {
    /// None yet, and none from this squared distance on counts.
    pub(super) const fn below(square: f64) -> Self {
        Self { square, points: None }
    }
}

impl Piece {
    fn new(node: &Node, geometry: &Geometry) -> Self {
        let linear = node.linear().as_dmat3();
        let corner = |index: u32| {
            let vertex = geometry.vertices.get(index as usize)?;
            Some(linear * DVec3::from_array(vertex.position.map(f64::from)))
        };
        let triangle = |&[a, b, c]: &[u32; 3]| Some([corner(a)?, corner(b)?, corner(c)?]);
        let given: Vec<Triangle> = geometry.indices.as_chunks::<3>().0.iter().filter_map(triangle).collect();
        let bounds: Vec<Cuboid> = given.iter().map(|corners| Cuboid::around(*corners)).collect();
        let boxes = Boxes::new(&bounds);
        let triangles = boxes.order().iter().filter_map(|&at| given.get(at as usize).copied()).collect();
        Self { origin: node.origin(), triangles, boxes }
    }

    /// Finds a shorter distance to another piece, if there is one. `step` may end the search.
    pub(super) fn approach<E>(
        &self,
        other: &Self,
        near: &mut Near,
        mut step: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let offset = other.origin - self.origin;
        let away = |[here, there]: [u32; 2]| {
            let (a, b) = (self.boxes.branch(here)?, other.boxes.branch(there)?);
            Some((a.bounds.square(&b.bounds.moved(offset)), [here, there]))
        };
        let mut open: Vec<(f64, [u32; 2])> = away([0, 0]).into_iter().collect();
        while let Some((square, [here, there])) = open.pop() {
            let branches = self.boxes.branch(here).zip(other.boxes.branch(there));
            let Some((a, b)) = branches.filter(|_| square < near.square) else { continue };
            step()?;
            let is_larger = a.bounds.diagonal() >= b.bounds.diagonal();
            let pairs = match (a.kind(), b.kind()) {
                (Kind::Items(of_a), Kind::Items(of_b)) => {
                    let (of_a, of_b) = (self.triangles.get(of_a), other.triangles.get(of_b));
                    self.approach_each(of_a.unwrap_or_default(), of_b.unwrap_or_default(), offset, near);
                    continue;
                }
                (Kind::Branches(two), Kind::Branches(_)) if is_larger => two.map(|one| [one, there]),
                (Kind::Branches(two), Kind::Items(_)) => two.map(|one| [one, there]),
                (_, Kind::Branches(two)) => two.map(|one| [here, one]),
            };
            let begin = open.len();
            open.extend(pairs.into_iter().filter_map(away));
            sort_far_first(open.get_mut(begin..).unwrap_or_default());
        }
        Ok(())
    }

    fn approach_each(&self, here: &[Triangle], there: &[Triangle], offset: DVec3, near: &mut Near) {
        for b in there {
            let b = b.map(|corner| corner + offset);
            let around = Cuboid::around(b);
            for a in here {
                if Cuboid::around(*a).square(&around) >= near.square {
                    continue;
                }
                let Pair { square, points } = closest(a, &b);
                if square < near.square {
                    *near = Near { square, points: Some(points.map(|point| point + self.origin)) };
                }
            }
        }
    }

    fn bytes(&self) -> u64 {
        // The tree has about one branch of 60 bytes for two triangles.
        (self.triangles.len() * (size_of::<Triangle>() + 36) + 200) as u64
    }
}

/// The pieces used lately, shared by threads.
#[derive(Debug)]
pub(super) struct Pieces(Cache<u32, Arc<Piece>, Bytes>);

#[derive(Debug, Clone)]
struct Bytes;

impl Weighter<u32, Arc<Piece>> for Bytes {
    fn weight(&self, _: &u32, piece: &Arc<Piece>) -> u64 {
        piece.bytes()
    }
}

impl Default for Pieces {
    fn default() -> Self {
        Self(Cache::with_weighter((MEMORY / TYPICAL) as usize, MEMORY, Bytes))
    }
}

impl Pieces {
    /// A piece of a node's finest level.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(super) fn get(
        &self,
        scene: &Scene,
        reader: &mut GeometryReader<'_>,
        id: DrawableId,
    ) -> Result<Option<Arc<Piece>>, ReadError> {
        let Some((drawable, node)) = scene.part(id) else { return Ok(None) };
        let read = || Ok(Arc::new(Piece::new(&node, &reader.read(drawable.geometry)?)));
        self.0.get_or_insert_with(&id.0, read).map(Some)
    }
}
