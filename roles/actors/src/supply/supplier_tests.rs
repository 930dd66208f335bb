use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::LazyLock;

use glam::{DVec3, Mat3, Vec3};
use proptest::prelude::*;
use trimaran_cull::lod_cut;
use trimaran_proto::{LodRule, Settings, items};
use trimaran_scene::{FlatObject, Rgba8, SceneArrays, random::Random, unpack_entries};

use super::super::{
    holdings::{Arriving, Holdings},
    testing::{PLANT, geometry_of, list, outside, unlike, view, view_at},
};
use super::*;

const NOW: Instant = Instant::from_nanos(0);

/// Two leaves of random triangles: each piece is larger than a few blocks.
static LARGE: LazyLock<Arc<Scene>> = LazyLock::new(|| {
    let mut random = Random::new(1);
    let mut noise = || FlatObject {
        // The first two corners make the boxes of both equal: the pieces come by number.
        positions: [Vec3::ZERO, Vec3::ONE]
            .into_iter()
            .chain((2..6_000).map(|_| random.point(DVec3::ZERO, DVec3::ONE).as_vec3()))
            .collect(),
        indices: (0..6_000).collect(),
        colour: Rgba8([9; 4]),
        linear: Mat3::IDENTITY,
        origin: DVec3::ZERO,
    };
    Arc::new(Scene::from_arrays(SceneArrays::flat(&[noise(), noise()])).unwrap())
});

fn ids(numbers: impl IntoIterator<Item = u32>) -> Vec<DrawableId> {
    numbers.into_iter().map(DrawableId).collect()
}

fn geometries_of(ids: &[DrawableId]) -> BTreeSet<u32> {
    ids.iter().map(|id| geometry_of(*id)).collect()
}

/// A supplier, and a display that takes each block as soon as it comes.
struct Pair {
    supplier: Supplier,
    taken: u64,
}

/// The received numbers of records and of pieces, in their order.
#[derive(Debug, Default, PartialEq, Eq)]
struct Came {
    records: Vec<u32>,
    pieces: Vec<u32>,
}

impl Pair {
    fn new(scene: &Arc<Scene>) -> Self {
        let mut new = Self { supplier: Supplier::new(scene, &Packed::default()), taken: 0 };
        new.hear(Demand::Begin { coarser_first: false, ahead: 0 });
        new
    }

    fn hear(&mut self, demand: Demand) {
        self.supplier.hear(demand, NOW).unwrap();
    }

    fn block(&mut self) -> Option<Vec<Supply>> {
        let block = self.supplier.next_block(NOW).unwrap()?;
        assert!(block.len() <= MAX_BLOCK);
        self.taken += block.len() as u64;
        Some(items(&block).unwrap())
    }

    /// All items that it sends.
    fn items(&mut self) -> Vec<Supply> {
        let mut all = Vec::new();
        while let Some(block) = self.block() {
            all.extend(block);
            self.hear(Demand::Taken { bytes: self.taken });
        }
        all
    }

    fn came(&mut self) -> Came {
        came(&self.items())
    }

    fn lacks(&mut self, frame: u32, taken: u64, ids: &[DrawableId]) {
        self.hear(Demand::Lacks { frame: FrameNumber(frame), taken, drawables: list(ids) });
    }
}

fn came(items: &[Supply]) -> Came {
    let mut came = Came::default();
    for item in items {
        match item {
            Supply::Entries { packed } => {
                came.records.extend(unpack_entries(packed).unwrap().iter().map(|entry| entry.id));
            }
            Supply::Geometry { number, length, offset, part } => {
                if *offset as usize + part.len() == *length as usize {
                    came.pieces.push(*number);
                }
            }
            Supply::StandIn { .. } | Supply::Ahead { .. } => {}
            item => panic!("{item:?}"),
        }
    }
    came
}

/// In any order, the records of these and the geometry of those came.
fn assert_came(came: &Came, records: &[DrawableId], pieces: &[DrawableId]) {
    let sorted = |numbers: &[u32]| {
        let mut sorted = numbers.to_vec();
        sorted.sort_unstable();
        sorted
    };
    assert_eq!(sorted(&came.records), records.iter().map(|id| id.0).collect::<Vec<_>>());
    assert_eq!(sorted(&came.pieces), Vec::from_iter(geometries_of(pieces)));
}

