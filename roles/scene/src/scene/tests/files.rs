//! Whole files: saved, opened, cut, and damaged.

use super::super::file::write_atomically;
use super::*;

#[test]
fn a_saved_scene_opens_as_it_was() {
    for arrays in [two_leaves(), tree()] {
        let (folder, path, _) = saved(arrays.clone());
        let before = Scene::from_arrays(arrays.clone()).unwrap();
        let after = Scene::open(&path).unwrap();
        assert_eq!(after.check().map_err(|error| error.to_string()), Ok(()));
        // Node and object records have computed fields.
        assert_eq!(after.nodes(), before.nodes());
        let plain = |node: &Node| Node { reach: 0.0, objects: 0, depth: 0, ..*node };
        assert!(after.nodes().iter().map(plain).eq(arrays.nodes.iter().map(plain)));
        assert_eq!(after.objects(), before.objects());
        let plain = |object: &ObjectRecord| ObjectRecord { node: 0, ..*object };
        assert!(after.objects().iter().map(plain).eq(arrays.objects.iter().map(plain)));
        assert_eq!(after.drawables().to_vec(), arrays.drawables);
        assert_eq!(after.places(), before.places());
        let mut reader = after.reader();
        for (number, geometry) in arrays.geometries.iter().enumerate().rev() {
            assert_eq!(&reader.read(number as u32).unwrap(), geometry, "{number}");
        }
        for (index, object) in (0..).zip(&arrays.objects) {
            assert_eq!(after.object_name(index), arrays.name_of(object));
        }
        assert_eq!(after.sources(), arrays.sources);
        assert_eq!(after.hash(), before.hash());
        assert_eq!(after.totals(), before.totals());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}

#[test]
fn coordinates_are_in_the_newest_format_and_the_usual_ones_in_the_one_before() {
    let version = |bytes: &[u8]| u32::from_le_bytes(*bytes[8..].first_chunk().unwrap());
    let (_folder, path, bytes) = saved(two_leaves());
    assert_eq!(version(&bytes), *FORMAT_VERSIONS.start());
    assert_eq!(Scene::open(&path).unwrap().coordinates().unwrap(), Coordinates::default());
    // Files that are like glTF say nothing new.
    let usual = Coordinates { files: vec![FileFrame::default()], ..Coordinates::default() };
    assert!(encoded(SceneArrays { coordinates: usual, ..two_leaves() }) == encoded(two_leaves()));

    let arrays = SceneArrays { coordinates: elsewhere(), ..two_leaves() };
    let (_folder, path, bytes) = saved(arrays.clone());
    assert_eq!(version(&bytes), *FORMAT_VERSIONS.end());
    let scene = Scene::open(&path).unwrap();
    scene.check().unwrap();
    assert_eq!(scene.coordinates().unwrap(), elsewhere());
    assert_eq!(scene.geometry(0).unwrap(), arrays.geometries[0]);
    // An overview stands behind them.
    let with_overview = Scene::from_arrays(arrays).unwrap().with_overview();
    with_overview.check().unwrap();
    assert_eq!(with_overview.coordinates().unwrap(), elsewhere());
    // A display over a link has none.
    assert_eq!(Scene::empty(scene.outline()).coordinates().unwrap(), Coordinates::default());
}

#[test]
fn damaged_or_senseless_coordinates_are_an_error_once_they_are_asked_for() {
    let file = || Apart::of(SceneArrays { coordinates: elsewhere(), ..two_leaves() });
    let mut damaged = file();
    let page = damaged.number(Section::Coordinates, 0);
    let range = damaged.range(Section::Coordinates, 0);
    let mut senseless = file();
    let mut bytes = senseless.records::<u8>(Section::Coordinates, 0);
    bytes[..8].fill(0xff);
    senseless.replace(Section::Coordinates, 0, &bytes);
    damaged.pages[page][3] ^= 1;
    damaged.lay_out();
    // Its hash is still that of the right bytes.
    damaged.header.seal(&damaged.directory);
    let directory = bytemuck::cast_slice(&damaged.directory);
    let damaged = [bytemuck::bytes_of(&damaged.header), &damaged.pages.concat(), directory].concat();
    for bytes in [damaged, senseless.bytes()] {
        let scene = opened(&bytes).unwrap();
        let error = scene.coordinates().unwrap_err();
        assert!(matches!(error.cause, ReadCause::Damaged), "{error}");
        assert_eq!((error.bytes.start, error.what.as_str()), (range.start, "coordinates"));
        assert_eq!(scene.check().unwrap_err().what, "coordinates");
        assert!(scene.fault().is_none(), "nothing else is wrong");
    }
}

#[test]
fn an_older_scene_is_replaced_whole_while_it_is_open() {
    let (_folder, path, _) = saved(two_leaves());
    let old = Scene::open(&path).unwrap();
    let mut arrays = two_leaves();
    arrays.geometries[0].vertices[1].position[0] = 0.5;
    Scene::from_arrays(arrays).unwrap().save(&path).unwrap();
    let x = |scene: &Scene| scene.geometry(0).unwrap().vertices[1].position[0];
    assert_eq!(x(&old), 1.0);
    assert_eq!(x(&Scene::open(&path).unwrap()), 0.5);
}

#[test]
fn the_same_arrays_make_the_same_bytes_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| saved(tree()).2)
    };
    let bytes = on(1);
    assert!(bytes == on(4));
    assert!(bytes == encoded(tree()), "what is saved is what was encoded");
    // Saved again by the process that opened it.
    let (_folder, path, _) = saved(two_leaves());
    opened(&bytes).unwrap().save(&path).unwrap();
    assert!(std::fs::read(&path).unwrap() == bytes);
}

