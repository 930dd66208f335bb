//! Shapes other than plain arrays of positions, and their attributes.

use glam::Vec3;
use trimaran_cook::Model;
use trimaran_cook::import::WarningKind;
use trimaran_scene::Attribute;

use super::document::Document;
use super::model;

use crate::import_files::{floats, import_bytes};

/// One triangle with two morph targets: by 5 along x, by 2 along y. The second is sparse: its last vertex.
fn morphing(nodes: &str, mesh: &str) -> Vec<u8> {
    let mut document = Document::triangle();
    let along_x = document.positions(&[[5.0, 0.0, 0.0]; 3]);
    let place = document.view(&[2], "");
    let value = document.view(&2.0f32.to_le_bytes().repeat(3), "");
    let along = document.raw_accessor(&format!(
        r#"{{"componentType":5126,"count":3,"type":"VEC3","sparse":{{"count":1,
        "indices":{{"bufferView":{place},"componentType":5121}},"values":{{"bufferView":{value}}}}}}}"#
    ));
    document.glb(&format!(
        r#""nodes":{nodes},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},
        "targets":[{{"POSITION":{along_x}}},{{"POSITION":{along},"NORMAL":0}},{{}}]}}]{mesh}}}]"#
    ))
}

#[test]
fn morph_targets_count_as_the_mesh_or_the_node_says() {
    let file = morphing(
        r#"[{"mesh":0},{"mesh":0,"weights":[0,0.5,1]},{"mesh":0,"weights":[1]},{"mesh":0,"weights":[0,0]}]"#,
        r#","weights":[1,0]"#,
    );
    let morphed = model(&file);
    let place = |object: usize| morphed.meshes[morphed.objects[object].mesh as usize].positions[2];
    assert_eq!(place(0), Vec3::new(5.0, 1.0, 0.0));
    assert_eq!(place(1), Vec3::new(1.0, 2.0, 1.0));
    assert_eq!(place(2), Vec3::new(5.0, 1.0, 0.0));
    assert_eq!(place(3), Vec3::new(0.0, 1.0, 0.0));
    let plain = morphing(r#"[{"mesh":0},{"mesh":0}]"#, "");
    assert_eq!(model(&plain).meshes.len(), 1, "without weights nothing is morphed, and shapes are shared");
}

/// The attributes of an object.
fn said(model: &Model, object: u32) -> Vec<String> {
    let pair = |of: &Attribute| format!("{}={}", of.name, of.value);
    model.hierarchy.attributes_of(object).iter().map(pair).collect()
}

#[test]
fn what_a_mesh_s_extras_say_is_said_of_its_objects() {
    let document = Document::triangle();
    let model = model(&document.glb(
        r#""nodes":[{"name":"tank","mesh":0,"extras":{"TAG":"T-1","note":"mine"}},{"name":"spare","mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}],"extras":{"IfcGUID":"2O2F","note":"the mesh's"}}]"#,
    ));
    assert_eq!(said(&model, 0), ["TAG=T-1", "note=mine", "IfcGUID=2O2F"]);
    assert_eq!(said(&model, 1), ["IfcGUID=2O2F", "note=the mesh's"]);
}

#[test]
fn quantized_positions_of_every_type_are_read() {
    for (component, normalized, bytes, x) in [
        (5120, true, vec![127u8, 0, 0, 0], 1.0),
        (5120, false, vec![100, 0, 0, 0], 100.0),
        (5121, true, vec![51, 0, 0, 0], 0.2),
        (5122, true, vec![0x01, 0x80, 0, 0, 0, 0, 0, 0], -1.0),
        (5123, false, vec![0x10, 0x27, 0, 0, 0, 0, 0, 0], 10_000.0),
        (5123, true, vec![0xff, 0xff, 0, 0, 0, 0, 0, 0], 1.0),
    ] {
        let mut document = Document::default();
        let stride = bytes.len();
        let mut along_y = vec![0; stride];
        along_y[stride / 4] = 1;
        let all = [bytes, vec![0; stride], along_y].concat();
        let view = document.view(&all, &format!(r#","byteStride":{stride}"#));
        document.raw_accessor(&format!(
            r#"{{"bufferView":{view},"componentType":{component},"normalized":{normalized},"count":3,"type":"VEC3"}}"#
        ));
        let file = document.glb(
            r#""extensionsRequired":["KHR_mesh_quantization"],"nodes":[{"mesh":0}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#,
        );
        let at = model(&file).meshes[0].positions[0];
        assert!((at.x - x).abs() < 1e-6 && at.y == 0.0, "{component}: {at}");
    }
}

/// A document with a table of two rows, tags and bores; its classes are in `schema`.
fn tagged(document: &mut Document, schema: &str) -> String {
    let texts = document.view(b"P-1P-22", "");
    let ends = document.view(&[0, 3, 7], "");
    let bores = document.view(&[80, 0, 100, 0], "");
    format!(
        r#""extensions":{{"EXT_structural_metadata":{{{schema},"propertyTables":[{{"class":"pipe","count":2,
        "properties":{{"name":{{"values":{texts},"stringOffsets":{ends},"stringOffsetType":"UINT8"}},
        "bore":{{"values":{bores}}}}}}}]}}}}"#
    )
}

