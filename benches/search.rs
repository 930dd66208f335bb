//! The time of queries on a synthetic plant: a million objects in 101,000 groups, with 2.3 million
//! attributes.
//!
//! `cargo bench --bench search -- [OBJECTS]` prints the time to make the index, and its memory. For each
//! query it prints the median and the slowest of eleven tries on one thread.

#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

use std::{
    error::Error,
    time::{Duration, Instant},
};

use trimaran::page::finding::{Index, Query};
use trimaran_scene::{Attribute, Extent, Group, Hierarchy, ObjectAttributes};

const TRIES: usize = 11;
/// Objects in a group, and groups in a zone.
const PIECES: u32 = 10;
const ITEMS: u32 = 100;
const KINDS: [&str; 8] = ["PIPE", "ball valve", "gate valve", "elbow", "flange", "beam", "tray", "pump"];
const QUERIES: [&str; 12] = [
    "20 CE50",
    "\"20-CE50\"",
    "valve",
    "e",
    "nowhere",
    "name:box",
    "kind=\"ball valve\"",
    "size > 500 mm",
    "weight >= 12.5 kg",
    "status != new",
    "zone-12 and valve and not (size > 100 mm or status=removed)",
    "not (pipe or beam or tray)",
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1).filter(|word| !word.starts_with('-'));
    let objects: u32 = words.next().map_or(Ok(1_000_000), |word| word.parse())?;
    let hierarchy = plant(objects);
    let name = |object: u32| format!("BOX {} of /{}", object % PIECES + 1, tag(object / PIECES));
    let names: Vec<String> = (0..objects).map(name).collect();
    let begun = Instant::now();
    let index = Index::new(&hierarchy, names.iter())?;
    println!(
        "{objects} objects, {} groups: an index of {:.0} MB in {:.2} s",
        hierarchy.groups.len(),
        index.memory() as f64 / 1e6,
        begun.elapsed().as_secs_f64()
    );
    let name_of = |part: u32| {
        let object = (part as usize).checked_sub(hierarchy.groups.len());
        let group = || hierarchy.groups.get(part as usize).map_or("", |group| &*group.name);
        object.map_or_else(group, |object| names.get(object).map_or("", String::as_str))
    };
    println!("| query | parts | objects | ms, median | slowest |");
    println!("|---|---|---|---|---|");
    for text in QUERIES {
        let query = Query::parse(text)?;
        let mut times = Vec::new();
        let (mut parts, mut objects) = (0, 0);
        for _ in 0..TRIES {
            let begun = Instant::now();
            let mut found = index.find(&query, &|| false)?.unwrap_or_default();
            index.rank(&query, &mut found, name_of);
            times.push(begun.elapsed());
            (parts, objects) = (found.parts.len(), found.objects.len());
        }
        times.sort();
        let ms = |time: Option<&Duration>| time.map_or(0.0, Duration::as_secs_f64) * 1e3;
        let (median, slowest) = (ms(times.get(TRIES / 2)), ms(times.last()));
        println!("| `{text}` | {parts} | {objects} | {median:.1} | {slowest:.1} |");
    }
    Ok(())
}

/// Zones of a hundred tagged items of ten objects each.
fn plant(objects: u32) -> Hierarchy {
    let (items, zones) = (objects.div_ceil(PIECES), objects.div_ceil(PIECES * ITEMS));
    let mut groups = Vec::new();
    for zone in 0..zones {
        let parent = Some(groups.len() as u32);
        let span = |from: u32, to: u32| from * PIECES..(to * PIECES).min(objects);
        let last = items.min((zone + 1) * ITEMS);
        groups.push(group(format!("/ZONE-{zone}"), None, span(zone * ITEMS, last), Vec::new()));
        for item in zone * ITEMS..last {
            let of = vec![
                attribute("Kind", KINDS[item as usize % KINDS.len()].to_owned()),
                attribute("Size", format!("{} mm", 15 + item % 67 * 10)),
                attribute("Status", if item % 5 == 0 { "new" } else { "removed" }.to_owned()),
            ];
            groups.push(group(format!("/{}", tag(item)), parent, span(item, item + 1), of));
        }
    }
    let own = |object| ObjectAttributes {
        object,
        attributes: vec![
            attribute("Ref", format!("={}/{}", 16_000 + object % 997, object)),
            attribute("Weight", format!("{}.{} kg", object % 5000, object % 10)),
        ],
    };
    Hierarchy { groups, attributes: (0..objects).map(own).collect() }
}

fn tag(item: u32) -> String {
    format!("{}-CE{}-{:04}", 10 + item % 40, item / 40 % 100, item / 4000)
}

fn group(
    name: String,
    parent: Option<u32>,
    objects: std::ops::Range<u32>,
    attributes: Vec<Attribute>,
) -> Group {
    Group { name: name.into(), parent, objects, attributes, extent: Extent::default() }
}

fn attribute(name: &str, value: String) -> Attribute {
    Attribute { name: name.into(), value: value.into() }
}
