//! What must hold for any model and any scene file at all. The fuzz targets search for files that break it;
//! an ordinary test of `trimaran-cook` replays the corpus.

use std::path::Path;

use trimaran_cook::import::{ImportLimits, ImportOptions, import_bytes};
use trimaran_cook::{CookOptions, cook};
use trimaran_scene::Scene;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64, xxh3_128};

/// Small, so that a run is fast.
const LIMITS: ImportLimits = ImportLimits { triangles: 20_000, vertices: 20_000, objects: 500, depth: 20 };
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

/// Any text as a Wavefront OBJ.
pub fn obj(bytes: &[u8]) {
    import("a.obj", bytes);
}

/// What is imported is sound and within the limits; what is small is cooked, or refused with a reason.
fn import(name: &str, bytes: &[u8]) {
    let options = ImportOptions { limits: LIMITS, ..ImportOptions::default() };
    let imported = match import_bytes(Path::new(name), bytes, &options) {
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
            walk(&scene);
        }
    }
}

/// Any bytes as a scene file, as they are and with its checksums put right: an error, or a scene all of whose
/// records can be followed.
pub fn scene(bytes: &[u8]) {
    for file in [bytes, &sealed(bytes)] {
        match Scene::open_bytes(Path::new("a.scene"), file) {
            Ok(scene) => walk(&scene),
            Err(error) => assert!(error.to_string().contains("a.scene"), "{error}"),
        }
    }
}

/// Follows every record to all that it refers to: what later code does without looking.
fn walk(scene: &Scene) {
    let (nodes, drawables) = (scene.nodes(), scene.drawables());
    let mut met = vec![false; nodes.len()];
    let mut drawn = 0;
    for (index, node) in (0..).zip(nodes) {
        let (low, high) = node.world_box();
        assert!(low.cmple(high).all() && low.is_finite() && high.is_finite());
        for child in node.children() {
            assert!(child > index && nodes[child as usize].parent == index);
            assert!(!std::mem::replace(&mut met[child as usize], true), "node {child} has two parents");
        }
        let mut finest = 0.0;
        for id in node.levels() {
            let drawable = &drawables[id.index()];
            assert!(drawable.node == index && drawable.error >= finest);
            finest = drawable.error;
            let indices = &scene.indices()[drawable.first_index as usize..][..drawable.index_count as usize];
            let vertices =
                &scene.vertices()[drawable.vertex_offset as usize..][..drawable.vertex_count as usize];
            assert!(
                indices
                    .iter()
                    .all(|&corner| vertices[corner as usize].position.iter().all(|x| x.is_finite()))
            );
            drawn += 1;
        }
        if node.is_leaf() {
            assert!(scene.object_name(node.object).is_some());
        }
    }
    assert_eq!((drawn, met.iter().filter(|&&met| met).count()), (drawables.len(), nodes.len() - 1));
    for object in scene.objects() {
        assert!(scene.source_name(object.source).is_some());
    }
    assert!(scene.full_detail_triangles() > 0);
}

/// A scene file whose head says what its length is, and whose checksums are right:
/// `roles/scene/src/scene/file.rs` says what it looks like.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    const SECTIONS: std::ops::Range<usize> = 40..152;
    let mut file = bytes.to_vec();
    if file.len() < SECTIONS.end + 8 {
        return file;
    }
    let length = file.len() as u64;
    let mut fingerprint = Xxh3Default::new();
    for section in bytes[SECTIONS].as_chunks::<16>().0 {
        let [offset, length] = [&section[..8], &section[8..]]
            .map(|half| u64::from_le_bytes(half.try_into().unwrap_or_default()) as usize);
        let section = bytes.get(offset..offset.saturating_add(length)).unwrap_or_default();
        fingerprint.update(&(length as u64).to_le_bytes());
        for piece in section.chunks(1 << 20) {
            fingerprint.update(&xxh3_128(piece).to_le_bytes());
        }
    }
    file[..8].copy_from_slice(b"TRIMRN\r\n");
    file[8..12].copy_from_slice(&2_u32.to_le_bytes());
    file[16..32].copy_from_slice(&fingerprint.digest128().to_le_bytes());
    file[32..40].copy_from_slice(&length.to_le_bytes());
    let check = xxh3_64(&file[..SECTIONS.end]);
    file[SECTIONS.end..SECTIONS.end + 8].copy_from_slice(&check.to_le_bytes());
    file
}
