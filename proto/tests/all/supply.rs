//! Blocks of the bulk lane: the fuzz target's inputs, how they are made, and the layout in WIRE.md.
//!
//! After a change of the format, make the inputs anew:
//! `cargo test -p trimaran-proto --test all supply:: -- --ignored`.

#[path = "../../../fuzz/replay.rs"]
#[allow(unreachable_pub, reason = "tests of other packages share the file")]
mod replay;
#[path = "../../../fuzz/src/supply.rs"]
#[allow(unreachable_pub, reason = "the fuzz targets' library shares the file")]
mod target;

use std::fs;
use std::mem::{offset_of, size_of};
use std::path::Path;

use bytes::Bytes;
use target::{Display, OUTLINE};
use trimaran_proto::{Demand, DrawableId, FrameNumber, NumberList, SceneOutline, Supply, items, put_item};
use trimaran_scene::{
    DrawableEntry, Geometry, MOST_ENTRIES, Rgba8, Sides, Vertex, pack_entries, unpack_entries,
};

const TARGETS: [replay::Target; 1] = [("supply", FILES.len(), target::supply)];

#[test]
fn the_fuzz_corpus_does_no_harm() {
    replay::replay(&TARGETS);
}

#[test]
fn broken_inputs_of_the_corpus_do_no_harm() {
    replay::replay_broken(&TARGETS, 1000, 1);
    replay::replay_broken(&TARGETS, 500, 3);
}

/// The outcome of a block. A culler's items are accepted or partly refused. Drawables can be drawn, stand in
/// for others or mismatch their geometry; or prefetched pieces become known.
fn outcome(block: &[u8]) -> &'static str {
    let Ok(items) = items::<Supply>(block) else {
        return if items::<Demand>(block).is_ok() { "demands" } else { "unread" };
    };
    let mut display = Display::default();
    items.into_iter().for_each(|item| display.take(item));
    let has: Vec<_> = (0..OUTLINE.drawables).map(|id| display.scene.has(DrawableId(id))).collect();
    match display.takes_all {
        false => "refused",
        true if has.iter().any(Result::is_err) => "apart",
        true if (0..OUTLINE.drawables).any(|id| display.stands_in_for(DrawableId(id)).is_some()) => {
            "stands-in"
        }
        true if has.contains(&Ok(true)) => "drawn",
        true if !display.ahead.is_empty() => "ahead",
        true => "taken",
    }
}

/// Makes a block.
type Make = fn() -> Vec<u8>;

