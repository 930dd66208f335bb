//! glTF files written by hand: the result of each part of the format, and the message for each fault.

mod broken;
mod colours;
mod compressed;
mod document;
mod lenient;
mod shapes;

use glam::{DMat3, DVec3};
use trimaran_cook::Model;
use trimaran_cook::import::{GltfError, ImportError, WarningKind};
use trimaran_scene::{Attribute, Rgba8};

use crate::import_files::{floats, glb, import_beside, import_bytes};

/// A document around `nodes` (JSON) with one triangle as mesh 0: corners (0,0,0), (1,0,0), (0,1,0).
fn one_triangle(nodes: &str, more: &str) -> Vec<u8> {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},{more}"nodes":{nodes},
        "meshes":[{{"name":"plate","primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"byteLength":36}}]}}"#
    );
    glb(&json, &floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
}

fn model(file: &[u8]) -> Model {
    import_bytes("a.glb", file).unwrap().model
}

fn error(file: &[u8]) -> GltfError {
    match import_bytes("a.glb", file) {
        Err(ImportError::Gltf { source, .. }) => *source,
        other => panic!("{other:?}"),
    }
}

#[test]
fn instances_share_their_mesh_and_keep_node_order() {
    let model = model(&one_triangle(
        r#"[{"name":"root","children":[3,1]},{"mesh":0},{"mesh":0,"name":"loose"},{"mesh":0,"translation":[5,6,7]}]"#,
        "",
    ));
    assert_eq!(model.meshes.len(), 1);
    let objects: Vec<_> = model.objects.iter().map(|o| (o.name.as_str(), o.source_index, o.mesh)).collect();
    assert_eq!(objects, [("plate", 3, 0), ("plate", 1, 0), ("loose", 2, 0)]);
    assert_eq!(model.objects[0].to_world.translation, DVec3::new(5.0, 6.0, 7.0));
}

#[test]
fn matrices_are_kept_to_the_last_bit_sheared_mirrored_and_far_away() {
    let model = model(&one_triangle(
        r#"[{"matrix":[1,0,0,0, 0,1,0,0, 0,0,1,0, 6500000.001,0.1,0,1],"children":[1]},
            {"mesh":0,"matrix":[-1,0,0,0, 0.5,1,0,0, 0,0,2,0, 0,0,0,1]}]"#,
        "",
    ));
    let to_world = model.objects[0].to_world;
    assert_eq!(to_world.translation, DVec3::new(6_500_000.001, 0.1, 0.0));
    assert_eq!(
        to_world.matrix3,
        DMat3::from_cols(DVec3::new(-1.0, 0.0, 0.0), DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.0, 0.0, 2.0))
    );
}

#[test]
fn only_the_default_scene_is_read() {
    let more = r#""scene":1,"scenes":[{"nodes":[0]},{"nodes":[1]}],"#;
    let model = model(&one_triangle(r#"[{"mesh":0},{"mesh":0}]"#, more));
    assert_eq!(model.objects.iter().map(|o| o.source_index).collect::<Vec<_>>(), [1]);
    let lost = one_triangle("[]", r#""scene":7,"scenes":[{}],"#);
    assert!(matches!(error(&lost), GltfError::Malformed { part, .. } if part == "scene 7"));
}

#[test]
fn a_flattening_matrix_flattens_the_mesh() {
    let file = one_triangle(r#"[{"mesh":0,"scale":[1,0,1]},{"mesh":0}]"#, "");
    let imported = import_bytes("a.glb", &file).unwrap();
    assert_eq!(imported.report.counts(), [(WarningKind::FlattenedObject, 1)]);
    assert_eq!(imported.model.objects.iter().map(|o| o.mesh).collect::<Vec<_>>(), [1, 0]);
}

#[test]
fn gpu_instances_become_objects() {
    let json = r#"{"asset":{"version":"2.0"},"extensionsRequired":["EXT_mesh_gpu_instancing"],
        "nodes":[{"mesh":0,"translation":[0,0,1],"scale":[2,2,2],"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{
            "TRANSLATION":1,"ROTATION":2}}}}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
            {"bufferView":1,"componentType":5126,"count":2,"type":"VEC3"},
            {"bufferView":2,"componentType":5120,"normalized":true,"count":COUNT,"type":"VEC4"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24},
            {"buffer":0,"byteOffset":60,"byteLength":8}],
        "buffers":[{"byteLength":68}]}"#;
    let mut bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 10.0, 0.0, 0.0, 20.0, 0.0, 0.0]);
    bin.extend([0, 0, 0, 127, 0, 0, 127, 0]);
    let model = model(&glb(&json.replace("COUNT", "2"), &bin));
    assert_eq!((model.meshes.len(), model.objects.len()), (1, 2));
    assert_eq!(model.objects[0].to_world.translation, DVec3::new(20.0, 0.0, 1.0));
    // Half a turn about z.
    assert_eq!(model.objects[1].to_world.transform_point3(DVec3::X), DVec3::new(38.0, 0.0, 1.0));
    let uneven = error(&glb(&json.replace("COUNT", "1"), &bin));
    assert!(matches!(uneven, GltfError::Accessor { accessor: 2, .. }), "{uneven}");
}