#[test]
fn what_was_found_is_sent_once_and_records_come_before_their_geometry() {
    let (mut pair, ids) = (Pair::new(&PLANT), ids(0..300));
    pair.supplier.found(&view(0), &ids, NOW);
    let items = pair.items();
    let all = came(&items);
    assert_came(&all, &ids, &ids);
    // A piece's purpose is known when it comes.
    for (end, item) in items.iter().enumerate() {
        if let Supply::Geometry { number, .. } = item {
            let before = came(&items[..end]).records;
            let is_needed = |id: &u32| geometry_of(DrawableId(*id)) == *number;
            assert!(before.iter().any(is_needed), "piece {number} came before all records that need it");
        }
    }
    pair.supplier.found(&view(1), &ids, NOW);
    assert_eq!(pair.came(), Came::default(), "all of it was sent");
}

#[test]
fn what_is_largest_on_the_screen_comes_first() {
    let (mut pair, mut ids) = (Pair::new(&PLANT), unlike(200));
    pair.supplier.found(&view(0), &ids, NOW);
    let size = |id: &DrawableId| {
        let (_, part) = PLANT.part(*id).unwrap();
        let (min, max) = part.world_box();
        (max - min).length_squared() / part.distance_squared(view(0).eye()).max(1e-6)
    };
    ids.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.cmp(b)));
    assert!(size(&ids[0]) > 10.0 * size(&ids[199]));
    let due: Vec<_> = ids.iter().map(|id| geometry_of(*id)).collect();
    assert_eq!(pair.came().pieces, due);
}

#[test]
fn what_stands_in_comes_before_what_it_stands_in_for() {
    let rule = LodRule::new(2.0).unwrap();
    let view = view_at(outside(), 0.0, 0, 2048);
    let cut = lod_cut(&PLANT, &view, rule);
    let mut pair = Pair { supplier: Supplier::new(&PLANT, &Packed::default()), taken: 0 };
    pair.supplier.change_view(&Settings::new(view.viewport(), rule).into());
    pair.hear(Demand::Begin { coarser_first: true, ahead: 0 });
    pair.supplier.found(&view, &cut, NOW);
    let items = pair.items();
    let stand_ins: BTreeMap<u32, Range<u32>> = items.iter().filter_map(stands_in).flatten().collect();
    assert!(stand_ins.len() * 2 > cut.len(), "{} of {}", stand_ins.len(), cut.len());
    let due: BTreeSet<_> = geometries_of(&cut);
    let instead = |id: &DrawableId| stand_ins.get(&id.0).cloned().unwrap_or(id.0..id.0 + 1);
    let mut missing: BTreeSet<_> =
        cut.iter().flat_map(instead).map(|id| geometry_of(DrawableId(id))).collect();
    let first = missing.len();
    for number in came(&items).pieces {
        let is_first = missing.remove(&number);
        assert!(is_first || missing.is_empty(), "{number} came before all that is shown first");
        assert!(is_first || due.contains(&number));
    }
    assert!(missing.is_empty() && first * 2 < due.len(), "{first} of {} pieces come first", due.len());
    let came = came(&items);
    assert!(cut.iter().all(|id| came.records.contains(&id.0)), "all of it comes in the end");
}

