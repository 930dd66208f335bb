//! Exporters' deviations from the format, and variants beside it.

use trimaran_cook::Model;
use trimaran_cook::import::{GltfError, ImportError, WarningKind};

use super::document::Document;
use super::{error, model, one_triangle};

use crate::import_files::{floats, glb, import_beside, import_bytes, names};

/// The file of one triangle with a part of its JSON replaced.
fn rewritten(part: &str, other: &str) -> Vec<u8> {
    let file = one_triangle(r#"[{"mesh":0}]"#, "");
    let length = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let json = std::str::from_utf8(&file[20..20 + length]).unwrap();
    assert!(json.contains(part), "{json}");
    glb(&json.replace(part, other), &file[28 + length..])
}

fn triangles(file: &[u8]) -> usize {
    model(file).triangle_count()
}

#[test]
fn versions_2_x_are_read_unless_they_need_more() {
    for asset in [
        r#"{"version":"2.0"}"#,
        r#"{"version":"2.1"}"#,
        r#"{"version":"2.9","minVersion":"2.0"}"#,
        r#"{"version":"3.0","minVersion":"2.0"}"#,
        r#"{"version":2.0}"#,
        r#"{"version":"2.0","minVersion":null}"#,
    ] {
        assert_eq!(triangles(&rewritten(r#"{"version":"2.0"}"#, asset)), 1, "{asset}");
    }
    for (asset, version) in [
        (r#"{"version":"2.1","minVersion":"2.1"}"#, "2.1"),
        (r#"{"version":"3.0"}"#, "3.0"),
        (r#"{"version":"1.0"}"#, "1.0"),
        (r#"{"version":"two"}"#, "two"),
    ] {
        let said = error(&rewritten(r#"{"version":"2.0"}"#, asset));
        assert!(matches!(&said, GltfError::Version { version: named } if named == version), "{said}");
    }
    let none = error(&rewritten(r#""version":"2.0""#, "")).to_string();
    assert!(none.contains("no version"), "{none}");
}

#[test]
fn gltf_1_0_is_said_as_such_with_a_converter() {
    let text: &[u8] =
        br#"{"asset":{"version":"1.0"},"nodes":{"n":{"meshes":["m"]}},"meshes":{"m":{"primitives":[]}}}"#;
    let unnamed: &[u8] = br#"{"nodes":{"n":{"meshes":["m"]}},"meshes":{"m":{"primitives":[]}}}"#;
    let mut binary = one_triangle("[]", "");
    binary[4] = 1;
    for (name, file) in [("a.gltf", text), ("a.gltf", unnamed), ("a.glb", &binary[..])] {
        let said = import_bytes(name, file).unwrap_err().to_string();
        assert!(said.contains("it is glTF 1.0") && said.contains("gltf-pipeline"), "{said}");
    }
}

#[test]
fn whole_numbers_may_be_written_as_floats() {
    for (part, other) in [
        (r#""componentType":5126"#, r#""componentType":5126.0"#),
        (r#""count":3"#, r#""count":3.0"#),
        (r#""bufferView":0"#, r#""bufferView":0.0"#),
        (r#""POSITION":0"#, r#""POSITION":0.0,"_OTHER":1e0"#),
        (r#"{"mesh":0}"#, r#"{"mesh":0.0,"children":[]}"#),
        (r#""buffer":0"#, r#""buffer":0.0,"byteOffset":0.0"#),
        (r#""nodes":[{"mesh":0}]"#, r#""scene":0.0,"scenes":[{"nodes":[0.0]}],"nodes":[{"mesh":0}]"#),
    ] {
        assert_eq!(triangles(&rewritten(part, other)), 1, "{other}");
    }
    let part = error(&rewritten(r#""count":3"#, r#""count":2.5"#)).to_string();
    assert!(part.contains("whole number"), "{part}");
}

#[test]
fn null_is_as_if_it_were_not_there() {
    for (part, other) in [
        (
            r#"{"mesh":0}"#,
            r#"{"mesh":0,"children":null,"name":null,"matrix":null,"weights":null,"extras":null}"#,
        ),
        (r#"{"mesh":0}"#, r#"{"mesh":0,"skin":null,"extensions":null,"rotation":null}"#),
        (r#""name":"plate""#, r#""name":null,"weights":null,"extras":null"#),
        (
            r#"{"POSITION":0}"#,
            r#"{"POSITION":0,"COLOR_0":null},"indices":null,"material":null,"mode":null,"targets":null,"extensions":null"#,
        ),
        (r#""count":3"#, r#""count":3,"byteOffset":null,"normalized":null,"sparse":null"#),
        (r#""buffer":0"#, r#""buffer":0,"byteOffset":null,"byteStride":null,"extensions":null"#),
        (
            r#"{"byteLength":36}]}"#,
            r#"{"byteLength":36,"uri":null}],"scenes":null,"scene":null,"materials":null,"textures":null,"images":null,"samplers":null,"extensions":null,"extensionsRequired":null}"#,
        ),
    ] {
        assert_eq!(triangles(&rewritten(part, other)), 1, "{other}");
    }
}

#[test]
fn the_bytes_say_whether_a_file_is_binary_whatever_it_is_called() {
    let binary = one_triangle(r#"[{"mesh":0}]"#, "");
    assert_eq!(import_bytes("a.gltf", &binary).unwrap().report.triangles, 1);
    let mut document = Document::triangle();
    document.raw_view("{}");
    let json =
        document.json(r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#);
    let json = json.replace(r#"{"byteLength""#, r#"{"uri":"a.bin","byteLength""#);
    let bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let text = import_beside("a.glb", json.as_bytes(), &[("a.bin", &bin)]).unwrap();
    assert_eq!(text.report.triangles, 1);
}

#[test]
fn extensions_that_change_no_shape_may_be_required() {
    for extension in ["KHR_materials_unlit", "KHR_xmp_json_ld", "KHR_texture_basisu", "MSFT_lod"] {
        let more = format!(r#""extensionsRequired":["{extension}"],"#);
        assert_eq!(triangles(&one_triangle(r#"[{"mesh":0}]"#, &more)), 1, "{extension}");
    }
    let other = error(&one_triangle("[]", r#""extensionsRequired":["KHR_gaussian_splatting"],"#));
    assert!(matches!(&other, GltfError::Extension { extension } if extension == "KHR_gaussian_splatting"));
}

#[test]
fn a_matrix_within_rounding_is_read() {
    for row in ["0.000001,-0.000002", "0,0"] {
        for last in ["0.9999999", "1.000001", "1.0"] {
            let [x, y] = row.split_once(',').map(<[&str; 2]>::from).unwrap();
            let node = format!(r#"[{{"mesh":0,"matrix":[1,0,0,{x}, 0,1,0,{y}, 0,0,1,0, 5,6,7,{last}]}}]"#);
            let model: Model = model(&one_triangle(&node, ""));
            assert_eq!(model.objects[0].to_world.translation, glam::DVec3::new(5.0, 6.0, 7.0), "{node}");
        }
    }
}

#[test]
fn nodes_without_a_place_are_left_out_with_all_below_them_and_counted() {
    for (node, why) in [
        (r#""matrix":[1,0,0,1, 0,1,0,0, 0,0,1,0, 0,0,0,1]"#, "the last row of its matrix is not 0 0 0 1"),
        (r#""rotation":[0,0,0,0]"#, "its rotation is not a quaternion"),
        (r#""scale":[1e300,1e300,1]"#, "its matrix is not finite"),
    ] {
        let nodes = format!(
            r#"[{{"mesh":0,"name":"good"}},{{"name":"bad","mesh":0,"children":[2],{node}}},{{"mesh":0}}]"#
        );
        let imported = import_bytes("a.glb", &one_triangle(&nodes, "")).unwrap();
        assert_eq!(names(&imported), ["good"], "{node}");
        let warning = &imported.report.warnings[0];
        assert_eq!((warning.kind, warning.count, &*warning.detail), (WarningKind::NodeLeftOut, 1, why));
        assert_eq!(warning.objects, ["bad"]);
    }
}

#[test]
fn instances_without_a_place_are_left_out_and_counted() {
    let mut document = Document::triangle();
    let places = document.positions(&[[1.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    let file = document.glb(&format!(
        r#""nodes":[{{"mesh":0,"name":"bolt","extensions":{{"EXT_mesh_gpu_instancing":
        {{"attributes":{{"TRANSLATION":{places}}}}}}}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}]"#
    ));
    let imported = import_bytes("a.glb", &file).unwrap();
    let places: Vec<_> = imported.model.objects.iter().map(|object| object.to_world.translation.x).collect();
    assert_eq!(places, [1.0, 3.0]);
    assert_eq!(imported.report.counts(), [(WarningKind::NodeLeftOut, 1)]);
}

#[test]
fn hidden_nodes_are_left_out_with_all_below_them_and_counted() {
    let hidden = r#""extensions":{"KHR_node_visibility":{"visible":false}}"#;
    let shown = r#""extensions":{"KHR_node_visibility":{"visible":true}}"#;
    let nodes = format!(
        r#"[{{"mesh":0,"name":"a",{shown}}},{{"name":"b","children":[2],{hidden}}},{{"mesh":0,"name":"c"}}]"#
    );
    let file = one_triangle(&nodes, r#""extensionsRequired":["KHR_node_visibility"],"#);
    let imported = import_bytes("a.glb", &file).unwrap();
    assert_eq!(names(&imported), ["a"]);
    let warning = &imported.report.warnings[0];
    assert_eq!((warning.kind, warning.count), (WarningKind::HiddenNode, 1));
    assert_eq!(warning.objects, ["b"]);
}

/// Two triangles of five vertices in one mesh, and a good one in another.
fn with_bad_vertex(indices: &[u16]) -> Vec<u8> {
    let mut document = Document::triangle();
    let nan = f32::NAN;
    let five =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [nan, 0.0, 0.0], [f32::INFINITY, 1.0, 0.0]];
    let positions = document.positions(&five);
    let corners = document.indices(indices);
    document.glb(&format!(
        r#""nodes":[{{"mesh":0,"name":"good"}},{{"mesh":1,"name":"bad"}}],"meshes":[{{"primitives":
        [{{"attributes":{{"POSITION":0}}}}]}},{{"primitives":[{{"attributes":{{"POSITION":{positions}}},"indices":{corners}}}]}}]"#
    ))
}

#[test]
fn triangles_with_a_corner_that_is_not_finite_or_not_there_are_left_out_and_counted() {
    for indices in [
        // As many corners as vertices and more, and fewer: all vertices are read, or those that are used.
        &[0, 1, 2, 0, 1, 3, 1, 2, 4, 0, 1, 99][..],
        &[0, 1, 2, 3][..],
    ] {
        let imported = import_bytes("a.glb", &with_bad_vertex(indices)).unwrap();
        let left_out = indices.len() as u64 / 3 - 1;
        assert_eq!((imported.report.triangles, imported.report.objects), (2, 2));
        let warnings = &imported.report.warnings;
        assert_eq!(warnings.len(), usize::from(left_out > 0));
        if let Some(warning) = warnings.first() {
            assert_eq!((warning.kind, warning.count), (WarningKind::TriangleLeftOut, left_out));
            assert_eq!(warning.objects, ["bad"]);
        }
    }
    let none = import_bytes("a.glb", &with_bad_vertex(&[0, 1, 3])).unwrap();
    let counts = none.report.counts();
    assert_eq!(counts, [(WarningKind::TriangleLeftOut, 1), (WarningKind::EmptyObject, 1)]);
}

#[test]
fn buffers_are_found_by_windows_names() {
    let mut document = Document::triangle();
    document.raw_view("{}");
    let json =
        document.json(r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#);
    let folder = tempfile::TempDir::new().unwrap();
    std::fs::create_dir(folder.path().join("buf dir")).unwrap();
    let bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    std::fs::write(folder.path().join("buf dir/a.bin"), &bin).unwrap();
    let path = folder.path().join("a.gltf");
    let import = |uri: &str| {
        std::fs::write(&path, json.replace(r#"{"byteLength""#, &format!(r#"{{"uri":"{uri}","byteLength""#)))
            .unwrap();
        trimaran_cook::import::import(std::slice::from_ref(&path), &Default::default(), &mut |_| {})
    };
    assert_eq!(import(r"buf dir\\a.bin").unwrap().report.triangles, 1);
    assert_eq!(import(r"buf%20dir%5Ca.bin").unwrap().report.triangles, 1);
    assert!(matches!(import(r"..\\a.bin"), Err(ImportError::Gltf { .. })));
}
