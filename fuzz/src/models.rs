//! Properties of any model and any scene file at all. The fuzz targets search for files that break it;
//! an ordinary test of `trimaran-cook` replays the corpus.

use std::path::Path;

use trimaran_cook::import::{ImportError, ImportLimits, ImportOptions, Imported, import_bytes};
use trimaran_cook::{CookOptions, cook};
use trimaran_scene::{FORMAT_VERSIONS, Level, OpenError, Scene};

/// Small, so that a run is fast.
const LIMITS: ImportLimits =
    ImportLimits { triangles: 20_000, vertices: 20_000, objects: 500, depth: 20, attribute_bytes: 1 << 20 };
/// Models of so few triangles and objects are cooked as well.
const COOKED: u64 = 64;

/// Any bytes as a `.glb`, or as a `.gltf` if they look like one.
pub fn gltf(bytes: &[u8]) {
    import(if bytes.starts_with(b"glTF") { "a.glb" } else { "a.gltf" }, bytes);
}

/// Any bytes behind the start of a review file.
pub fn rvm(bytes: &[u8]) {
    import("a.rvm", bytes);
}

/// Any text as a review file of the text form.
pub fn rvm_text(bytes: &[u8]) {
    import("a.rev", bytes);
}

/// Any text as the attribute file beside a review file: each part has attributes of its own or none, and no
/// more parts have some than there are.
pub fn attributes(bytes: &[u8]) {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().unwrap();
    }
    FOLDER.with(|folder| {
        let path = folder.path().join("a.rev");
        std::fs::write(&path, SAID_OF).unwrap();
        std::fs::write(folder.path().join("a.att"), bytes).unwrap();
        let options = ImportOptions { limits: LIMITS, ..ImportOptions::default() };
        match trimaran_cook::import::import(&[path], &options, &mut |_| {}) {
            Ok(imported) => {
                assert_eq!(imported.model.check(), Ok(()));
                let (report, hierarchy) = (imported.report, imported.model.hierarchy);
                assert!(report.parts_matched <= report.parts && [0, 9].contains(&report.parts), "{report:?}");
                let groups = hierarchy.groups.iter().filter(|group| !group.attributes.is_empty()).count();
                assert!(groups + hierarchy.attributes.len() <= report.parts_matched as usize);
            }
            Err(error) => assert!(error.to_string().contains("--max-attribute-bytes"), "{error}"),
        }
    });
}

/// Two pipes with parts of the same names: seven objects below two groups.
const SAID_OF: &str = "HEAD\n 1 2\n\n\n\n\n\nMODL\n 1 1\n\n\n\
    CNTB\n 1 2\n/P1\n0 0 0 2\n\
    CNTB\n 1 2\nFLANGE 1\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTB\n 1 2\nVALVE\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTE\n 1 1\n\
    CNTB\n 1 2\n/P2\n0 0 0 2\n\
    CNTB\n 1 2\nFLANGE 1\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTB\n 1 2\nTWIN\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTB\n 1 2\nTWIN\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTE\n 1 1\n\
    CNTB\n 1 2\n/P1\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    CNTB\n 1 2\n/RÖHR\n0 0 0 2\nPRIM\n 1 1\n 2\n1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 1 1 1 1\nCNTE\n 1 1\n\
    END:\n 1 1\n";

/// Any bytes as an STL file of either form.
pub fn stl(bytes: &[u8]) {
    import("a.stl", bytes);
}

/// Any bytes as a PLY file of any form.
pub fn ply(bytes: &[u8]) {
    import("a.ply", bytes);
}

/// Stands between an OBJ file and its library in an input.
const LIBRARY: &[u8] = b"\n#### a.mtl\n";

/// Any text as a Wavefront OBJ; behind a line that says so, any text as the library `a.mtl` beside it.
pub fn obj(bytes: &[u8]) {
    let library = bytes.windows(LIBRARY.len()).position(|window| window == LIBRARY);
    match library.map(|at| (&bytes[..at], &bytes[at + LIBRARY.len()..])) {
        None => import("a.obj", bytes),
        Some((text, library)) => BESIDE.with(|folder| {
            let path = folder.path().join("a.obj");
            std::fs::write(&path, text).unwrap();
            std::fs::write(folder.path().join("a.mtl"), library).unwrap();
            let options = ImportOptions { limits: LIMITS, ..ImportOptions::default() };
            sound("a.obj", trimaran_cook::import::import(&[path], &options, &mut |_| {}));
        }),
    }
}

thread_local! {
    /// Where files lie that read others.
    static BESIDE: tempfile::TempDir = tempfile::tempdir().unwrap();
}

/// One file with nothing beside it.
fn import(name: &str, bytes: &[u8]) {
    let options = ImportOptions { limits: LIMITS, ..ImportOptions::default() };
    sound(name, import_bytes(Path::new(name), bytes, &options));
}

/// An imported model is sound and within the limits. A small one is cooked, or refused with a reason.
fn sound(name: &str, imported: Result<Imported, ImportError>) {
    let imported = match imported {
        Ok(imported) => imported,
        Err(error) => {
            assert!(error.to_string().contains(name), "{error}");
            return;
        }
    };
    let (model, report) = (imported.model, imported.report);
    assert_eq!(model.check(), Ok(()));
    assert!(report.unique_triangles <= LIMITS.triangles && report.objects <= LIMITS.objects, "{report:?}");
    if report.triangles <= COOKED && report.objects <= COOKED {
        let options = CookOptions { max_nodes: 10_000, ..CookOptions::default() };
        if let Ok(scene) = cook(&model, &options, &()) {
            assert_eq!(scene.check().map_err(|fault| fault.to_string()), Ok(()));
            assert_eq!(walk(&scene), scene.totals().full_detail_triangles);
        }
    }
}