/// A camera in steady motion.
#[test]
fn what_a_moving_camera_is_about_to_need_comes_when_nothing_else_is_due_and_within_the_budget() {
    let rule = LodRule::new(0.3).unwrap();
    let seen = |frame: u32, distance: f64| view_at(distance, 0.0, frame, 512);
    // Drawables outside the cuts.
    let cuts: BTreeSet<_> =
        (20..=40).flat_map(|distance| lod_cut(&PLANT, &seen(0, distance.into()), rule)).collect();
    let all = (0..PLANT.drawables().len() as u32).map(DrawableId);
    let others: Vec<_> = all.filter(|id| !cuts.contains(id)).take(10).collect();
    let sent_ahead = |budget| {
        let mut pair = Pair { supplier: Supplier::new(&PLANT, &Packed::default()), taken: 0 };
        pair.supplier.change_view(&Settings::new(seen(0, 0.0).viewport(), rule).into());
        pair.hear(Demand::Begin { coarser_first: false, ahead: budget });
        let (mut before, mut last) = (Vec::new(), Vec::new());
        for frame in 0..4 {
            let view = seen(frame, 40.0 - f64::from(frame));
            let now = NOW.after(std::time::Duration::from_millis(50) * frame);
            pair.supplier.found(&view, &lod_cut(&PLANT, &view, rule), now);
            if frame == 3 {
                pair.supplier.found(&view, &others, now);
            }
            before.append(&mut last);
            last = pair.items();
        }
        (before, last)
    };
    let (before, items) = sent_ahead(u64::MAX);
    let first = items.iter().position(|item| matches!(item, Supply::Ahead { .. })).unwrap();
    let due = came(&items[..first]);
    assert!(items.iter().skip(first).all(|item| !matches!(item, Supply::StandIn { .. })));
    assert!(others.iter().all(|id| due.records.contains(&id.0)), "what is due comes first");
    let named: BTreeSet<_> = items.iter().filter_map(ahead).flatten().collect();
    let pieces: BTreeSet<_> = came(&items[first..]).pieces.into_iter().collect();
    assert_eq!(named, pieces, "each is named");
    assert!(pieces.len() > 10, "{} pieces", pieces.len());

    let bytes = |(before, last): &(Vec<Supply>, Vec<Supply>)| -> u64 {
        let numbers = before.iter().chain(last).filter_map(ahead).flatten();
        numbers.map(|number| u64::from(PLANT.places()[number as usize].length)).sum()
    };
    let all = bytes(&(before, items));
    let some = bytes(&sent_ahead(all / 4));
    let largest = PLANT.places().iter().map(|place| u64::from(place.length)).max().unwrap();
    assert!((all / 4..all / 4 + largest).contains(&some), "{some} of {all} bytes");
    assert_eq!(bytes(&sent_ahead(0)), 0);
}

/// The pieces announced as sent ahead of need.
fn ahead(item: &Supply) -> Option<Vec<u32>> {
    match item {
        Supply::Ahead { geometries } => Some(geometries.iter().collect()),
        _ => None,
    }
}

/// The drawables for which it stands in.
fn stands_in(item: &Supply) -> Option<Vec<(u32, Range<u32>)>> {
    match item {
        Supply::StandIn { id, pieces, drawables } => {
            Some(drawables.iter().map(|finer| (finer, id.0..id.0 + pieces)).collect())
        }
        _ => None,
    }
}

#[test]
fn instances_share_their_geometry() {
    let mut by_geometry = BTreeMap::<u32, Vec<DrawableId>>::new();
    for id in ids(0..PLANT.drawables().len() as u32) {
        by_geometry.entry(geometry_of(id)).or_default().push(id);
    }
    let (geometry, instances) = by_geometry.iter().max_by_key(|(_, ids)| ids.len()).unwrap();
    assert!(instances.len() > 2);
    let mut pair = Pair::new(&PLANT);
    pair.supplier.found(&view(0), &instances[1..], NOW);
    let first = pair.came();
    assert_eq!((first.records.len(), first.pieces), (instances.len() - 1, vec![*geometry]));
    pair.supplier.found(&view(1), instances, NOW);
    assert_eq!(pair.came(), Came { records: vec![instances[0].0], pieces: vec![] });
}

#[test]
fn nothing_is_sent_before_the_display_asks() {
    let mut supplier = Supplier::new(&PLANT, &Packed::default());
    supplier.found(&view(0), &ids(0..9), NOW);
    assert_eq!(supplier.next_block(NOW).unwrap(), None);
    supplier.hear(Demand::Begin { coarser_first: false, ahead: 0 }, NOW).unwrap();
    assert!(supplier.next_block(NOW).unwrap().is_some());
}

