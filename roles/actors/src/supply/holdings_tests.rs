use trimaran_proto::put_item;
use trimaran_scene::{DrawableEntry, GeometryError, pack_entries};

use super::super::testing::{PLANT, geometry_of, list, unlike};
use super::*;

fn holdings(budget: u64) -> Holdings {
    Holdings::new(&Arc::new(Scene::empty(PLANT.outline())), budget)
}

fn entry(id: DrawableId) -> DrawableEntry {
    DrawableEntry::of(&PLANT, id).unwrap().unwrap()
}

fn packed(number: u32) -> Bytes {
    PLANT.packed_geometry(number).unwrap().into()
}

fn part(number: u32, length: u32, offset: u32, part: &[u8]) -> Supply {
    Supply::Geometry { number, length, offset, part: Bytes::copy_from_slice(part) }
}

fn whole(number: u32) -> Supply {
    let bytes = packed(number);
    part(number, bytes.len() as u32, 0, &bytes)
}

fn records(entries: &[DrawableEntry]) -> Supply {
    Supply::Entries { packed: pack_entries(entries).into() }
}

/// Takes the items as a block each, from one culler.
fn take(holdings: &Holdings, items: &[Supply]) -> Result<(), SupplyError> {
    let mut arriving = Arriving::default();
    items.iter().try_for_each(|item| {
        let mut block = Vec::new();
        assert!(put_item(&mut block, item));
        holdings.take(&block, &mut arriving)
    })
}

fn give(holdings: &Holdings, id: DrawableId) {
    take(holdings, &[records(&[entry(id)]), whole(geometry_of(id))]).unwrap();
}

#[test]
fn a_drawable_is_lacking_until_its_record_and_its_geometry_are_there() {
    let (holdings, [a, b]) = (holdings(1 << 20), [DrawableId(0), unlike(2)[1]]);
    let lacking = || holdings.lacking(&[a, b]).unwrap();
    assert_eq!(lacking(), [a, b]);
    take(&holdings, &[records(&[entry(a), entry(b)])]).unwrap();
    assert_eq!(lacking(), [a, b]);
    take(&holdings, &[whole(geometry_of(b))]).unwrap();
    assert_eq!(lacking(), [a]);
    take(&holdings, &[whole(geometry_of(a))]).unwrap();
    assert_eq!(lacking(), []);
    let [drawables, geometries] = holdings.all();
    assert_eq!(drawables, NumberList::of(vec![a.0, b.0]));
    assert_eq!(geometries, NumberList::of(vec![geometry_of(a), geometry_of(b)]));
}

#[test]
fn what_comes_once_more_counts_once() {
    let (holdings, id) = (holdings(1), DrawableId(0));
    give(&holdings, id);
    give(&holdings, id);
    let bytes = packed(geometry_of(id)).len() as u64;
    assert_eq!(holdings.inner.lock().bytes, bytes);
    assert_eq!(holdings.inner.lock().records, [id.0]);
    assert_eq!(holdings.trim(&[]), NumberList::of(vec![geometry_of(id)]));
    assert_eq!(holdings.inner.lock().bytes, 0);
}

#[test]
fn what_cannot_be_read_or_is_of_another_scene_is_refused() {
    let refused = holdings(1).take(&[0xff; 9], &mut Arriving::default());
    assert!(matches!(refused, Err(SupplyError::Block(_))), "{refused:?}");
    let refused = take(&holdings(1), &[Supply::Entries { packed: Bytes::from_static(b"\x02\0none") }]);
    assert!(matches!(refused, Err(SupplyError::Entries(EntriesError))), "{refused:?}");
    let count = PLANT.drawables().len() as u32;
    for (item, why) in [
        (
            records(&[DrawableEntry { id: count, ..entry(DrawableId(0)) }]),
            GiveError::Number { what: "drawable", number: count, count },
        ),
        (part(0, 3, 0, b"abc"), GiveError::Geometry { number: 0, cause: GeometryError::Length(3) }),
    ] {
        let refused = take(&holdings(1), &[item]);
        assert!(matches!(&refused, Err(SupplyError::Give(cause)) if *cause == why), "{refused:?}");
    }
}