/// Each input and its outcome.
const FILES: [(&str, &str, Make); 65] = [
    ("nothing", "taken", Vec::new),
    ("begin-and-holds", "demands", || block(&[begin(false, 0), holds()])),
    ("begin-with-coarser-first", "demands", || block(&[holds(), begin(true, 0)])),
    ("begin-with-bytes-ahead", "demands", || block(&[begin(false, 64 << 20)])),
    ("begin-with-both", "demands", || block(&[begin(true, u64::MAX)])),
    ("begin-that-is-records-of-one-byte-as-well", "refused", || block(&[begin(true, 0)])),
    ("begin-with-a-flag-that-is-none", "unread", || vec![0, 2, 0]),
    ("begin-with-a-flag-alone", "unread", || vec![0, 1]),
    ("begin-with-more-than-64-bits-ahead", "unread", || [&[0, 0][..], &[0xff; 9], &[2]].concat()),
    ("lacks", "demands", || block(&[lacks(numbers([2, 258]))])),
    ("dropped", "demands", || block(&[Demand::Dropped { geometries: numbers([0, 3]) }])),
    ("taken-and-shown", "demands", || {
        block(&[Demand::Taken { bytes: u64::MAX }, Demand::Shown { frame: FrameNumber(u32::MAX) }])
    }),
    ("end-and-begin", "demands", || block(&[Demand::End, begin(false, 0), Demand::End])),
    ("all-numbers-that-fit", "demands", || {
        let gap = u32::MAX / NumberList::MOST as u32;
        block(&[lacks(NumberList::of((0..NumberList::MOST as u32).map(|number| number * gap).collect()))])
    }),
    ("more-numbers-than-an-item-is-parted-to", "demands", || {
        block(&[lacks(NumberList::of((0..NumberList::MOST as u32 + 1).map(|number| 5 * number).collect()))])
    }),
    ("the-largest-number", "demands", || vec![4, 5, 0xff, 0xff, 0xff, 0xff, 0x0f]),
    ("a-number-above-the-largest", "unread", || vec![4, 6, 0xff, 0xff, 0xff, 0xff, 0x0f, 0]),
    ("a-number-of-40-bits", "unread", || vec![4, 6, 0xff, 0xff, 0xff, 0xff, 0xff, 0x0f]),
    ("a-number-longer-than-it-must-be", "demands", || vec![4, 2, 0x80, 0]),
    ("a-number-without-end", "unread", || vec![4, 1, 0x80]),
    ("a-list-longer-than-the-block", "unread", || vec![4, 9, 1, 1]),
    ("a-demand-of-another-kind", "unread", || [block(&[begin(false, 0)]), vec![7]].concat()),
    ("a-supply-of-another-kind", "unread", || [whole_piece(), vec![4, 0]].concat()),
    ("demands-behind-a-supply", "unread", || [whole_piece(), block(&[Demand::End])].concat()),
    ("cut-within-an-item", "unread", || whole_piece()[..20].to_vec()),
    ("one-drawable", "drawn", || block(&[entries(&[entry(0)]), piece(0, &square(1))])),
    ("the-piece-before-the-record", "drawn", || block(&[piece(0, &square(1)), entries(&[entry(0)])])),
    ("all-drawables", "drawn", || {
        let records: Vec<_> = (0..OUTLINE.drawables).map(entry).collect();
        let pieces = (0..OUTLINE.geometries).map(|number| piece(number, &square(1)));
        block(&[vec![entries(&records)], pieces.collect()].concat())
    }),
    ("a-record-twice", "taken", || block(&[entries(&[entry(3), entry(3)]), entries(&[entry(3)])])),
    ("no-records", "taken", || block(&[entries(&[])])),
    ("a-piece-in-parts", "drawn", || {
        let parts = parts(1, &packed(&square(9)), 50);
        block(&[vec![entries(&[DrawableEntry { triangles: 162, ..entry(1) }])], parts].concat())
    }),
    ("records-between-parts", "taken", || {
        let mut items = parts(1, &packed(&square(9)), 100);
        items.insert(1, entries(&[entry(0)]));
        block(&items)
    }),
    ("a-stand-in-that-is-there", "stands-in", || {
        block(&[stand_in(6, numbers([0, 1])), entries(&[entry(6)]), piece(2, &square(1))])
    }),
    ("a-stand-in-that-was-there-before", "stands-in", || {
        block(&[entries(&[entry(6)]), piece(2, &square(1)), stand_in(6, numbers([0, 1]))])
    }),
    ("a-stand-in-for-what-has-come", "drawn", || {
        let pieces = [piece(2, &square(1)), piece(0, &square(1))];
        let first = [stand_in(6, numbers([0])), entries(&[entry(6), entry(0)])];
        block(&[first, pieces].concat())
    }),
    ("a-stand-in-that-never-comes", "taken", || block(&[stand_in(6, numbers([0])), entries(&[entry(0)])])),
    ("a-stand-in-after-another-one", "drawn", || {
        let named = [stand_in(6, numbers([0, 1])), stand_in(7, numbers([0, 1]))];
        block(&[&named[..], &[entries(&[entry(6)]), piece(2, &square(1))]].concat())
    }),
    ("a-stand-in-for-itself", "drawn", || {
        block(&[stand_in(0, numbers([0])), entries(&[entry(0)]), piece(0, &square(1))])
    }),
    ("a-stand-in-for-none", "taken", || block(&[stand_in(0, numbers([]))])),
    ("a-stand-in-beyond-the-scene", "drawn", || {
        let named = [6, OUTLINE.drawables, u32::MAX].map(|id| stand_in(id, numbers([0])));
        block(&[&named[..], &[entries(&[entry(6)]), piece(2, &square(1))]].concat())
    }),
    ("a-stand-in-for-what-is-beyond-the-scene", "drawn", || {
        let beyond = stand_in(6, numbers([OUTLINE.drawables, u32::MAX]));
        block(&[beyond, entries(&[entry(6)]), piece(2, &square(1))])
    }),
    ("a-stand-in-for-all-numbers-that-fit", "taken", || {
        let gap = u32::MAX / NumberList::MOST as u32;
        let all = (0..NumberList::MOST as u32).map(|number| number * gap);
        block(&[stand_in(u32::MAX, NumberList::of(all.collect()))])
    }),
    ("a-stand-in-for-a-number-above-the-largest", "unread", || {
        vec![2, 6, 6, 0xff, 0xff, 0xff, 0xff, 0x0f, 0]
    }),
    ("pieces-ahead-of-their-records", "ahead", || {
        block(&[ahead(numbers([0, 3])), piece(0, &square(1)), piece(3, &square(1))])
    }),
    ("a-piece-ahead-that-is-drawn-then", "drawn", || {
        block(&[piece(0, &square(1)), ahead(numbers([0])), entries(&[entry(0)])])
    }),
    ("pieces-ahead-beyond-the-scene", "taken", || {
        block(&[ahead(numbers([OUTLINE.geometries, u32::MAX])), ahead(numbers([]))])
    }),
    ("other-items-between-parts", "ahead", || {
        let mut items = parts(1, &packed(&square(9)), 100);
        items.insert(1, stand_in(1, numbers([0])));
        items.insert(3, ahead(numbers([1])));
        block(&items)
    }),
    ("another-number-of-triangles", "apart", || block(&[entries(&[entry(0)]), piece(0, &square(2))])),
    ("a-part-of-another-piece-between", "refused", || {
        let mut items = parts(1, &packed(&square(9)), 100);
        items.insert(1, piece(2, &square(1)));
        block(&items)
    }),
    ("a-part-left-out", "refused", || {
        let mut items = parts(1, &packed(&square(9)), 50);
        items.remove(1);
        block(&items)
    }),
    ("a-part-beyond-the-piece", "refused", || block(&[part(0, 3, 0, &[1; 4])])),
    ("a-part-from-the-largest-offset", "refused", || block(&[part(0, u32::MAX, u32::MAX, &[1])])),
    ("the-first-byte-of-the-largest-piece", "taken", || block(&[part(0, u32::MAX, 0, &[1])])),
    ("a-piece-of-nothing", "refused", || block(&[part(0, 0, 0, &[])])),
    ("a-piece-of-more-than-its-bytes", "refused", || {
        let mut bytes = packed(&square(1));
        bytes[..8].fill(0xff);
        block(&[part(0, bytes.len() as u32, 0, &bytes)])
    }),
    ("a-piece-beyond-the-scene", "refused", || block(&[piece(OUTLINE.geometries, &square(1))])),
    ("numbers-beyond-the-scene", "refused", || {
        let SceneOutline { nodes, drawables, geometries, objects, .. } = OUTLINE;
        let beyond = [
            DrawableEntry { id: drawables, ..entry(0) },
            DrawableEntry { node: nodes, ..entry(1) },
            DrawableEntry { geometry: geometries, ..entry(2) },
            DrawableEntry { object: objects, ..entry(3) },
        ];
        block(&[entries(&beyond)])
    }),
    ("numbers-that-are-none", "refused", || {
        let mut linear = entry(0).linear;
        linear[4] = f32::NAN;
        let none = [
            DrawableEntry { world_max: [f64::INFINITY; 3], ..entry(0) },
            DrawableEntry { origin: [0.0, f64::NAN, 0.0], ..entry(1) },
            DrawableEntry { linear, ..entry(2) },
        ];
        block(&[entries(&none)])
    }),
    ("a-box-inside-out", "refused", || {
        block(&[entries(&[DrawableEntry { world_min: [0.0, 2.0, 0.0], ..entry(0) }])])
    }),
    ("unknown-sides-and-no-triangles", "refused", || {
        let sides: Sides = bytemuck::cast(1_u32 << 24);
        block(&[entries(&[DrawableEntry { sides, ..entry(0) }, DrawableEntry { triangles: 0, ..entry(1) }])])
    }),
    ("pieces-of-no-level", "refused", || {
        let none = [
            DrawableEntry { level: 1, ..entry(0) },
            DrawableEntry { pieces: 0, ..entry(1) },
            DrawableEntry { level: 0, pieces: 2, ..entry(2) },
            DrawableEntry { pieces: 1 << 16, ..entry(3) },
        ];
        block(&[entries(&none)])
    }),
    ("a-drawable-and-a-node-that-change", "refused", || {
        let changed = [
            DrawableEntry { triangles: 3, ..entry(0) },
            DrawableEntry { objects: 2, ..entry(0) },
            DrawableEntry { node: 5, ..entry(0) },
        ];
        block(&[entries(&[entry(0)]), entries(&changed)])
    }),
    ("more-records-than-are-packed-together", "refused", || {
        let size = (MOST_ENTRIES as u32 + 1) * size_of::<DrawableEntry>() as u32;
        block(&[Supply::Entries { packed: frame(257, size, &[(size, 0)]) }])
    }),
    ("records-that-unpack-to-far-more-than-their-bytes", "refused", || {
        let blocks = vec![(128 << 10, 7); 1000];
        block(&[Supply::Entries { packed: frame(1, 128_000 << 10, &blocks) }])
    }),
    ("fewer-records-than-it-says", "refused", || {
        block(&[Supply::Entries { packed: frame(3, 2 * 144, &[(2 * 144, 0)]) }])
    }),
];