/// The first camera may overtake the request.
#[test]
fn what_the_newest_frame_before_the_request_found_is_sent_but_what_the_display_holds() {
    let all = unlike(30);
    let mut pair = Pair { supplier: Supplier::new(&PLANT, &Packed::default()), taken: 0 };
    pair.supplier.found(&view(0), &all[..10], NOW);
    pair.supplier.found(&view(1), &all[10..20], NOW);
    pair.supplier.found(&view(1), &all[20..], NOW);
    let geometries = NumberList::of(geometries_of(&all[20..]).into_iter().collect());
    pair.hear(Demand::Holds { drawables: list(&all[20..]), geometries });
    assert_eq!(pair.came(), Came::default());
    pair.hear(Demand::Begin { coarser_first: false, ahead: 0 });
    assert_came(&pair.came(), &all[10..20], &all[10..20]);
}

#[test]
fn what_the_display_holds_is_not_sent() {
    let (mut pair, all) = (Pair::new(&PLANT), unlike(90));
    let (whole, rest) = all.split_at(30);
    let (records, others) = rest.split_at(30);
    pair.hear(Demand::Holds {
        drawables: list(&[whole, records].concat()),
        geometries: NumberList::of(geometries_of(whole).into_iter().collect()),
    });
    pair.supplier.found(&view(0), &all, NOW);
    assert_came(&pair.came(), others, rest);
}

#[test]
fn what_is_under_way_is_not_sent_again_where_it_is_lacked() {
    let (mut pair, few) = (Pair::new(&PLANT), unlike(40));
    pair.supplier.found(&view(0), &few, NOW);
    let first = pair.block().unwrap();
    let taken = pair.taken;
    let rest: Vec<_> = std::iter::from_fn(|| pair.block()).flatten().collect();
    let begun = came(&first);
    let sent = came(&[first, rest].concat());
    assert_eq!((sent.records.len(), sent.pieces.len()), (40, 40), "the window holds all of it");
    let split =
        |id: &&DrawableId| begun.records.contains(&id.0) && !begun.pieces.contains(&geometry_of(**id));
    let last = few.iter().find(split).expect("a record in the first block, its geometry behind it");
    pair.lacks(0, 0, &few);
    assert_eq!(pair.block(), None);
    pair.lacks(0, taken, &[*last]);
    assert_eq!(pair.block(), None, "its record was taken, and its geometry is on its way");
}

#[test]
fn what_was_taken_and_is_lacked_is_sent_again() {
    let (mut pair, few) = (Pair::new(&PLANT), unlike(5));
    pair.supplier.found(&view(0), &few, NOW);
    let first = pair.came();
    pair.lacks(1, pair.taken, &few);
    assert_eq!(pair.came(), first);
}

#[test]
fn what_other_cullers_found_is_sent_where_it_is_lacked() {
    let (mut pair, few) = (Pair::new(&PLANT), unlike(5));
    pair.lacks(3, 0, &few);
    assert_came(&pair.came(), &few, &few);
}

#[test]
fn what_was_dropped_is_sent_again_when_it_is_found_again() {
    let (mut pair, few) = (Pair::new(&PLANT), unlike(5));
    pair.supplier.found(&view(0), &few, NOW);
    pair.came();
    let dropped = geometry_of(few[2]);
    pair.hear(Demand::Dropped { geometries: NumberList::of(vec![dropped]) });
    assert_eq!(pair.came(), Came::default(), "nobody needs it now");
    pair.supplier.found(&view(1), &few, NOW);
    assert_eq!(pair.came(), Came { records: vec![], pieces: vec![dropped] });
}

#[test]
fn what_only_frames_that_were_shown_needed_is_not_sent() {
    let (mut pair, all) = (Pair::new(&PLANT), unlike(30));
    pair.supplier.found(&view(3), &all[..20], NOW);
    pair.supplier.found(&view(5), &all[10..], NOW);
    pair.hear(Demand::Shown { frame: FrameNumber(3) });
    assert_came(&pair.came(), &all[10..], &all[10..]);
    pair.supplier.found(&view(3), &all[..10], NOW);
    assert_eq!(pair.came(), Came::default());
    pair.hear(Demand::Shown { frame: FrameNumber(1) });
    pair.supplier.found(&view(2), &all[..10], NOW);
    assert_eq!(pair.came(), Came::default(), "frames are shown in order");
    pair.supplier.found(&view(6), &all[..10], NOW);
    assert_eq!(pair.came().records.len(), 10);
}