#[test]
fn a_drawable_whose_triangles_are_not_those_of_its_geometry_cannot_be_shown() {
    let (holdings, id) = (holdings(1), DrawableId(0));
    let record = entry(id);
    let other = DrawableEntry { triangles: record.triangles + 1, ..record };
    take(&holdings, &[records(&[other]), whole(record.geometry)]).unwrap();
    assert_eq!(holdings.lacking(&[id]), Err(GiveError::Triangles(id)));
}

#[test]
fn parts_that_are_not_due_are_refused() {
    let bytes = packed(0);
    let length = bytes.len() as u32;
    let first = || part(0, length, 0, &bytes[..8]);
    for items in [
        vec![part(0, length, 8, &bytes[8..])],
        vec![first(), part(0, length, 9, &bytes[9..])],
        vec![first(), first()],
        vec![first(), part(0, length + 1, 8, &bytes[8..])],
        vec![first(), part(1, length, 8, &bytes[8..])],
        vec![part(0, 7, 0, &bytes[..8])],
        vec![first(), part(0, length, 8, &[&bytes[8..], b"more"].concat())],
    ] {
        let refused = take(&holdings(1), &items);
        assert!(matches!(refused, Err(SupplyError::Part(_))), "{items:?}: {refused:?}");
    }
}

#[test]
fn a_piece_in_parts_is_the_same_piece() {
    let (holdings, id) = (holdings(1 << 20), DrawableId(0));
    let bytes = packed(geometry_of(id));
    let (number, length) = (geometry_of(id), bytes.len() as u32);
    let [one, two] = [records(&[entry(id)]), records(&[entry(unlike(2)[1])])];
    let parts = [part(number, length, 0, &bytes[..8]), part(number, length, 8, &bytes[8..])];
    let [first, second] = parts;
    take(&holdings, &[one, first, two, second]).unwrap();
    assert_eq!(holdings.lacking(&[id]).unwrap(), []);
    assert_eq!(holdings.scene.geometry(number).unwrap(), PLANT.geometry(number).unwrap());
}

#[test]
fn a_piece_larger_than_any_is_refused_before_it_comes() {
    let refused = take(&holdings(1), &[part(0, LARGEST_PIECE + 1, 0, b"")]);
    assert!(matches!(refused, Err(SupplyError::Large { number: 0, length }) if length == LARGEST_PIECE + 1));
    take(&holdings(1), &[part(0, LARGEST_PIECE, 0, b"a")]).unwrap();
}

#[test]
fn what_was_not_used_for_the_longest_time_goes_first() {
    let ids = unlike(6);
    let size =
        |range: &[usize]| -> u64 { range.iter().map(|at| packed(geometry_of(ids[*at])).len() as u64).sum() };
    let holdings = holdings(size(&[0, 3, 5]));
    ids.iter().for_each(|id| give(&holdings, *id));
    for at in [4, 2, 1, 5, 0, 3] {
        holdings.used(&[ids[at]]);
    }
    let dropped = holdings.trim(&[]);
    assert_eq!(dropped, NumberList::of([4, 2, 1].map(|at| geometry_of(ids[at])).to_vec()));
    assert_eq!(holdings.lacking(&ids).unwrap(), [ids[1], ids[2], ids[4]]);
    assert_eq!(holdings.inner.lock().bytes, size(&[0, 3, 5]));
    assert_eq!(holdings.trim(&[]), NumberList::default(), "the rest is within the budget");
}

#[test]
fn what_the_due_frame_needs_stays_whatever_the_budget_is() {
    let (holdings, ids) = (holdings(1), unlike(6));
    ids.iter().for_each(|id| give(&holdings, *id));
    holdings.used(&ids[3..]);
    let due = &ids[..3];
    assert_eq!(holdings.trim(&[due]), NumberList::of(ids[3..].iter().map(|id| geometry_of(*id)).collect()));
    assert_eq!(holdings.lacking(&ids).unwrap(), ids[3..]);
    assert_eq!(holdings.trim(&[due]), NumberList::default());
    // Records stay.
    assert_eq!(holdings.all()[0], list(&ids));
    give(&holdings, ids[4]);
    assert_eq!(holdings.lacking(&[ids[4]]).unwrap(), []);
}