#[test]
fn the_inputs_of_the_corpus_are_what_their_names_say() {
    let corpus = replay::corpus("supply");
    let names: Vec<&str> = corpus.iter().map(|(name, _)| name.as_str()).collect();
    let mut expected = FILES.map(|(name, ..)| name);
    expected.sort_unstable();
    assert_eq!(names, expected);
    for (name, expected, _) in FILES {
        let input = &corpus.iter().find(|(known, _)| known == name).unwrap().1;
        assert_eq!(outcome(input), expected, "{name}");
    }
}

/// Each of them alone, where an input has several.
#[test]
fn each_record_that_breaks_a_rule_is_refused() {
    let mut refused = 0;
    for (name, expected, make) in FILES {
        let Ok(all) = items::<Supply>(&make()) else { continue };
        let records = all.iter().filter_map(|item| match item {
            Supply::Entries { packed } => unpack_entries(packed).ok(),
            _ => None,
        });
        let records = records.flatten().filter(|record| *record != entry(record.id));
        for record in records.filter(|_| expected == "refused") {
            let first = if name.ends_with("change") { vec![entry(0)] } else { Vec::new() };
            let block = block(&[entries(&first), entries(&[record])]);
            assert_eq!(outcome(&block), "refused", "{name}: {record:?}");
            refused += 1;
        }
    }
    assert_eq!(refused, 17);
}

