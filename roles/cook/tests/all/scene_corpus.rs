//! The scene files among the fuzz targets' inputs: their properties, and how to make them.
//!
//! Remake them after a change of the format: `cargo test -p trimaran-cook --test all scene_corpus:: --
//! --ignored`.

use std::fs;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use trimaran_cook::{CookOptions, Mesh, Model, Object, Source, cook};
use trimaran_scene::{
    Coordinates, FORMAT_VERSIONS, FileFrame, OpenError, PlantFrame, ReadCause, Rgba8, Scene, UpAxis,
};

use crate::models::sealed;

const HEADER: usize = 128;
const ENTRY: usize = 64;

/// The pages of a small scene.
const NODES: usize = 0;
const NAMES: usize = 4;
const GEOMETRY: usize = 7;
const OVERVIEW: usize = 8;
/// Only in the newest format, where later pages have higher numbers.
const COORDINATES: usize = 7;

/// The result for a file.
fn outcome(file: &[u8]) -> &'static str {
    let cause = |cause: &ReadCause| match cause {
        ReadCause::Damaged => "damaged",
        ReadCause::Malformed(_) => "malformed",
        ReadCause::Geometry(_) => "geometry",
        _ => "other",
    };
    match Scene::open_bytes(Path::new("a.scene"), file) {
        Err(OpenError::Foreign { .. }) => "foreign",
        Err(OpenError::Version { .. }) => "version",
        Err(OpenError::Truncated { .. }) => "cut",
        Err(OpenError::Damaged { .. }) => "refused",
        Err(OpenError::Read(fault)) => cause(&fault.cause),
        Err(_) => "other",
        Ok(scene) => scene.check().map_or_else(|fault| cause(&fault.cause), |()| "sound"),
    }
}

/// Makes a file.
type Make = fn() -> Vec<u8>;

/// Each file, with its results unchanged and with corrected checksums. All but "sound" are broken.
const FILES: [(&str, [&str; 2], Make); 31] = [
    ("empty", ["cut", "cut"], Vec::new),
    ("only-the-header", ["cut", "cut"], || one_triangle()[..HEADER].to_vec()),
    ("cut-within-the-header", ["cut", "cut"], || one_triangle()[..100].to_vec()),
    ("cut-within-the-directory", ["cut", "refused"], || {
        let mut file = one_triangle();
        file.truncate(file.len() - 10);
        file
    }),
    ("another-version", ["version", "sound"], || {
        let mut file = one_triangle();
        file[8] = 200;
        file
    }),
    ("one-triangle", ["sound"; 2], one_triangle),
    ("two-objects", ["sound"; 2], two_objects),
    ("see-through", ["sound"; 2], see_through),
    ("levels", ["sound"; 2], levels),
    ("clusters", ["sound"; 2], || cooked(vec![bumps(12)], &[DAffine3::IDENTITY])),
    ("instances-below-groups", ["sound"; 2], || cooked(vec![bumps(2), bumps(3)], &in_a_grid(20))),
    ("two-pages-of-nodes", ["sound"; 2], || cooked(vec![bumps(1)], &in_a_grid(250))),
    ("one-triangle-not-packed", ["sound"; 2], || not_packed(&one_triangle())),
    ("levels-not-packed", ["sound"; 2], || not_packed(&levels())),
    ("instances-not-packed", ["sound"; 2], || not_packed(&cooked(vec![bumps(2)], &in_a_grid(12)))),
    ("pages-that-overlap", ["refused"; 2], || {
        changed(one_triangle(), |file| {
            let first = entry(file, NODES);
            file.copy_within(first..first + 8, entry(file, NODES + 1));
        })
    }),
    ("a-damaged-page-of-nodes", ["damaged", "broken"], || damaged(one_triangle(), NODES)),
    ("a-damaged-page-of-geometry", ["damaged", "broken"], || damaged(two_objects(), GEOMETRY)),
    ("a-damaged-overview", ["damaged", "sound"], || damaged(one_triangle(), OVERVIEW)),
    ("an-overview-of-no-numbers", ["damaged"; 2], || with_page(&one_triangle(), OVERVIEW, &[0xff; 121])),
    ("a-damaged-directory", ["refused", "sound"], || {
        let mut file = one_triangle();
        let hash = entry(&file, GEOMETRY) + 40;
        file[hash] ^= 1;
        file
    }),
    ("more-nodes-than-a-file-has-pages-for", ["refused"; 2], || {
        changed(one_triangle(), |file| file[32..36].fill(0xff))
    }),
    ("more-objects-than-a-file-has-pages-for", ["refused"; 2], || {
        changed(one_triangle(), |file| file[44..48].copy_from_slice(&1_000_000_u32.to_le_bytes()))
    }),
    ("a-directory-longer-than-the-file", ["refused"; 2], || {
        let mut file = one_triangle();
        file[12..16].copy_from_slice(&0x4000_0000_u32.to_le_bytes());
        let fingerprint = blake3::Hasher::new().update(&file[..88]).finalize();
        file[88..120].copy_from_slice(fingerprint.as_bytes());
        let check = blake3::hash(&file[..120]);
        file[120..128].copy_from_slice(&check.as_bytes()[..8]);
        file
    }),
    ("a-page-longer-than-the-file", ["refused"; 2], || {
        changed(one_triangle(), |file| {
            let length = entry(file, GEOMETRY) + 8;
            file[length..length + 4].fill(0xff);
        })
    }),
    ("a-page-that-ends-past-all-numbers", ["refused"; 2], || {
        changed(one_triangle(), |file| {
            let offset = entry(file, GEOMETRY);
            file[offset..offset + 8].fill(0xff);
        })
    }),
    ("names-that-unpack-to-far-more-than-their-bytes", ["damaged"; 2], || {
        // Four bytes of zstd for each 128 KiB.
        let (blocks, block) = (1024_u32, 128 << 10);
        let mut page = frame(blocks * block);
        for number in 0..blocks {
            page.extend_from_slice(&block_header(number + 1 == blocks, 1, block));
            page.push(b'x');
        }
        with_names(&page, blocks * block)
    }),
    ("names-that-unpack-to-more-than-they-say", ["damaged"; 2], || with_names(&stored(&[b'x'; 4000]), 1000)),
    ("names-that-unpack-to-less-than-they-say", ["damaged"; 2], || with_names(&stored(&[b'x'; 100]), 4000)),
    ("a-name-that-ends-within-a-character", ["malformed"; 2], || with_names(&stored("xxxxxé".as_bytes()), 7)),
    ("geometry-of-more-triangles-than-its-bytes", ["geometry"; 2], || {
        let scene = Scene::open_bytes(Path::new("a.scene"), &one_triangle()).unwrap();
        let mut piece = scene.packed_geometry(0).unwrap();
        piece[..8].fill(0xff);
        with_page(&one_triangle(), GEOMETRY, &piece)
    }),
];

