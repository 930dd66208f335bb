//! Properties of any files at all. The fuzz targets search for files that break it; an ordinary test of
//! `trimaran` replays the corpus.

use std::{
    io::{Cursor, Write as _},
    sync::Arc,
};

use trimaran::{
    notes::{
        Frame,
        bcf::{BcfVersion, Imported, export, import},
    },
    page::finding::{Index, Query},
    trace::Trace,
};
use trimaran_netsim::{Profile, Topology};
use trimaran_scene::{Attribute, Extent, Group, Hierarchy, ObjectAttributes, heightfield::Tile};
use xxhash_rust::xxh3::xxh3_64;
use zip::{ZipWriter, write::SimpleFileOptions};

/// Any bytes, as a trace's contents behind a right head and before a right checksum, are refused or read; and
/// what was read is written and read again as the same trace. As a whole file they do no harm either.
pub fn traces(bytes: &[u8]) {
    let _refused = Trace::from_bytes(bytes);
    let Ok(trace) = Trace::from_bytes(&sealed(bytes)) else { return };
    for frame in trace.frames() {
        assert!(frame.ids.is_sorted_by(|a, b| a < b));
        let finds: Vec<_> = frame.finds().collect();
        assert!(finds.is_sorted() && finds.iter().all(|(_, at)| *at <= frame.hc), "{finds:?}");
        assert_eq!(finds.last().map_or(0, |(count, _)| *count), frame.ids.len());
    }
    // Compared as it is written: an epsilon that is not a number equals nothing.
    let written = trace.to_bytes().ok();
    let again = written.as_deref().and_then(|bytes| Trace::from_bytes(bytes).ok());
    assert_eq!(again.and_then(|again| again.to_bytes().ok()), written);
    assert!(written.is_some());
}

/// A trace's file with these contents: `docs/report.md` says what it looks like.
fn sealed(contents: &[u8]) -> Vec<u8> {
    let mut file = b"trimaran trace\n\x1a".to_vec();
    file.extend(Trace::VERSION.to_le_bytes());
    file.extend((contents.len() as u64).to_le_bytes());
    file.extend(contents);
    file.extend(xxh3_64(&file).to_le_bytes());
    file
}

/// Any text is a network to which hosts can be added, one with its own hosts, or is refused by errors that
/// can be read.
pub fn profiles(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match Profile::parse("any", text) {
        Ok(profile) => {
            let mut sites = profile.sites();
            let host = sites.far("host");
            assert_eq!(sites.topology.at(host.v4()), Some(host));
            assert!(profile.one_way_delay() >= profile.up.conditions.delay);
        }
        Err(refusal) => assert!(refusal.to_string().contains("any")),
    }
    if let Err(refusal) = Topology::parse("any", text) {
        assert!(refusal.to_string().contains("any"));
    }
}

/// Any bytes are a tile that is written as it was read, or none.
pub fn tiles(bytes: &[u8]) {
    let Some(tile) = Tile::from_bytes(bytes) else { return };
    assert_eq!(tile.to_bytes(), bytes);
    let spans: Vec<_> = tile.spans_at(f64::NAN, 1e300).collect();
    assert!(spans.iter().all(|[bottom, top]| bottom <= top), "{spans:?}");
}

/// Any text is a query, which finds parts that there are, or is wrong at a place between two letters.
pub fn queries(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let of = |name: &str, value: &str| vec![Attribute { name: name.into(), value: value.into() }];
    let group = |name: &str, parent, objects| Group {
        name: name.into(),
        parent,
        objects,
        attributes: of("size", "150 mm"),
        extent: Extent::default(),
    };
    let hierarchy = Hierarchy {
        groups: vec![group("ZONE-1", None, 0..3), group("valve", Some(0), 1..2)],
        attributes: vec![ObjectAttributes { object: 2, attributes: of("tag", "20-CE50") }],
    };
    let names = ["ZONE-1", "valve", "a", "BOX 1 of é", "c", "d"];
    let index = Index::new(&hierarchy, names[2..].iter()).unwrap();
    match Query::parse(text).and_then(|query| Ok((index.find(&query, &|| false)?, query))) {
        Ok((found, query)) => {
            let mut found = found.unwrap();
            let count = found.parts.len();
            index.rank(&query, &mut found, |part| names[part as usize]);
            assert_eq!(found.parts.len(), count);
            assert!(found.parts.iter().all(|part| *part < 6) && found.objects.len() <= 4, "{found:?}");
            assert_eq!(found.parts.is_empty(), found.objects.is_empty());
        }
        Err(wrong) => assert!(text.get(wrong.at.clone()).is_some(), "{wrong:?}"),
    }
}

/// Any bytes are no BCF file, or one whose notes are written and read again as the same. So are they as the
/// markup of a topic, with its viewpoint behind a zero.
pub fn bcf(bytes: &[u8]) {
    let frame = Frame::default();
    comes_back(import(bytes, &frame).unwrap_or_default(), &frame);
    let mut halves = bytes.splitn(2, |byte| *byte == 0);
    let [markup, viewpoint] = [halves.next(), halves.next()].map(Option::unwrap_or_default);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let version = b"<Version VersionId=\"2.1\"/>".as_slice();
    for (name, bytes) in [("bcf.version", version), ("t/markup.bcf", markup), ("t/viewpoint.bcfv", viewpoint)]
    {
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    let packed = zip.finish().unwrap().into_inner();
    comes_back(import(&packed, &frame).unwrap_or_default(), &frame);
}

fn comes_back(Imported { notes, .. }: Imported, frame: &Frame) {
    let notes: Vec<_> = notes.into_iter().map(|(note, _)| Arc::new(note)).collect();
    for version in [BcfVersion::V2, BcfVersion::V3] {
        let written = export(&notes, version, frame, &|_, _| None, &<[_]>::to_vec).unwrap();
        let again = import(&written, frame).unwrap();
        assert_eq!(again.notes.len(), notes.len());
        for note in &notes {
            let (back, _) = again.notes.iter().find(|(back, _)| back.guid == note.guid).unwrap();
            assert_eq!((&back.title, back.status), (&note.title, note.status));
            assert_eq!(back.replies, note.replies);
            let sections = |note: &trimaran::notes::Note| {
                note.views.iter().map(|view| view.sections.len()).sum::<usize>()
            };
            let has_cameras = note.views.iter().all(|view| view.camera.is_some());
            assert!(sections(back) == sections(note) || !has_cameras);
        }
    }
}