#[test]
fn frames_of_a_leader_are_in_other_numbers_than_those_that_were_shown() {
    let (mut pair, all) = (Pair::new(&PLANT), unlike(30));
    pair.hear(Demand::Shown { frame: FrameNumber(9) });
    pair.supplier.change_following(true);
    pair.supplier.found(&view(3), &all[..20], NOW);
    pair.hear(Demand::Shown { frame: FrameNumber(50) });
    assert_came(&pair.came(), &all[..20], &all[..20]);
    pair.supplier.change_following(false);
    pair.supplier.found(&view(9), &all[20..25], NOW);
    assert_eq!(pair.came(), Came::default());
    pair.supplier.found(&view(10), &all[25..], NOW);
    assert_came(&pair.came(), &all[25..], &all[25..]);
}

/// The parts of a piece come together, in order.
fn assert_parts_are_in_order(items: &[Supply]) {
    let mut open: Option<(u32, u32)> = None;
    for item in items {
        let Supply::Geometry { number, length, offset, part } = item else { continue };
        let due = open.unwrap_or((*number, 0));
        assert_eq!((*number, *offset), due);
        let end = offset + part.len() as u32;
        open = (end < *length).then_some((*number, end));
    }
    assert_eq!(open, None);
}

#[test]
fn a_piece_larger_than_a_block_comes_in_parts_in_order() {
    let mut pair = Pair::new(&LARGE);
    pair.supplier.found(&view(0), &ids([0, 1]), NOW);
    let items = pair.items();
    assert_parts_are_in_order(&items);
    for number in [0, 1] {
        let whole = LARGE.packed_geometry(number).unwrap();
        assert!(whole.len() > 2 * MAX_BLOCK);
        let parts: Vec<_> = items
            .iter()
            .filter_map(|item| match item {
                Supply::Geometry { number: of, part, .. } if *of == number => Some(&part[..]),
                _ => None,
            })
            .collect();
        assert!(parts.len() > 2);
        assert_eq!(parts.concat(), whole);
    }
}

#[test]
fn behind_the_rest_of_a_piece_nothing_comes_until_the_display_begins_anew() {
    for begins in [false, true] {
        let mut pair = Pair::new(&LARGE);
        pair.supplier.found(&view(0), &ids([0, 1]), NOW);
        let mut items = pair.block().unwrap();
        pair.hear(Demand::End);
        if begins {
            // Another culler supplies the display.
            pair.supplier.found(&view(1), &ids([0, 1]), NOW);
            pair.hear(Demand::Begin { coarser_first: false, ahead: 0 });
        }
        pair.hear(Demand::Taken { bytes: pair.taken });
        if begins {
            pair.supplier.found(&view(2), &ids([0, 1]), NOW);
        }
        items.extend(pair.items());
        assert_parts_are_in_order(&items);
        let all = came(&items);
        // The piece that had begun, and then both.
        assert_eq!(all.pieces, if begins { vec![0, 0, 1] } else { vec![0] });
        assert!(!begins || all.records == [0, 1, 0, 1], "{all:?}");
    }
}

#[test]
fn a_full_window_gives_no_block_until_some_was_taken() {
    let mut pair = Pair::new(&LARGE);
    pair.supplier.found(&view(0), &ids([0, 1]), NOW);
    let mut before = 0;
    while let Some(sent) = Some(pair.taken).filter(|_| pair.block().is_some()) {
        before = sent;
    }
    assert!(before < 64 << 10 && pair.taken >= 64 << 10, "64 KiB at first: {before}, {}", pair.taken);
    pair.hear(Demand::Taken { bytes: 1 });
    assert!(pair.block().is_none(), "the first block is still under way");
    pair.hear(Demand::Taken { bytes: pair.taken });
    assert!(pair.block().is_some());
}