#[test]
fn there_is_no_room_beyond_the_slack_until_it_is_trimmed() {
    let (holdings, id) = (holdings(5), DrawableId(0));
    assert!(holdings.has_room());
    give(&holdings, id);
    assert!(holdings.has_room());
    holdings.inner.lock().bytes += SLACK;
    assert!(!holdings.has_room());
    // The due frame's geometry cannot be evicted, and more is accepted nevertheless.
    assert_eq!(holdings.trim(&[&[id]]), NumberList::default());
    assert!(holdings.has_room());
}

#[test]
fn what_came_ahead_is_counted_and_what_of_it_is_used() {
    let (holdings, ids) = (holdings(1), unlike(4));
    let [early, late, dropped, asked] = [0, 1, 2, 3].map(|place| geometry_of(ids[place]));
    let bytes = |number| packed(number).len() as u64;
    take(&holdings, &[records(&ids.iter().map(|id| entry(*id)).collect::<Vec<_>>()), whole(asked)]).unwrap();
    let geometries = NumberList::of(vec![early, late, dropped, asked]);
    take(&holdings, &[whole(early), Supply::Ahead { geometries: geometries.clone() }]).unwrap();
    assert_eq!(holdings.ahead_use(), AheadUse::default(), "what is there was not sent ahead now");
    take(&holdings, &[whole(late), whole(dropped)]).unwrap();
    let came = AheadUse { pieces: 2, bytes: bytes(late) + bytes(dropped), ..AheadUse::default() };
    assert_eq!(holdings.ahead_use(), came);
    holdings.used(&ids[..1]);
    assert_eq!(holdings.ahead_use(), came);
    holdings.used(&ids[..2]);
    let used = AheadUse { used_pieces: 1, used_bytes: bytes(late), ..came };
    assert_eq!(holdings.ahead_use(), used);
    holdings.used(&ids[..2]);
    assert_eq!(holdings.ahead_use(), used, "counted once");
    assert!(!holdings.trim(&[&ids[..1]]).is_empty());
    take(&holdings, &[whole(dropped)]).unwrap();
    holdings.used(&ids);
    assert_eq!(holdings.ahead_use(), used, "it was thrown away, and came again for a frame");
}

#[test]
fn something_stands_in_once_it_is_there_itself_and_only_where_all_have_something() {
    let (holdings, ids) = (holdings(1 << 30), unlike(4));
    let [coarse, fine, finer, other] = [0, 1, 2, 3].map(|place| ids[place]);
    let stands_in =
        |id, drawables: &[DrawableId]| Supply::StandIn { id, pieces: 1, drawables: list(drawables) };
    take(&holdings, &[stands_in(coarse, &[fine, finer])]).unwrap();
    assert_eq!(holdings.stand_ins(&[fine, finer]), Ok(None), "it has not come");
    take(&holdings, &[records(&[entry(coarse)])]).unwrap();
    assert_eq!(holdings.stand_ins(&[fine, finer]), Ok(None), "its geometry has not");
    take(&holdings, &[whole(geometry_of(coarse))]).unwrap();
    assert_eq!(holdings.stand_ins(&[fine, finer]), Ok(Some(vec![coarse])), "once for both");
    assert_eq!(holdings.stand_ins(&[fine, other]), Ok(None), "nothing stands in for the other one");
    take(&holdings, &[stands_in(other, &[fine])]).unwrap();
    assert_eq!(holdings.stand_ins(&[fine]), Ok(None), "the newest counts");
}

#[test]
fn a_level_in_pieces_stands_in_once_all_of_them_are_there() {
    let (holdings, ids) = (holdings(1 << 30), unlike(8));
    let [a, fine] = [ids[0], ids[7]];
    let pieces = [a, DrawableId(a.0 + 1)];
    let both = Supply::StandIn { id: a, pieces: 2, drawables: list(&[fine]) };
    take(&holdings, &[both, records(&pieces.map(entry)), whole(geometry_of(pieces[0]))]).unwrap();
    assert_ne!(geometry_of(pieces[0]), geometry_of(pieces[1]));
    assert_eq!(holdings.stand_ins(&[fine]), Ok(None), "one is lacking");
    take(&holdings, &[whole(geometry_of(pieces[1]))]).unwrap();
    assert_eq!(holdings.stand_ins(&[fine]), Ok(Some(pieces.to_vec())));
}
