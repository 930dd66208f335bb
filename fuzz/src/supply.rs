//! Properties of any block of the bulk lane. The fuzz target searches for blocks that break it; an
//! ordinary test of `proto` replays the corpus.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Debug;
use std::ops::Range;

use bytes::Bytes;
use serde::Serialize;
use serde::de::DeserializeOwned;
use trimaran_proto::{Demand, DrawableId, NumberList, SceneHash, SceneOutline, Supply, items, put_item};
use trimaran_scene::{DrawableEntry, GeometryPlace, Scene, pack_entries, unpack_entries};
use trimaran_wire::MAX_BLOCK;

/// The outline that a display has of the scene.
pub const OUTLINE: SceneOutline =
    SceneOutline { hash: SceneHash(0x1234), nodes: 6, drawables: 8, geometries: 4, objects: 5 };

/// Any bytes, as a block of either side, are refused or are items, which are written and read again as the
/// same. A culler's items are refused, or taken by a scene of which nothing was there before.
pub fn supply(bytes: &[u8]) {
    let block = bytes.get(..MAX_BLOCK).unwrap_or(bytes);
    read::<Demand>(block).iter().for_each(demand);
    let mut display = Display::default();
    read::<Supply>(block).into_iter().for_each(|item| display.take(item));
}

/// The items of a block, which are there again when they are written.
fn read<T: Serialize + DeserializeOwned + PartialEq + Debug>(block: &[u8]) -> Vec<T> {
    let Ok(read) = items::<T>(block) else { return Vec::new() };
    let mut written = Vec::new();
    assert!(read.iter().all(|item| put_item(&mut written, item)), "they came in one block");
    assert_eq!(items(&written).as_ref(), Ok(&read));
    read
}

fn demand(demand: &Demand) {
    match demand {
        Demand::Holds { drawables, geometries } => [drawables, geometries].into_iter().for_each(list),
        Demand::Lacks { drawables, .. } => list(drawables),
        Demand::Dropped { geometries } => list(geometries),
        _ => {}
    }
}

/// It rises, and its parts are all of it.
fn list(numbers: &NumberList) {
    let all: Vec<u32> = numbers.iter().collect();
    assert!(all.is_sorted_by(|a, b| a < b));
    let parts: Vec<NumberList> = numbers.parts().collect();
    assert!(parts.iter().all(|part| (1..=NumberList::MOST).contains(&part.iter().len())));
    assert!(parts.iter().flat_map(NumberList::iter).eq(all));
}

/// A display, and the piece of which parts have come.
#[derive(Debug)]
pub struct Display {
    /// The parts that have come.
    pub scene: Scene,
    arriving: Option<(u32, u32, Vec<u8>)>,
    /// The stand-ins of drawables, all of them of the scene.
    stand_ins: BTreeMap<DrawableId, (DrawableId, u32)>,
    /// Pieces of the scene that were said to come ahead.
    pub ahead: BTreeSet<u32>,
    /// Whether all that came was taken.
    pub takes_all: bool,
}

impl Default for Display {
    fn default() -> Self {
        let scene = Scene::empty(OUTLINE);
        let (stand_ins, ahead) = (BTreeMap::new(), BTreeSet::new());
        Self { scene, arriving: None, stand_ins, ahead, takes_all: true }
    }
}

impl Display {
    /// Takes an item. The scene can then use it.
    pub fn take(&mut self, item: Supply) {
        match item {
            Supply::Entries { packed } => match unpack_entries(&packed) {
                Ok(entries) => {
                    packs_again(&entries);
                    entries.iter().for_each(|entry| self.entry(entry));
                }
                Err(_) => self.takes_all = false,
            },
            Supply::Geometry { number, length, offset, part } => self.part(number, length, offset, &part),
            Supply::StandIn { id, pieces, drawables } => {
                list(&drawables);
                self.stand_in((id, pieces), &drawables);
            }
            Supply::Ahead { geometries } => {
                list(&geometries);
                self.ahead.extend(geometries.iter().filter(|number| *number < OUTLINE.geometries));
            }
            _ => {}
        }
        self.is_sound();
    }

    /// The drawables to show in the place of one that is not there, if all of them are there themselves.
    pub fn stands_in_for(&self, id: DrawableId) -> Option<Range<u32>> {
        let (first, pieces) = *self.stand_ins.get(&id).filter(|_| self.scene.has(id) == Ok(false))?;
        let level = first.0..first.0.saturating_add(pieces);
        let is_there = |id: u32| self.scene.has(DrawableId(id)) == Ok(true);
        (!level.is_empty() && level.clone().all(is_there)).then_some(level)
    }