#[test]
fn the_fingerprint_changes_with_every_record_vertex_and_name() {
    type Change = fn(&mut SceneArrays);
    let changes: [Change; 15] = [
        |_| (),
        |a| a.nodes[2].world_min[2] = -0.0,
        |a| a.nodes[1].linear[4] = 0.5,
        |a| a.drawables[0].error = 0.75,
        |a| a.drawables[1].sides = Sides::BOTH,
        |a| a.geometries[0].vertices[2].position[1] = 0.5,
        |a| a.geometries[0].vertices[2].colour = Rgba8([9, 8, 7, 254]),
        |a| a.geometries[0].vertices[0].normal = Normal([1, 2]),
        |a| a.geometries[0].indices = vec![1, 2, 0],
        |a| a.geometries.push(triangle()),
        |a| a.objects[0].source_index = 5,
        |a| a.names = "Röhry".to_owned(),
        |a| a.sources[0].push('x'),
        |a| a.coordinates.plant.origin[1] = 0.001,
        |a| a.coordinates = elsewhere(),
    ];
    let hashes: Vec<_> = changes
        .iter()
        .map(|change| {
            let mut arrays = two_leaves();
            change(&mut arrays);
            Scene::from_arrays(arrays).unwrap().hash()
        })
        .collect();
    for (index, hash) in hashes.iter().enumerate() {
        assert_eq!(hashes.iter().position(|other| other == hash), Some(index), "change {index} shows");
    }
    assert_eq!(hashes[0], Scene::from_arrays(two_leaves()).unwrap().hash());
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let (_folder, path, bytes) = saved(two_leaves());
    for length in 0..bytes.len() {
        std::fs::write(&path, &bytes[..length]).unwrap();
        match Scene::open(&path) {
            Err(OpenError::Truncated { actual, .. }) if actual == length as u64 => {}
            other => panic!("cut to {length}: {other:?}"),
        }
    }
    std::fs::write(&path, [&bytes[..], b"x"].concat()).unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("longer than it was when written"), "{message}");
}