#[test]
fn the_scenes_of_the_corpus_are_what_their_names_say() {
    let corpus = crate::replay::corpus("scene");
    let names: Vec<&str> = corpus.iter().map(|(name, _)| name.as_str()).collect();
    let mut expected = FILES.map(|(name, ..)| name);
    expected.sort_unstable();
    assert_eq!(names, expected);
    for (name, outcomes, _) in FILES {
        let file = &corpus.iter().find(|(known, _)| known == name).unwrap().1;
        assert_eq!(outcome(file), outcomes[0], "{name}");
        let mended = outcome(&sealed(file));
        assert!(mended == outcomes[1] || outcomes[1] == "broken" && mended != "sound", "{name}: {mended}");
    }
}

#[test]
fn the_sound_scenes_of_the_corpus_have_what_their_names_say() {
    let corpus = crate::replay::corpus("scene");
    let scene = |name: &str| {
        let file = &corpus.iter().find(|(known, _)| known == name).unwrap().1;
        Scene::open_bytes(Path::new(name), file).unwrap()
    };
    let one = scene("one-triangle");
    assert_eq!((one.nodes().len(), one.totals().stored_triangles), (1, 1));
    assert_eq!(scene("two-objects").objects().len(), 2);
    assert_eq!(one.coordinates().unwrap(), Coordinates::default());
    assert_eq!(scene("see-through").see_through().iter().collect::<Vec<_>>(), [1]);
    let levels = scene("levels");
    assert!(levels.nodes().iter().any(|node| node.is_leaf() && node.drawable_count > 1));
    let clusters = scene("clusters");
    assert!(clusters.objects().len() == 1 && clusters.leaf_count() > 1);
    let instances = scene("instances-below-groups");
    assert!(instances.places().len() < instances.objects().len() && instances.nodes().len() > 21);
    assert!(scene("two-pages-of-nodes").nodes().len() > 256);
    for (packed, stored) in [("one-triangle", "one-triangle-not-packed"), ("levels", "levels-not-packed")]
        .map(|(a, b)| (scene(a), scene(b)))
    {
        assert_eq!((packed.nodes(), packed.drawables()), (stored.nodes(), stored.drawables()));
        assert!(packed.hash() != stored.hash());
    }
}