#[test]
fn a_culler_passes_over_drawables_that_no_scene_has() {
    let mut pair = Pair::new(&PLANT);
    let none = ids([PLANT.drawables().len() as u32, u32::MAX]);
    pair.supplier.found(&view(0), &none, NOW);
    assert_eq!(pair.came(), Came::default());
}

/// A display's message about numbers that the scene lacks, or bytes that it was not sent, is an error, and
/// changes nothing.
#[test]
fn a_display_names_nothing_that_the_scene_lacks() {
    let (drawables, geometries) = (PLANT.drawables().len() as u32, PLANT.places().len() as u32);
    let numbers = |number| NumberList::of(vec![0, number]);
    let none = NumberList::default;
    let frame = FrameNumber(1);
    for demand in [
        Demand::Holds { drawables: numbers(drawables), geometries: none() },
        Demand::Holds { drawables: none(), geometries: numbers(geometries) },
        Demand::Holds { drawables: none(), geometries: numbers(u32::MAX) },
        Demand::Lacks { frame, taken: 0, drawables: numbers(drawables) },
        Demand::Lacks { frame, taken: 0, drawables: numbers(u32::MAX) },
        Demand::Dropped { geometries: numbers(geometries) },
    ] {
        let mut pair = Pair::new(&PLANT);
        let refused = pair.supplier.hear(demand.clone(), NOW);
        assert!(matches!(refused, Err(SupplyFault::Unknown { .. })), "{demand:?}: {refused:?}");
        pair.supplier.found(&view(0), &ids([0]), NOW);
        assert!(pair.came().records.contains(&0), "{demand:?} counts for nothing");
    }
    for demand in [Demand::Taken { bytes: 1 }, Demand::Lacks { frame, taken: 1, drawables: none() }] {
        let refused = Pair::new(&PLANT).supplier.hear(demand, NOW);
        assert!(matches!(refused, Err(SupplyFault::NotSent)), "{refused:?}");
    }
}

/// A step of supplying a display.
#[derive(Debug, Clone)]
enum Step {
    /// The culler finds these in the next frame.
    Finds(Vec<u32>),
    /// A frame of another culler is whole at the display.
    Whole(Vec<u32>),
    /// The display evicts geometry that its first frame does not need.
    Trims,
    /// The display shows its first frame, if all of it is there.
    Shows,
    /// The culler sends a block.
    Sends,
    /// A block arrives.
    Arrives,
    /// The display's message arrives.
    Heard,
}

fn any_step() -> impl Strategy<Value = Step> {
    let some = || prop::collection::vec(0..120_u32, 1..40);
    prop_oneof![
        2 => some().prop_map(Step::Finds),
        2 => some().prop_map(Step::Whole),
        1 => Just(Step::Trims),
        2 => Just(Step::Shows),
        4 => Just(Step::Sends),
        4 => Just(Step::Arrives),
        4 => Just(Step::Heard),
    ]
}

/// A display with a budget of one byte, a culler, and the messages in flight between them.
struct World {
    supplier: Supplier,
    empty: Arc<Scene>,
    holdings: Holdings,
    arriving: Arriving,
    blocks: VecDeque<Bytes>,
    demands: VecDeque<Demand>,
    taken: u64,
    next: u32,
    /// Frames that were not shown, and the drawables of each. Found ones are not whole yet.
    frames: BTreeMap<u32, (Vec<DrawableId>, bool)>,
    has_trimmed: bool,
}

impl World {
    fn new(coarser_first: bool) -> Self {
        let mut supplier = Supplier::new(&PLANT, &Packed::default());
        supplier.change_view(&Settings::new(view(0).viewport(), LodRule::new(1.0).unwrap()).into());
        let empty = Arc::new(Scene::empty(PLANT.outline()));
        Self {
            supplier,
            holdings: Holdings::new(&empty, 1),
            empty,
            arriving: Arriving::default(),
            blocks: VecDeque::new(),
            demands: VecDeque::from([Demand::Begin { coarser_first, ahead: 0 }]),
            taken: 0,
            next: 0,
            frames: BTreeMap::new(),
            has_trimmed: false,
        }
    }