/// Every byte is covered: the header's by itself, the directory's by the fingerprint, and each page's by the
/// directory.
#[test]
fn a_flipped_bit_anywhere_is_refused_or_is_a_fault_where_it_is() {
    let bytes = encoded(two_leaves());
    let pages = size_of::<Header>()..Apart::new(&bytes).header.directory as usize;
    let (mut at_open, mut later) = (0, 0);
    for index in 0..bytes.len() {
        for bit in [0x01, 0x10, 0x80] {
            let mut broken = bytes.clone();
            broken[index] ^= bit;
            match opened(&broken) {
                Err(OpenError::Foreign { .. }) => assert!(index < 8),
                Err(OpenError::Version { .. }) => assert!((8..12).contains(&index)),
                Err(OpenError::Damaged { .. }) => assert!(!pages.contains(&index), "byte {index}"),
                Err(OpenError::Read(fault)) => {
                    assert!(matches!(fault.cause, ReadCause::Damaged), "byte {index}: {fault}");
                    assert!(fault.bytes.contains(&(index as u64)), "byte {index}: {fault}");
                    at_open += 1;
                }
                Err(other) => panic!("byte {index}: {other}"),
                Ok(scene) => {
                    let fault = scene.check().unwrap_err();
                    assert!(matches!(fault.cause, ReadCause::Damaged), "byte {index}: {fault}");
                    assert!(fault.bytes.contains(&(index as u64)), "byte {index}: {fault}");
                    later += 1;
                }
            }
        }
    }
    assert_eq!(at_open + later, 3 * pages.len());
    // Opening a small scene reads nodes, drawables, places, and the sources.
    let file = Apart::new(&bytes);
    let lazy = [Section::Objects, Section::Names, Section::Hierarchy, Section::Geometry]
        .map(|section| file.range(section, 0));
    assert_eq!(later, 3 * lazy.iter().map(|range| (range.end - range.start) as usize).sum::<usize>());
}