#[test]
#[ignore = "writes the files"]
fn the_inputs_of_the_corpus_are_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/supply");
    drop(fs::remove_dir_all(&folder));
    fs::create_dir(&folder).unwrap();
    for (name, _, make) in FILES {
        fs::write(folder.join(name), make()).unwrap();
    }
}

#[test]
fn a_record_has_its_numbers_where_the_page_says() {
    let wire = include_str!("../../WIRE.md");
    let row = |line: &'static str| {
        let cells: Vec<&str> = line.split('|').skip(1).map(str::trim).collect();
        (cells[0].parse().unwrap(), cells[1].parse().unwrap(), cells[2])
    };
    let table = wire.split_once("| offset | bytes | name | what |\n").unwrap().1;
    let rows: Vec<(usize, usize, &str)> =
        table.lines().skip(1).take_while(|line| line.starts_with('|')).map(row).collect();
    macro_rules! offsets {
        ($($name:ident)*) => { [$((offset_of!(DrawableEntry, $name), stringify!($name))),*] };
    }
    let offsets = offsets!(world_min world_max origin linear id node geometry triangles sides
        object objects level pieces);
    assert_eq!(rows.iter().map(|(offset, _, name)| (*offset, *name)).collect::<Vec<_>>(), offsets);
    let ends = rows.iter().map(|(offset, bytes, _)| offset + bytes);
    assert!(ends.eq(offsets.iter().map(|(offset, _)| *offset).skip(1).chain([size_of::<DrawableEntry>()])));
    assert!(wire.contains(&format!("how many records, u16, {MOST_ENTRIES} at most")));
}

/// Follows the three steps of WIRE.md, with a zstd frame that leaves the columns as they are.
#[test]
fn records_are_packed_as_the_page_says() {
    let records = [entry(2), entry(7), DrawableEntry { object: 0, ..entry(1) }, entry(4)];
    let mut rows = records.map(|record| bytemuck::bytes_of(&record).to_vec());
    let word = |row: &[u8], at: usize| u32::from_le_bytes(row[at..at + 4].try_into().unwrap());
    for at in [108, 112, 116, 128, 136] {
        for index in (1..rows.len()).rev() {
            let change = word(&rows[index], at).wrapping_sub(word(&rows[index - 1], at));
            rows[index][at..at + 4].copy_from_slice(&change.to_le_bytes());
        }
    }
    let columns: Vec<u8> = (0..144).flat_map(|column| rows.iter().map(move |row| row[column])).collect();
    let length = columns.len() as u32;
    let packed = [&[4, 0], &head(length)[..], &block_head(true, 0, length), &columns].concat();
    assert_eq!(unpack_entries(&packed).as_deref(), Ok(&records[..]));
}