    fn lacking(&self, ids: &[DrawableId]) -> Vec<DrawableId> {
        self.holdings.lacking(ids).unwrap()
    }

    /// Like a session when a frame is whole, and after an eviction.
    fn ask(&mut self, frame: u32) {
        let lacking = self.lacking(&self.frames[&frame].0);
        if !lacking.is_empty() {
            let (frame, taken, drawables) = (FrameNumber(frame), self.taken, list(&lacking));
            self.demands.push_back(Demand::Lacks { frame, taken, drawables });
        }
    }

    fn step(&mut self, step: Step) {
        match step {
            Step::Finds(numbers) => {
                let ids = ids(numbers);
                self.supplier.found(&view(self.next), &ids, NOW);
                if self.supplier.has_begun {
                    self.frames.insert(self.next, (ids, false));
                    self.next += 1;
                }
            }
            Step::Whole(numbers) => {
                self.frames.insert(self.next, (ids(numbers), true));
                self.ask(self.next);
                self.next += 1;
            }
            Step::Trims => {
                let Some((due, _)) = self.frames.values().next() else { return };
                let before = self.lacking(due);
                let dropped = self.holdings.trim(&[due]);
                assert_eq!(self.lacking(due), before, "the first frame loses nothing");
                if dropped.is_empty() {
                    return;
                }
                self.has_trimmed = true;
                self.demands.push_back(Demand::Dropped { geometries: dropped });
                let whole = self.frames.iter().filter(|(_, (_, whole))| *whole);
                for frame in whole.map(|(frame, _)| *frame).collect::<Vec<_>>() {
                    self.ask(frame);
                }
            }
            Step::Shows => {
                let first = self.frames.first_key_value();
                let there = first.filter(|(_, (ids, whole))| *whole && self.lacking(ids).is_empty());
                if let Some(frame) = there.map(|(frame, _)| *frame) {
                    self.frames.remove(&frame);
                    self.demands.push_back(Demand::Shown { frame: FrameNumber(frame) });
                }
            }
            Step::Sends => self.blocks.extend(self.supplier.next_block(NOW).unwrap()),
            Step::Arrives => {
                if let Some(block) = self.blocks.pop_front() {
                    self.holdings.take(&block, &mut self.arriving).unwrap();
                    self.taken += block.len() as u64;
                    self.demands.push_back(Demand::Taken { bytes: self.taken });
                }
            }
            Step::Heard => {
                if let Some(demand) = self.demands.pop_front() {
                    self.supplier.hear(demand, NOW).unwrap();
                }
            }
        }
    }

    /// Until nothing is in flight any more.
    fn drain(&mut self) {
        loop {
            self.step(Step::Sends);
            if self.demands.is_empty() && self.blocks.is_empty() {
                return;
            }
            self.step(Step::Arrives);
            self.step(Step::Heard);
        }
    }

    fn assert_all_is_there(&self) {
        for (frame, (ids, _)) in &self.frames {
            assert_eq!(self.lacking(ids), [], "frame {frame}");
            for id in ids {
                let (ours, theirs) = (&self.empty.drawables()[id.index()], &PLANT.drawables()[id.index()]);
                assert_eq!((ours.geometry, ours.node), (theirs.geometry, theirs.node));
                let number = ours.geometry;
                assert_eq!(self.empty.geometry(number).unwrap(), PLANT.geometry(number).unwrap());
            }
        }
    }
}

proptest! {
    #[test]
    fn all_that_frames_need_is_there_in_the_end(
        steps in prop::collection::vec(any_step(), 1..120),
        coarser_first in any::<bool>(),
    ) {
        let mut world = World::new(coarser_first);
        steps.into_iter().for_each(|step| world.step(step));
        if world.has_trimmed {
            // Geometry evicted before a frame was whole is requested then.
            for frame in world.frames.keys().copied().collect::<Vec<_>>() {
                world.ask(frame);
            }
        }
        world.drain();
        world.assert_all_is_there();
    }
}