    /// The newest one counts. A drawable that the scene lacks stands for nothing.
    fn stand_in(&mut self, level: (DrawableId, u32), drawables: &NumberList) {
        let id = level.0;
        let known = self.stand_ins.clone();
        let named = drawables.iter().map(DrawableId).filter(|drawable| drawable.0 < OUTLINE.drawables);
        if id.0 < OUTLINE.drawables {
            self.stand_ins.extend(named.map(|drawable| (drawable, level)));
        } else {
            for drawable in named {
                self.stand_ins.remove(&drawable);
            }
        }
        for drawable in (0..OUTLINE.drawables).map(DrawableId) {
            let expected = match drawables.iter().any(|named| named == drawable.0) {
                true => Some(&level).filter(|_| id.0 < OUTLINE.drawables),
                false => known.get(&drawable),
            };
            assert_eq!(self.stand_ins.get(&drawable), expected);
        }
    }

    fn entry(&mut self, entry: &DrawableEntry) {
        let known = self.scene.drawables().get(entry.id as usize).copied();
        let taken = self.scene.give(entry).is_ok();
        self.takes_all &= taken;
        let drawable = self.scene.drawables().get(entry.id as usize).copied();
        if !taken {
            assert_eq!(drawable, known, "what is refused changes no drawable");
            return;
        }
        let (Some(drawable), Some((_, node))) = (drawable, self.scene.part(DrawableId(entry.id))) else {
            unreachable!("{entry:?} was taken")
        };
        let first = drawable.level(DrawableId(entry.id)).first().0;
        assert_eq!((first, drawable.pieces.into()), (entry.level, entry.pieces));
        assert_eq!((drawable.node, drawable.geometry), (entry.node, entry.geometry));
        assert_eq!((drawable.triangles, drawable.sides), (entry.triangles, entry.sides));
        assert_eq!((node.world_min, node.world_max), (entry.world_min, entry.world_max));
        assert_eq!((node.origin, node.linear), (entry.origin, entry.linear));
        let objects = entry.objects & !DrawableEntry::SEE_THROUGH;
        assert_eq!((node.object, node.objects), (entry.object, objects));
    }

    fn part(&mut self, number: u32, length: u32, offset: u32, part: &[u8]) {
        let (known, whole, mut bytes) = self.arriving.take().unwrap_or((number, length, Vec::new()));
        let ends = bytes.len() + part.len();
        if (known, whole, bytes.len()) != (number, length, offset as usize) || ends > length as usize {
            self.takes_all = false;
            return;
        }
        bytes.extend(part);
        if ends < length as usize {
            self.arriving = Some((number, length, bytes));
            return;
        }
        let known = self.place(number);
        match self.scene.give_geometry(number, Bytes::copy_from_slice(&bytes)) {
            Ok(()) => {
                assert_eq!(self.scene.packed_geometry(number).ok(), Some(bytes));
                assert!(self.scene.geometry(number).is_ok_and(|geometry| geometry.check().is_none()));
            }
            Err(_) => {
                assert_eq!(self.place(number), known, "what is refused changes no piece");
                self.takes_all = false;
            }
        }
    }

    fn place(&self, number: u32) -> Option<GeometryPlace> {
        self.scene.places().get(number as usize).copied()
    }

    /// Every record that is there passes the rules, and what can be drawn has its triangles.
    fn is_sound(&self) {
        for id in (0..OUTLINE.drawables).map(DrawableId) {
            let (has, drawable) = (self.scene.has(id), self.scene.drawables().get(id.index()));
            let Some(drawable) = drawable else {
                assert_eq!(has, Ok(false));
                continue;
            };
            let Some((_, node)) = self.scene.part(id) else { unreachable!("{id} has no node") };
            let (low, high) = node.world_box();
            assert!(low.cmple(high).all() && low.is_finite() && high.is_finite());
            assert!(node.origin().is_finite() && node.linear().is_finite());
            assert!(node.object < OUTLINE.objects && drawable.geometry < OUTLINE.geometries);
            assert!(drawable.triangles > 0);
            if let Some(stand_in) = self.stands_in_for(id) {
                assert!(!stand_in.contains(&id.0));
                assert!(stand_in.map(DrawableId).all(|id| self.stands_in_for(id).is_none()));
            }
            if has == Ok(true) {
                let geometry = self.scene.geometry(drawable.geometry).ok();
                let triangles = geometry.map(|geometry| geometry.triangles());
                assert_eq!(triangles, Some(drawable.triangles as usize));
            }
        }
        for number in [OUTLINE.drawables, u32::MAX] {
            assert_eq!(self.scene.has(DrawableId(number)), Ok(false));
            assert_eq!(self.stands_in_for(DrawableId(number)), None);
        }
        assert!(self.stand_ins.len() <= OUTLINE.drawables as usize);
        assert!(self.ahead.len() <= OUTLINE.geometries as usize);
        assert!(self.scene.fault().is_none());
    }
}

/// To the bit: a number may be none.
fn packs_again(entries: &[DrawableEntry]) {
    let bits = |entries: &[DrawableEntry]| bytemuck::cast_slice::<_, u8>(entries).to_vec();
    let again = unpack_entries(&pack_entries(entries));
    assert_eq!(again.as_deref().map(bits), Ok(bits(entries)));
}