#[test]
fn coordinates_are_read_and_damaged_ones_are_refused() {
    let sound = in_a_plant();
    assert_eq!([outcome(&sound), outcome(&sealed(&sound))], ["sound"; 2]);
    let scene = Scene::open_bytes(Path::new("a.scene"), &sound).unwrap();
    assert_eq!(scene.coordinates().unwrap(), elsewhere());
    assert_eq!(outcome(&damaged(in_a_plant(), COORDINATES)), "damaged");
    assert_eq!(outcome(&with_page(&sound, COORDINATES, &[0xff; 43])), "damaged");
    assert_eq!(outcome(&with_page(&sound, COORDINATES, &[])), "damaged");
    // Called a file of the format without them, it has a page too many.
    let mut older = sound;
    older[8..12].copy_from_slice(&FORMAT_VERSIONS.start().to_le_bytes());
    assert_ne!(outcome(&sealed(&older)), "sound");
}

/// The release of format 8 wrote this file. A release with a later format reads it as well, as its cullers
/// may stand beside those of the release before.
#[test]
fn a_scene_of_format_8_is_read() {
    let scene = Scene::open_bytes(Path::new("instances"), include_bytes!("../format-8/instances")).unwrap();
    scene.check().unwrap();
    assert_eq!(scene.hash().to_string(), "c5e94c9a7f25485908a07b651e094cb7");
    let counts = (scene.nodes().len(), scene.drawables().len(), scene.objects().len());
    assert_eq!((counts, scene.totals().stored_triangles), ((29, 20, 20), 26));
    assert_eq!((scene.object_name(0), scene.source_name(0)), (Some("part 0"), Some("site.obj")));
    // It says nothing of coordinates: they are those of glTF.
    assert_eq!(scene.coordinates().unwrap(), Coordinates::default());
}

#[test]
#[ignore = "writes the files"]
fn the_scenes_of_the_corpus_are_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/scene");
    fs::remove_dir_all(&folder).unwrap();
    fs::create_dir(&folder).unwrap();
    for (name, _, make) in FILES {
        fs::write(folder.join(name), make()).unwrap();
    }
}

/// A square of `2 * n * n` triangles that is not flat.
fn bumps(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for index in 0..(n + 1) * (n + 1) {
        let (x, y) = ((index % (n + 1)) as f32, (index / (n + 1)) as f32);
        mesh.positions.push(Vec3::new(x, y, 0.3 * (x * 1.7).sin() * (y * 1.3).cos()));
        mesh.colours.push(Rgba8([200, 100, 50, 255]));
    }
    for index in 0..n * n {
        let a = index % n + index / n * (n + 1);
        mesh.indices.extend([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1]);
    }
    mesh
}

fn in_a_grid(count: u32) -> Vec<DAffine3> {
    let place = |index: u32| {
        let at = DVec3::new(f64::from(index % 5), f64::from(index / 5), 0.0) * 9.0;
        DAffine3::from_mat3_translation(DMat3::from_rotation_y(f64::from(index)), at)
    };
    (0..count).map(place).collect()
}

/// The file of a cooked scene: meshes in turn, each object at its place.
fn cooked(meshes: Vec<Mesh>, places: &[DAffine3]) -> Vec<u8> {
    cooked_in(Coordinates::default(), meshes, places)
}

/// The same with these coordinates of its plant and its file.
fn cooked_in(coordinates: Coordinates, meshes: Vec<Mesh>, places: &[DAffine3]) -> Vec<u8> {
    let object = |(index, &to_world): (usize, &DAffine3)| Object {
        mesh: index as u32 % meshes.len() as u32,
        to_world,
        name: format!("part {index}"),
        source: 0,
        source_index: index as u32,
    };
    let objects = places.iter().enumerate().map(object).collect();
    let sources = vec![Source { name: "site.obj".to_owned() }];
    let file = tempfile::NamedTempFile::new().unwrap();
    let scene = cook(
        &Model { meshes, objects, sources, coordinates, ..Model::default() },
        &CookOptions::default(),
        &(),
    )
    .unwrap();
    scene.save(file.path()).unwrap();
    fs::read(file.path()).unwrap()
}

fn one_triangle() -> Vec<u8> {
    let mut mesh = bumps(1);
    mesh.indices.truncate(3);
    cooked(vec![mesh], &[DAffine3::IDENTITY])
}

/// A file with z up and millimetres in a plant that is far away and turned.
fn elsewhere() -> Coordinates {
    Coordinates {
        plant: PlantFrame { origin: [432_100.25, 6_789_012.5, 17.0], north_deg: -32.5 },
        files: vec![FileFrame { up: UpAxis::Z, metres_per_unit: Some(0.001) }],
    }
}

fn in_a_plant() -> Vec<u8> {
    cooked_in(elsewhere(), vec![bumps(1)], &[DAffine3::IDENTITY])
}

fn levels() -> Vec<u8> {
    cooked(vec![bumps(7)], &in_a_grid(2))
}