#[test]
fn primitives_of_one_mesh_become_one_mesh_in_their_colours() {
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0},
            {"attributes":{"POSITION":0},"indices":1,"mode":5,"material":1},
            {"attributes":{"POSITION":0},"mode":1}]}],
        "materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,0.5]}},
            {"alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[0,1,0,0.5],"baseColorTexture":{"index":0}}}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
            {"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":3}],
        "buffers":[{"byteLength":40}]}"#;
    let mut bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    bin.extend([2, 1, 0, 0]);
    let imported = import_bytes("a.glb", &glb(json, &bin)).unwrap();
    let mesh = &imported.model.meshes[0];
    assert_eq!((mesh.triangle_count(), mesh.positions.len()), (2, 6));
    assert_eq!(mesh.colours[0], Rgba8([255, 0, 0, 255]));
    assert_eq!(mesh.colours[5], Rgba8([0, 255, 0, 128]));
    assert_eq!(imported.report.counts(), [(WarningKind::TextureUnread, 1), (WarningKind::PointsOrLines, 1)]);
}

#[test]
fn a_text_document_finds_its_buffer_beside_it_or_says_where_it_looked() {
    let json = br#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"uri":"my%20mesh.bin","byteLength":36}]}"#;
    let bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let imported = import_beside("a.GLTF", json, &[("my mesh.bin", &bin)]).unwrap();
    assert_eq!(imported.report.triangles, 1);
    let lost = import_bytes("a.gltf", json).unwrap_err().to_string();
    assert!(lost.contains("my mesh.bin") && lost.contains("beside it"), "{lost}");
    let short = import_beside("a.gltf", json, &[("my mesh.bin", &bin[..35])]).unwrap_err().to_string();
    assert!(short.contains("fewer bytes"), "{short}");
}

#[test]
fn faults_are_told_with_their_place() {
    let cases = [
        (r#"[{"name":"a","children":[1]},{"name":"b","mesh":9}]"#, "", "node 1 (a/b) is malformed: its mesh"),
        (r#"[{"children":[1]},{"children":[0]}]"#, r#""scenes":[{"nodes":[0]}],"#, "own ancestor"),
        (r#"[{"children":[2]},{"children":[2]},{}]"#, "", "two parents"),
        (r#"[{"children":[5]}]"#, "", "node 5 (#0/#5) is malformed: it does not exist"),
        ("[]", r#""extensionsRequired":["KHR_gaussian_splatting"],"#, "KHR_gaussian_splatting"),
        ("[", "", "JSON does not parse"),
    ];
    for (nodes, more, expected) in cases {
        let message = error(&one_triangle(nodes, more)).to_string();
        assert!(message.contains(expected), "{message:?} does not say {expected:?}");
    }
}

#[test]
fn several_files_make_one_model() {
    let folder = tempfile::TempDir::new().unwrap();
    let paths = ["b.glb", "a.glb"].map(|name| folder.path().join(name));
    for path in &paths {
        std::fs::write(path, one_triangle(r#"[{"mesh":0}]"#, "")).unwrap();
    }
    let mut seen = Vec::new();
    let imported = trimaran_cook::import::import(&paths, &Default::default(), &mut |progress| {
        seen.push((progress.files_done, progress.files));
    })
    .unwrap();
    assert_eq!(seen, [(1, 2), (2, 2)]);
    let names: Vec<_> = imported.model.sources.iter().map(|source| source.name.as_str()).collect();
    assert_eq!(names, ["b.glb", "a.glb"]);
    let objects: Vec<_> = imported.model.objects.iter().map(|o| (o.source, o.mesh)).collect();
    assert_eq!(objects, [(0, 0), (1, 1)]);
    assert_eq!((imported.report.files, imported.report.triangles), (2, 2));
}

#[test]
fn nodes_with_children_or_instances_are_groups_and_extras_are_attributes() {
    let model = model(&one_triangle(
        r#"[{"name":"plant","children":[1,2],"extras":{"owner":"me","year":1998}},
            {"name":"line","mesh":0,"children":[3],"extras":{"bore":[80,100]}},
            {"name":"valve","mesh":0,"extras":"closed"},
            {"name":"bolt","mesh":0}]"#,
        "",
    ));
    let groups: Vec<_> =
        model.hierarchy.groups.iter().map(|g| (&*g.name, g.parent, g.objects.clone())).collect();
    assert_eq!(groups, [("a.glb", None, 0..3), ("plant", Some(0), 0..3), ("line", Some(1), 0..2)]);
    let pairs = |attributes: &[Attribute]| {
        attributes.iter().map(|of| format!("{}={}", of.name, of.value)).collect::<Vec<_>>()
    };
    assert_eq!(pairs(&model.hierarchy.groups[1].attributes), ["owner=me", "year=1998"]);
    let objects = [0, 1, 2].map(|object| pairs(model.hierarchy.attributes_of(object)));
    assert_eq!(objects, [vec!["bore=[80,100]".to_owned()], vec![], vec!["extras=closed".to_owned()]]);
}
