//! Properties of any files at all. The fuzz targets search for files that break it; an ordinary test of
//! `trimaran` replays the corpus.

use trimaran::trace::Trace;
use trimaran_netsim::{Profile, Topology};
use trimaran_scene::heightfield::Tile;
use xxhash_rust::xxh3::xxh3_64;

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