fn two_objects() -> Vec<u8> {
    cooked(vec![bumps(1), bumps(2)], &in_a_grid(2))
}

/// The second of two objects is see-through. The file is of the newest format.
fn see_through() -> Vec<u8> {
    let mut glass = bumps(2);
    glass.colours.fill(Rgba8([20, 30, 200, 60]));
    cooked(vec![bumps(1), glass], &in_a_grid(2))
}

/// A number of this many bytes, little-endian.
fn number(file: &[u8], at: usize, bytes: usize) -> usize {
    file[at..at + bytes].iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte))
}

/// Where a page's entry in the directory begins.
fn entry(file: &[u8], page: usize) -> usize {
    number(file, 24, 8) + page * ENTRY
}

fn changed(mut file: Vec<u8>, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    change(&mut file);
    sealed(&file)
}

/// Changes the byte in the middle of a page.
fn damaged(mut file: Vec<u8>, page: usize) -> Vec<u8> {
    let at = entry(&file, page);
    let middle = number(&file, at, 8) + number(&file, at + 8, 4) / 2;
    file[middle] ^= 0x55;
    file
}

/// The file with other pages: their bytes, and their declared unpacked lengths.
fn with_pages(file: &[u8], change: impl Fn(usize, &[u8]) -> Option<(Vec<u8>, u32)>) -> Vec<u8> {
    let count = number(file, 12, 4);
    let (mut out, mut directory) = (file[..HEADER].to_vec(), file[entry(file, 0)..].to_vec());
    for (page, entry) in directory.as_chunks_mut::<ENTRY>().0.iter_mut().enumerate().take(count) {
        let bytes = &file[number(entry, 0, 8)..][..number(entry, 8, 4)];
        let old = number(entry, 12, 4) as u32;
        let (bytes, unpacked) = change(page, bytes).unwrap_or_else(|| (bytes.to_vec(), old));
        entry[..8].copy_from_slice(&(out.len() as u64).to_le_bytes());
        entry[8..12].copy_from_slice(&(bytes.len() as u32).to_le_bytes());
        entry[12..16].copy_from_slice(&unpacked.to_le_bytes());
        out.extend(bytes);
    }
    out.extend(directory);
    sealed(&out)
}

/// The file with other bytes in a page, not compressed.
fn with_page(file: &[u8], page: usize, bytes: &[u8]) -> Vec<u8> {
    with_pages(file, |at, _| (at == page).then(|| (stored(bytes), bytes.len() as u32)))
}

/// A small scene whose only object's name is all of the names.
fn with_names(page: &[u8], length: u32) -> Vec<u8> {
    let mut file = with_pages(&one_triangle(), |at, _| (at == NAMES).then(|| (page.to_vec(), length)));
    file[56..64].copy_from_slice(&u64::from(length).to_le_bytes());
    sealed(&file)
}

/// The same scene with its records uncompressed within zstd frames: a changed byte is a changed record.
fn not_packed(file: &[u8]) -> Vec<u8> {
    let scene = Scene::open_bytes(Path::new("a.scene"), file).unwrap();
    let names: String = (0..scene.objects().len() as u32).map(|i| scene.object_name(i).unwrap()).collect();
    let sources = scene.sources().iter();
    let sources = sources.flat_map(|name| [&(name.len() as u32).to_le_bytes(), name.as_bytes()].concat());
    // No object is see-through.
    let sources: Vec<u8> = [0; 4].into_iter().chain(sources).collect();
    let unpacked: [Vec<u8>; 6] = [
        bytemuck::cast_slice(&scene.nodes().to_vec()).to_vec(),
        bytemuck::cast_slice(&scene.drawables().to_vec()).to_vec(),
        bytemuck::cast_slice(&scene.places().to_vec()).to_vec(),
        bytemuck::cast_slice(&scene.objects().to_vec()).to_vec(),
        names.into_bytes(),
        sources,
    ];
    with_pages(file, |page, _| unpacked.get(page).map(|bytes| (stored(bytes), bytes.len() as u32)))
}

/// The head of a zstd frame with its content's length (RFC 8878).
fn frame(length: u32) -> Vec<u8> {
    [&[0x28, 0xb5, 0x2f, 0xfd, 0xa0][..], &length.to_le_bytes()].concat()
}

/// The head of a block: of raw bytes (kind 0), or of one repeated byte (1).
fn block_header(last: bool, kind: u32, length: u32) -> [u8; 3] {
    let [a, b, c, _] = (u32::from(last) | kind << 1 | length << 3).to_le_bytes();
    [a, b, c]
}

/// A zstd frame with raw bytes, fewer than 128 KiB.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len() as u32;
    [&frame(length), &block_header(true, 0, length)[..], bytes].concat()
}