const SCHEMA: &str = r#""schema":{"classes":{"pipe":{"properties":{"name":{"type":"STRING"},
    "bore":{"name":"Bore, mm","type":"SCALAR","componentType":"UINT16"}}}}}"#;

/// Three triangles: of feature 0, of feature 1, and of none.
fn featured(schema: &str) -> Vec<u8> {
    let mut document = Document::default();
    let corner = |at: usize| [[0.0, 1.0, 0.0][at % 3], [0.0, 0.0, 1.0][at % 3], (at / 3) as f32];
    let position = document.positions(&(0..9).map(corner).collect::<Vec<_>>());
    let ids = document.accessor(&floats(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 9.0, 9.0, 9.0]), 5126, "SCALAR", 9);
    let table = tagged(&mut document, schema);
    document.glb(&format!(
        r#""nodes":[{{"name":"line 7","mesh":0,"extras":{{"area":"A"}}}}],"meshes":[{{"primitives":[{{"attributes":
        {{"POSITION":{position},"_FEATURE_ID_0":{ids}}},"extensions":{{"EXT_mesh_features":{{"featureIds":
        [{{"featureCount":2}},{{"featureCount":2,"attribute":0,"propertyTable":0,"nullFeatureId":9}}]}}}}}}]}}],{table}"#
    ))
}

#[test]
fn features_of_a_mesh_become_objects_with_their_rows_as_attributes() {
    let imported = import_bytes("a.glb", &featured(SCHEMA)).unwrap();
    let model = &imported.model;
    let names: Vec<_> = model.objects.iter().map(|object| &*object.name).collect();
    assert_eq!(names, ["line 7", "P-1", "P-22"]);
    assert_eq!(said(model, 0), Vec::<String>::new());
    assert_eq!(said(model, 1), ["Bore, mm=80", "name=P-1"]);
    assert_eq!(said(model, 2), ["Bore, mm=100", "name=P-22"]);
    let heights: Vec<_> =
        [0, 1, 2].map(|object| model.meshes[model.objects[object].mesh as usize].positions[0].z).into();
    assert_eq!(heights, [2.0, 0.0, 1.0]);
    let group = &model.hierarchy.groups[1];
    assert_eq!((&*group.name, group.objects.clone(), &*group.attributes[0].value), ("line 7", 0..3, "A"));
    assert_eq!(imported.report.warnings, []);
}

#[test]
fn instances_have_their_rows_as_attributes() {
    for ids in [r#""propertyTable":0"#, r#""attribute":0,"propertyTable":0"#] {
        let mut document = Document::triangle();
        let places = document.positions(&[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let numbers = document.accessor(&floats(&[1.0, 0.0]), 5126, "SCALAR", 2);
        let table = tagged(&mut document, SCHEMA);
        let model = model(&document.glb(&format!(
            r#""nodes":[{{"name":"bolt","mesh":0,"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":
            {{"TRANSLATION":{places},"_FEATURE_ID_0":{numbers}}}}},"EXT_instance_features":{{"featureIds":[{{{ids}}}]}}}}}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],{table}"#
        )));
        let mut names: Vec<_> = model.objects.iter().map(|object| &*object.name).collect();
        assert_eq!(said(&model, 0)[1], format!("name={}", names[0]));
        if ids.starts_with(r#""attribute""#) {
            names.reverse();
        }
        assert_eq!(names, ["P-1", "P-22"]);
    }
}

#[test]
fn metadata_that_no_object_can_bear_is_warned_about() {
    let mut document = Document::triangle();
    let table = tagged(&mut document, SCHEMA);
    let plain = document.glb(&format!(
        r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],{table}"#
    ));
    let imported = import_bytes("a.glb", &plain).unwrap();
    let warning = &imported.report.warnings[0];
    assert_eq!((warning.kind, warning.count), (WarningKind::MetadataLeftOut, 1));
    assert!(warning.detail.contains("\"pipe\": no object refers to it"), "{warning:?}");
    let elsewhere = import_bytes("a.glb", &featured(r#""schemaUri":"a.json""#)).unwrap();
    assert_eq!(elsewhere.report.objects, 3);
    let warning = &elsewhere.report.warnings[0];
    assert_eq!(&*warning.detail, "class pipe: it is not in the schema");
    let bad = SCHEMA.replace("UINT16", "FLOAT64");
    let unread = import_bytes("a.glb", &featured(&bad)).unwrap();
    assert_eq!(said(&unread.model, 1), ["name=P-1"]);
    assert_eq!(&*unread.report.warnings[0].detail, "property bore: it has too few values");
}