/// Any bytes as a scene file, as they are and with its checksums put right: an error, a fault, or a scene all
/// of whose records can be followed.
pub fn scene(bytes: &[u8]) {
    for file in [bytes, &sealed(bytes)] {
        let open = || Scene::open_bytes(Path::new("a.scene"), file);
        match open().and_then(|scene| scene.check().map(|()| scene).map_err(OpenError::Read)) {
            Ok(scene) => {
                walk(&scene);
            }
            Err(error) => {
                assert!(error.to_string().contains("a.scene"), "{error}");
                if let OpenError::Read(fault) = error {
                    let end = file.len() as u64;
                    assert!(fault.bytes.start <= fault.bytes.end && fault.bytes.end <= end, "{fault}");
                }
            }
        }
        // Once more from the end, nothing of it checked before.
        if let Ok(scene) = open() {
            let found = scene.drawables().iter().rev().count() + scene.nodes().iter().rev().count();
            let all = scene.drawables().len() + scene.nodes().len();
            assert_eq!(found < all, scene.fault().is_some(), "{found} of {all} records: {:?}", scene.fault());
        }
    }
}

/// Follows every record to all that it refers to: what later code does without looking. Returns the triangles
/// of the leaves at their finest.
fn walk(scene: &Scene) -> u64 {
    let (nodes, drawables) = (scene.nodes(), scene.drawables());
    let mut met = vec![false; nodes.len()];
    let (mut drawn, mut triangles, mut leaves) = (0, 0, 0);
    let mut reader = scene.reader();
    for (index, node) in (0..).zip(nodes) {
        let (low, high) = node.world_box();
        assert!(low.cmple(high).all() && low.is_finite() && high.is_finite());
        assert!(node.reach >= node.own_reach());
        for child in node.children() {
            assert!(child > index && nodes[child as usize].parent == index);
            assert!(nodes[child as usize].reach <= node.reach);
            assert!(!std::mem::replace(&mut met[child as usize], true), "node {child} has two parents");
        }
        let mut finest = 0.0;
        for id in node.drawables() {
            let drawable = &drawables[id.index()];
            assert!(drawable.node == index && drawable.error >= finest);
            finest = drawable.error;
            match reader.read(drawable.geometry) {
                Ok(geometry) => {
                    assert_eq!((geometry.triangles(), geometry.check()), (drawable.triangles as usize, None));
                }
                Err(fault) => unreachable!("it was checked: {fault}"),
            }
            drawn += 1;
        }
        if node.is_leaf() {
            assert!(scene.object_name(node.object).is_some());
            assert_eq!(scene.leaf(leaves).map(|(id, _)| id.0), Some(index));
            leaves += 1;
            for id in scene.levels(node).next().into_iter().flat_map(Level::pieces) {
                let finest = &drawables[id.index()];
                assert!(finest.error == 0.0 && finest.triangles > 0);
                triangles += u64::from(finest.triangles);
            }
        }
    }
    assert_eq!((drawn, met.iter().filter(|&&met| met).count()), (drawables.len(), nodes.len() - 1));
    assert_eq!(leaves, scene.leaf_count());
    for object in scene.objects() {
        assert!(scene.source_name(object.source).is_some());
    }
    assert!(triangles > 0 && scene.fault().is_none());
    triangles
}

/// A scene file whose header says what its length is and where its directory is, and whose hashes are right:
/// `roles/scene/src/scene/layout.rs` says what it looks like.
pub fn sealed(bytes: &[u8]) -> Vec<u8> {
    const HEADER: usize = 128;
    const FINGERPRINT: usize = 88;
    const CHECK: usize = 120;
    const ENTRY: usize = 64;
    let mut file = bytes.to_vec();
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte));
    let Some(header) = file.get(..HEADER) else { return file };
    let entries = number(&header[12..16]) * ENTRY;
    let Some(directory) = file.len().checked_sub(entries).filter(|&start| start >= HEADER) else {
        return file;
    };
    let length = file.len() as u64;
    file[..8].copy_from_slice(b"TRIMRN\r\n");
    // A version that is read stays: all are to be tried.
    if !FORMAT_VERSIONS.contains(&(number(&file[8..12]) as u32)) {
        file[8..12].copy_from_slice(&FORMAT_VERSIONS.start().to_le_bytes());
    }
    file[16..24].copy_from_slice(&length.to_le_bytes());
    file[24..32].copy_from_slice(&(directory as u64).to_le_bytes());
    let (pages, entries) = file.split_at_mut(directory);
    for entry in entries.as_chunks_mut::<ENTRY>().0 {
        let (offset, length) = (number(&entry[..8]), number(&entry[8..12]));
        let page = pages.get(offset..offset.saturating_add(length)).unwrap_or_default();
        entry[32..].copy_from_slice(blake3::hash(page).as_bytes());
    }
    let fingerprint = blake3::Hasher::new().update(&pages[..FINGERPRINT]).update(entries).finalize();
    pages[FINGERPRINT..CHECK].copy_from_slice(fingerprint.as_bytes());
    let check = blake3::hash(&pages[..CHECK]);
    pages[CHECK..HEADER].copy_from_slice(&check.as_bytes()[..HEADER - CHECK]);
    file
}