#[test]
fn foreign_and_newer_files_are_told_apart() {
    let (_folder, path, bytes) = saved(two_leaves());
    let of_version = |version: u8| [&bytes[..8], &[version], &bytes[9..]].concat();
    for (bytes, parts) in [
        (of_version(200), ["format 200", "use a newer build"]),
        (of_version(1), ["format 1,", "import again with this build"]),
        (b"glTF, not a scene".to_vec(), ["is not a cooked scene"; 2]),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let message = Scene::open(&path).unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    let message = Scene::open(&path.with_extension("none")).unwrap_err().to_string();
    assert!(message.contains("cannot read"), "{message}");
}

#[test]
fn a_well_written_file_of_a_malformed_scene_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.scene");
    let mut arrays = two_leaves();
    arrays.drawables[2].geometry = 1;
    std::fs::write(&path, encoded(arrays)).unwrap();
    match Scene::open(&path) {
        Err(OpenError::Read(ReadError {
            cause: ReadCause::Malformed(SceneError::Malformed { what: "drawable", index: 2, .. }),
            path: named,
            ..
        })) => assert_eq!(named, path),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_directory_that_does_not_go_with_the_header_is_refused() {
    type Change = fn(&mut Apart);
    let changes: [(Change, &str); 15] = [
        (|f| f.header.nodes = 4, "does not go with"),
        (|f| f.header.nodes = u32::MAX, "does not go with"),
        (|f| f.header.drawables = 0, "does not go with"),
        (|f| f.header.geometries = 1025, "does not go with"),
        (|f| f.header.objects = u32::MAX, "does not go with"),
        (|f| f.header.names = u64::MAX, "does not go with"),
        (|f| f.header.overviews = 2, "does not go with"),
        (|f| f.header.overviews = u32::MAX, "does not go with"),
        (|f| f.directory[0].unpacked -= 1, "does not go with"),
        (|f| f.directory[0].firsts.child = 0, "does not go with"),
        (|f| f.directory[1].offset = f.directory[0].offset, "does not go with"),
        (|f| f.directory[1].offset = u64::MAX, "does not go with"),
        (|f| f.directory[6].length = u32::MAX, "does not go with"),
        (|f| f.header.pages -= 1, "directory does not end it"),
        (|f| f.header.directory = u64::MAX, "directory does not end it"),
    ];
    for (number, (change, expected)) in changes.into_iter().enumerate() {
        let mut file = Apart::of(two_leaves());
        file.lay_out();
        change(&mut file);
        match opened(&file.seal()) {
            Err(OpenError::Damaged { what, .. }) => assert!(what.contains(expected), "{number}: {what}"),
            other => panic!("{number}: {other:?}"),
        }
    }
    let mut file = Apart::of(tree());
    file.entry(Section::Nodes, 3).firsts.child = 2;
    let refused = opened(&file.bytes()).unwrap_err().to_string();
    assert!(refused.contains("does not go with"), "{refused}");
}

#[test]
fn a_damaged_overview_is_refused_and_all_else_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.scene");
    Scene::from_arrays(two_leaves()).unwrap().with_overview().save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    opened(&bytes).unwrap().check().unwrap();
    let mut file = Apart::new(&bytes);
    file.replace(Section::Overview, 0, &[0; 7]);
    file.entry(Section::Overview, 0).unpacked = 7;
    let scene = opened(&file.bytes()).unwrap();
    assert!(scene.geometry(0).is_ok());
    let refused = scene.overview().unwrap_err().to_string();
    assert!(refused.contains("overview"), "{refused}");
    assert!(matches!(scene.check(), Err(ReadError { cause: ReadCause::Damaged, .. })));
}

#[test]
fn a_page_that_unpacks_to_more_or_less_than_it_says_is_damaged() {
    let names = |unpacked: &[u8], says: u32| {
        let mut file = Apart::of(two_leaves());
        file.replace(Section::Names, 0, unpacked);
        file.entry(Section::Names, 0).unpacked = says;
        file.header.names = u64::from(says);
        file.lay_out();
        let range = file.range(Section::Names, 0);
        let scene = opened(&file.bytes()).unwrap();
        match scene.check() {
            Ok(()) => true,
            Err(ReadError { bytes, what, cause: ReadCause::Damaged, .. }) => {
                assert_eq!((bytes, what.as_str()), (range, "names"));
                assert_eq!(scene.object_name(0), None);
                assert!(scene.fault().is_some());
                false
            }
            Err(other) => panic!("{other}"),
        }
    };
    let right = "Röhrz".as_bytes();
    assert!(names(right, 6));
    assert!(!names(right, 7));
    assert!(!names(&[right, b"x"].concat(), 6));
    assert!(!names(b"R\xffhrzz", 6), "no UTF-8");
    // Two gigabytes out of a few bytes: such memory is not allocated.
    assert!(!names(right, 1 << 31));
    // Sixteen megabytes out of about a thousand bytes, were they unpacked.
    assert!(!names(&[b'x'; 1 << 24], 1 << 24));
}

#[test]
fn sources_that_are_no_list_are_refused_at_open() {
    let mut file = Apart::of(two_leaves());
    file.edit(Section::Sources, 0, |bytes: &mut [u8]| bytes[0] = 6);
    match opened(&file.bytes()) {
        Err(OpenError::Read(ReadError { what, cause: ReadCause::Damaged, .. })) => {
            assert_eq!(what, "names of sources");
        }
        other => panic!("{other:?}"),
    }
}

/// zstd packs all-equal names very tightly.
#[test]
fn names_that_are_all_alike_are_saved_and_read() {
    let name = "Rohr".repeat(1 << 20);
    let mut arrays = two_leaves();
    arrays.objects[1] = object(9, 0, name.len() as u32);
    arrays.names.clone_from(&name);
    let (_folder, path, bytes) = saved(arrays);
    assert!(bytes.len() < 4000, "{} bytes", bytes.len());
    let scene = Scene::open(&path).unwrap();
    assert!(scene.object_name(1) == Some(&name));
    assert_eq!(scene.object_name(0), Some("RohrR"));
}

#[test]
fn a_damaged_scene_is_not_copied_and_an_older_file_stays() {
    let (folder, path, range) = damaged(Section::Geometry, 1);
    let scene = Scene::open(&path).unwrap();
    let copy = folder.path().join("copy.scene");
    std::fs::write(&copy, b"older").unwrap();
    match scene.save(&copy) {
        Err(SaveError::Read(error)) => assert_eq!((error.bytes, error.path), (range, path)),
        other => panic!("{other:?}"),
    }
    assert_eq!(std::fs::read(&copy).unwrap(), b"older");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
}

#[test]
fn a_folder_that_is_missing_is_named() {
    let path = Path::new("no/such/folder/x.scene");
    let message = Scene::from_arrays(two_leaves()).unwrap().save(path).unwrap_err().to_string();
    assert!(message.contains("no/such/folder/x.scene") && message.contains("bytes free"), "{message}");
}

#[test]
fn a_full_disk_leaves_nothing_behind() {
    // A write that fails midway, as on a full disk, without needing one.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.scene");
    let failed = write_atomically(&path, |out| {
        out.write_all(&[1; 100])?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
    });
    assert_eq!(failed.unwrap_err().kind(), std::io::ErrorKind::StorageFull);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