fn numbers<const N: usize>(numbers: [u32; N]) -> NumberList {
    NumberList::of(numbers.into())
}

fn holds() -> Demand {
    Demand::Holds { drawables: numbers([4, 5, 134]), geometries: numbers([7]) }
}

fn begin(coarser_first: bool, ahead: u64) -> Demand {
    Demand::Begin { coarser_first, ahead }
}

fn lacks(drawables: NumberList) -> Demand {
    Demand::Lacks { frame: FrameNumber(9), taken: 300, drawables }
}

fn block(items: &[impl serde::Serialize]) -> Vec<u8> {
    let mut block = Vec::new();
    assert!(items.iter().all(|item| put_item(&mut block, item)));
    block
}

/// A record of the scene of the outline.
fn entry(id: u32) -> DrawableEntry {
    let node = id % OUTLINE.nodes;
    let at = f64::from(node);
    DrawableEntry {
        world_min: [at; 3],
        world_max: [at + 1.0; 3],
        origin: [at + 0.5; 3],
        linear: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        id,
        node,
        geometry: id % OUTLINE.geometries,
        triangles: 2,
        sides: if id.is_multiple_of(2) { Sides::BOTH } else { Sides::FRONT },
        object: node % OUTLINE.objects,
        objects: 1,
        level: id,
        pieces: 1,
    }
}

fn entries(records: &[DrawableEntry]) -> Supply {
    Supply::Entries { packed: pack_entries(records).into() }
}

fn stand_in(id: u32, drawables: NumberList) -> Supply {
    Supply::StandIn { id: DrawableId(id), pieces: 1, drawables }
}

fn ahead(geometries: NumberList) -> Supply {
    Supply::Ahead { geometries }
}

/// A square of `2 * n * n` triangles that is not flat.
fn square(n: u32) -> Geometry {
    let corner = |index: u32| {
        let (x, y) = ((index % (n + 1)) as f32, (index / (n + 1)) as f32);
        Vertex::new([x, y, x * y / 7.0], Rgba8([200, index as u8, 50, 255]))
    };
    let triangles = |index: u32| {
        let a = index % n + index / n * (n + 1);
        [a, a + 1, a + n + 2, a, a + n + 2, a + n + 1]
    };
    Geometry {
        vertices: (0..(n + 1) * (n + 1)).map(corner).collect(),
        indices: (0..n * n).flat_map(triangles).collect(),
    }
}

fn packed(geometry: &Geometry) -> Vec<u8> {
    geometry.pack().unwrap()
}

fn part(number: u32, length: u32, offset: u32, part: &[u8]) -> Supply {
    Supply::Geometry { number, length, offset, part: Bytes::copy_from_slice(part) }
}

fn parts(number: u32, bytes: &[u8], size: usize) -> Vec<Supply> {
    let chunks = bytes.chunks(size).enumerate();
    chunks.map(|(index, chunk)| part(number, bytes.len() as u32, (index * size) as u32, chunk)).collect()
}

fn piece(number: u32, geometry: &Geometry) -> Supply {
    let bytes = packed(geometry);
    part(number, bytes.len() as u32, 0, &bytes)
}

fn whole_piece() -> Vec<u8> {
    block(&[piece(0, &square(1))])
}

/// The header of a zstd frame that says how long its content is (RFC 8878).
fn head(length: u32) -> Vec<u8> {
    [&[0x28, 0xb5, 0x2f, 0xfd, 0xa0][..], &length.to_le_bytes()].concat()
}

/// The header of a zstd block: raw bytes (kind 0), or one repeated byte (kind 1).
fn block_head(last: bool, kind: u32, length: u32) -> [u8; 3] {
    let [a, b, c, _] = (u32::from(last) | kind << 1 | length << 3).to_le_bytes();
    [a, b, c]
}

/// Packed records with this count, in a zstd frame of this stated length, made of repeated bytes.
fn frame(count: u16, length: u32, blocks: &[(u32, u8)]) -> Bytes {
    let mut packed = [&count.to_le_bytes()[..], &head(length)].concat();
    for (index, (times, byte)) in blocks.iter().enumerate() {
        packed.extend(block_head(index + 1 == blocks.len(), 1, *times));
        packed.push(*byte);
    }
    packed.into()
}
