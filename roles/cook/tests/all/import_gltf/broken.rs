//! Files with one broken part: only that part is lost, and a warning reports it.

use trimaran_cook::import::WarningKind as Kind;
use trimaran_cook::import::{ImportError, Imported};

use crate::import_files::{floats, glb, import_bytes};

const GOOD: &str = r#"{"mesh":0,"name":"good"}"#;
const BAD: &str = r#"{"mesh":1,"name":"bad","translation":[5,0,0]}"#;
const PRIMITIVE: &str = r#"{"attributes":{"POSITION":2},"indices":1,"material":0}"#;
const MATERIAL: &str = r#"{"name":"red","pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]}}"#;
const ACCESSOR: &str = r#"{"bufferView":2,"componentType":5126,"count":3,"type":"VEC3"}"#;
const BUFFER: &str = r#"{"byteLength":80}"#;
const NAMED: &str = r#""name":"good""#;
const BAD_NAMED: &str = r#""name":"bad""#;
const PLACE: &str = r#""translation":[5,0,0]"#;
const POSITION: &str = r#""attributes":{"POSITION":2}"#;

/// Two objects of a triangle each; the broken parts below belong to the second.
fn document() -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],"nodes":[{GOOD},{BAD}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}},
            {{"name":"m","primitives":[{PRIMITIVE}]}}],
        "materials":[{MATERIAL}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
            {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}},{ACCESSOR}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":6}},
            {{"buffer":0,"byteOffset":44,"byteLength":36}}],
        "buffers":[{BUFFER}]}}"#
    )
}

fn bin() -> Vec<u8> {
    let corners = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    [&corners[..], &[0, 0, 1, 0, 2, 0, 0, 0], &corners[..]].concat()
}

/// The document with a part of its JSON replaced.
fn rewritten(part: &str, other: &str) -> String {
    let json = document();
    assert!(json.contains(part), "{part}");
    json.replacen(part, other, 1)
}

fn import(json: &str) -> Result<Imported, ImportError> {
    import_bytes("a.glb", &glb(json, &bin()))
}

/// A part of the document, its replacement, how many objects are left, and the warnings: their kinds, and a
/// part of the first one's text.
type Case<'a> = (&'a str, &'a str, u64, &'a [Kind], &'a str);

fn check(cases: &[Case<'_>]) {
    for &(part, other, objects, kinds, said) in cases {
        let imported = import(&rewritten(part, other)).unwrap_or_else(|why| panic!("{other}: {why}"));
        let report = imported.report;
        assert_eq!((report.objects, report.triangles), (objects, objects), "{other}: {:?}", report.warnings);
        let found: Vec<Kind> = report.warnings.iter().map(|warning| warning.kind).collect();
        assert_eq!(found, kinds, "{other}");
        let first = report.warnings.first().map(ToString::to_string).unwrap_or_default();
        assert!(first.contains(said), "{other}: {first:?} does not say {said:?}");
    }
}

#[test]
fn the_document_itself_is_sound() {
    check(&[("", "", 2, &[], "")]);
}

#[test]
fn what_can_be_meant_in_one_way_only_is_read_so_without_a_word() {
    for (part, others) in [
        (NAMED, &[r#""name":7"#, r#""name":null"#, r#""skin":-1"#, r#""mesh":0,"name":"x""#][..]),
        (r#"[5,0,0]"#, &[r#"["5","0",0]"#, r#"{"0":5,"1":0,"2":0}"#, "[]", "{}", "null"]),
        (r#"[1,0,0,1]"#, &["[1,0,0]"]),
        (MATERIAL, &[r#"{"name":1,"alphaMode":"opaque","alphaCutoff":"0.5"}"#]),
        (r#""count":3,"type":"VEC3"}],"#, &[r#""count":3,"type":"VEC3"},{"count":3},{}],"#]),
        (
            r#""count":3"#,
            &[r#""count":"3","normalized":0,"sparse":{}"#, r#""count":3,"min":["a"],"sparse":{"count":0}"#],
        ),
        (r#"{"buffer":0,"byteLength":36}"#, &[r#"{"buffer":0,"byteLength":36,"byteStride":0}"#]),
        (BUFFER, &[r#"{"byteLength":99}"#, r#"{"byteLength":"80"}"#]),
        (r#""version":"2.0""#, &[r#""version":"2.0.0""#, r#""version":" 2.0 ""#]),
    ] {
        others.iter().for_each(|other| check(&[(part, other, 2, &[], "")]));
    }
}

#[test]
fn a_value_that_is_not_what_it_should_be_costs_itself() {
    let field = &[Kind::FieldLeftOut][..];
    check(&[
        (NAMED, r#""children":{"a":1}"#, 2, field, "children: invalid type: map"),
        (NAMED, r#""children":["x"]"#, 2, field, r#"first in "node 0""#),
        (NAMED, r#""extensions":{"KHR_node_visibility":7},"name":"g""#, 2, field, "KHR_node_visibility"),
        (r#"[1,0,0,1]"#, "[null,0,0,1]", 2, field, r#"taken as 1); first in "red""#),
        (MATERIAL, r#"{"alphaMode":1}"#, 2, field, "alphaMode: invalid type: integer `1`"),
        (MATERIAL, "7", 2, field, "material 0"),
        (r#""materials":["#, r#""images":{"a":1},"materials":["#, 2, field, "each image"),
        (r#""name":"m""#, r#""name":"m","weights":[null]"#, 2, field, "taken as 0"),
        (
            r#""asset""#,
            r#""extensions":{"EXT_structural_metadata":"x"},"asset""#,
            2,
            field,
            "EXT_structural_metadata",
        ),
        (POSITION, r#""attributes":{"POSITION":2,"COLOR_0":1}"#, 2, field, "colours of vertices"),
        (POSITION, r#""attributes":{"POSITION":2,"COLOR_0":9}"#, 2, field, "accessor 9"),
        (r#""indices":1,"material""#, r#""indices":1,"targets":[{"POSITION":9}],"material""#, 2, &[], ""),
        (BAD_NAMED, r#""name":"bad","extensions":{"EXT_mesh_gpu_instancing":{}}"#, 2, field, "placed once"),
        (r#""scenes":["#, r#""scenes":[],"scenes":["#, 2, &[], ""),
        // An empty part takes nothing from the others.
        (r#""scenes":["#, r#""extensionsRequired":[],"scenes":[],"scenes":["#, 2, &[], ""),
    ]);
    let morphed = rewritten(
        r#""name":"m","primitives":[{"#,
        r#""weights":[1],"primitives":[{"targets":[{"POSITION":9}],"#,
    );
    let report = import(&morphed).unwrap().report;
    assert_eq!((report.objects, report.counts()), (2, vec![(Kind::FieldLeftOut, 1)]));
}

#[test]
fn a_broken_primitive_or_what_it_needs_costs_its_object() {
    let broken = &[Kind::PrimitiveLeftOut, Kind::EmptyObject][..];
    let field = &[Kind::FieldLeftOut, Kind::PrimitiveLeftOut, Kind::EmptyObject][..];
    let draco =
        r#"{"attributes":{"POSITION":2},"extensions":{"KHR_draco_mesh_compression":{"bufferView":0}}}"#;
    let bare = r#"{"componentType":5126,"count":3,"type":"VEC3"}"#;
    check(&[
        (PRIMITIVE, r#"{"attributes":{"POSITION":2},"mode":7}"#, 1, broken, "its mode 7 is unknown"),
        (PRIMITIVE, r#"{"attributes":{"NORMAL":2}}"#, 1, broken, r#"it has no positions); first in "bad""#),
        (PRIMITIVE, r#"{"attributes":{"POSITION":9}}"#, 1, broken, "accessor 9: it does not exist"),
        (PRIMITIVE, r#"{"attributes":{"POSITION":1}}"#, 1, broken, "number of components"),
        (PRIMITIVE, r#"{"attributes":[]}"#, 1, field, "primitives.attributes: invalid type"),
        (
            ACCESSOR,
            r#"{"bufferView":2,"componentType":5126,"count":300,"type":"VEC3"}"#,
            1,
            broken,
            "past the end",
        ),
        (
            ACCESSOR,
            r#"{"bufferView":2,"componentType":5126,"count":2.5,"type":"VEC3"}"#,
            1,
            field,
            "a whole number",
        ),
        (
            r#""byteOffset":44,"byteLength":36"#,
            r#""byteOffset":44,"byteLength":-36"#,
            1,
            field,
            "byteLength: a negative",
        ),
        (
            r#"{"buffer":0,"byteOffset":44"#,
            r#"{"buffer":7,"byteOffset":44"#,
            1,
            broken,
            "its buffer does not exist",
        ),
        (BUFFER, r#"{"byteLength":70}"#, 1, broken, "past the end"),
    ]);
    // The accessor has no bytes of its own.
    let json = rewritten(PRIMITIVE, draco).replace(ACCESSOR, bare);
    let report = import(&json).unwrap().report;
    assert_eq!((report.objects, report.warnings[0].kind), (1, Kind::PrimitiveLeftOut));
    assert!(report.warnings[0].detail.starts_with("KHR_draco_mesh_compression: "), "{:?}", report.warnings);
    let view = r#""byteOffset":44,"byteLength":36"#;
    let packed = r#""byteOffset":80,"byteLength":36,"extensions":{"EXT_meshopt_compression":{"buffer":0,
        "byteLength":36,"byteStride":12,"count":3,"mode":"ATTRIBUTES"}}"#;
    let bytes = &[Kind::BytesLeftOut, Kind::PrimitiveLeftOut, Kind::EmptyObject][..];
    check(&[(view, packed, 1, bytes, r#"compressed bytes are damaged); first in "buffer view 2""#)]);
}

#[test]
fn a_node_that_has_no_place_costs_itself() {
    let left_out = &[Kind::NodeLeftOut][..];
    let instanced = |attributes: &str| {
        format!(
            r#""name":"bad","extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{{attributes}}}}}}}"#
        )
    };
    check(&[
        ("[5,0,0]", "[null,0,0]", 1, left_out, "its matrix is not finite"),
        ("[5,0,0]", r#""five""#, 1, left_out, r#"first in "bad""#),
        ("[5,0,0]", "[5,0]", 1, left_out, "its matrix is not finite"),
        ("[5,0,0]", "[1e39,0,0]", 1, left_out, "farther than 1e15 m"),
        (PLACE, r#""scale":[1e60,1e60,1e60]"#, 1, left_out, "farther than 1e15 m"),
        (PLACE, r#""rotation":[0,0,1]"#, 1, left_out, "its rotation is not a quaternion"),
        (PLACE, r#""matrix":[1,0,0,0,0,1,0,0,0,0,1,0]"#, 1, left_out, "not 16 numbers"),
        (BAD_NAMED, &instanced(r#""TRANSLATION":9"#), 1, left_out, "instances: accessor 9"),
        (BAD_NAMED, &instanced(r#""_ID":0"#), 4, &[], ""),
    ]);
}

#[test]
fn references_that_lead_nowhere_or_in_a_circle_are_left_out() {
    let nowhere = &[Kind::ReferenceLeftOut][..];
    let with_child = |children: &str| format!(r#""name":"good","children":{children}"#);
    check(&[
        (
            PRIMITIVE,
            r#"{"attributes":{"POSITION":2},"material":9}"#,
            2,
            nowhere,
            "its material 9 does not exist",
        ),
        (r#"{"mesh":1,"#, r#"{"mesh":9,"#, 1, nowhere, "its mesh does not exist"),
        (r#"{"mesh":1,"#, r#"{"mesh":-1,"#, 1, &[], ""),
        (NAMED, &with_child("[9]"), 2, nowhere, r##"it does not exist); first in "#9""##),
        (NAMED, &with_child("[0]"), 2, nowhere, "its own ancestor"),
        (NAMED, &with_child("[1,1]"), 2, &[Kind::ReferenceLeftOut], "two parents"),
        (r#""nodes":[0,1]"#, r#""nodes":[0,1,9]"#, 2, nowhere, "it does not exist"),
        (r#""scene":0"#, r#""scene":3"#, 2, nowhere, r#"first in "scene 3""#),
        (r#""scenes":[{"nodes":[0,1]}],"#, "", 2, nowhere, "scene 0"),
        (r#""nodes":[0,1]"#, r#""nodes":[]"#, 2, nowhere, "the scene has no mesh"),
        (r#""nodes":[0,1]"#, r#""nodes":[0]"#, 1, &[Kind::OutsideScene], r#"first in "bad""#),
        (r#"[{"nodes":[0,1]}]"#, r#"[{"nodes":[0]},{"nodes":[1]}]"#, 1, &[Kind::OutsideScene], "first in"),
    ]);
    // A root that is also a child is placed by its parent.
    let json = rewritten(r#""nodes":[0,1]"#, r#""nodes":[1,0]"#)
        .replace(NAMED, r#""name":"good","translation":[1,0,0],"children":[1]"#);
    let model = import(&json).unwrap().model;
    assert_eq!(
        model.objects.iter().map(|object| object.to_world.translation.x).collect::<Vec<_>>(),
        [1.0, 6.0]
    );
    // Nodes below a hidden node are hidden, and not outside of the scene.
    let hidden = r#"{"extensions":{"KHR_node_visibility":{"visible":0}},"children":[2]},{"mesh":0}"#;
    check(&[(BAD, hidden, 1, &[Kind::HiddenNode], "1 hidden nodes")]);
}

#[test]
fn objects_without_area_are_kept_by_name_and_counted() {
    let indices = r#"{"bufferView":1,"byteOffset":4,"componentType":5121,"count":3,"type":"SCALAR"}"#;
    let json = rewritten(r#""byteOffset":36,"byteLength":6"#, r#""byteOffset":36,"byteLength":8"#)
        .replace(PRIMITIVE, r#"{"attributes":{"POSITION":2},"indices":3}"#)
        .replace(ACCESSOR, &format!("{ACCESSOR},{indices}"));
    let report = import(&json).unwrap().report;
    assert_eq!((report.objects, report.counts()), (2, vec![(Kind::NoArea, 1)]));
}

#[test]
fn text_that_is_not_quite_json_is_read() {
    let json = document();
    let mended = &[Kind::JsonMended][..];
    check(&[
        (
            "[5,0,0]",
            "[NaN,0,0]",
            1,
            &[Kind::JsonMended, Kind::NodeLeftOut],
            "no finite numbers taken as null",
        ),
        ("[5,0,0]", r#"[5,0,0],"extras":[-Infinity,1e400]"#, 2, mended, "2 places"),
        (BAD_NAMED, r#""name":"b\ud800d""#, 2, mended, "letters that are written wrongly"),
        (BAD_NAMED, "\"name\":\"b\td\"", 2, &[], ""),
        (BAD_NAMED, r#""name":"C:\dir""#, 2, mended, "letters that are written wrongly"),
        (r#""nodes":[0,1]"#, r#""nodes":[0,1,]"#, 2, mended, "commas before a bracket"),
        (
            "[5,0,0]",
            &format!(r#"[5,0,0],"extras":{}{}"#, "[".repeat(900), "]".repeat(900)),
            2,
            mended,
            "too deep",
        ),
    ]);
    for behind in ["\0\0\0", " \r\n\0", "// end"] {
        let report = import(&(json.clone() + behind)).unwrap().report;
        assert_eq!(
            (report.objects, report.warnings.len()),
            (2, usize::from(behind == "// end")),
            "{behind:?}"
        );
    }
    let mut file = glb(&rewritten("bad", "Beh?lter"), &bin());
    let at = file.windows(4).position(|four| four == b"Beh?").unwrap();
    file[at + 3] = 0xe4;
    let imported = import_bytes("a.glb", &file).unwrap();
    assert_eq!(imported.model.objects[1].name, "Behälter");
    assert_eq!(imported.report.counts(), [(Kind::JsonMended, 1)]);
}

#[test]
fn where_nothing_is_left_the_first_cause_is_told() {
    for (part, other, said) in [
        (r#""byteLength":80"#, r#""byteLength":80,"uri":"lost.bin""#, "lost.bin"),
        (
            r#""nodes":[{"mesh":0"#,
            r#""nodes":[{"mesh":7"#,
            "node 0 (good) is malformed: its mesh does not exist; export",
        ),
        (
            r#"{"mesh":0,"name":"good"}"#,
            r#"{"mesh":0,"translation":[null,0,0]}"#,
            "node 0 (#0) is malformed: its matrix",
        ),
        (
            r#""componentType":5126"#,
            r#""componentType":{}"#,
            "accessor 0 is malformed: componentType: invalid type",
        ),
    ] {
        // The second object has no mesh.
        let json = rewritten(part, other).replace(r#"{"mesh":1,"#, "{");
        let why = import(&json).unwrap_err().to_string();
        assert!(why.contains("a.glb: ") && why.contains(said), "{other}: {why}");
    }
    let cut = &document()[..300];
    let why = import(cut).unwrap_err().to_string();
    assert!(why.contains("JSON does not parse") && why.contains("export it again"), "{why}");
}

#[test]
fn a_buffer_that_is_not_there_costs_what_needs_it() {
    let unused = r#"{"byteLength":80},{"uri":"lost.bin","byteLength":4}"#;
    check(&[
        (BUFFER, unused, 2, &[Kind::BytesLeftOut], "lost.bin"),
        (BUFFER, r#"{"byteLength":80},{"byteLength":4}"#, 2, &[Kind::BytesLeftOut], r#"first in "buffer 1""#),
    ]);
}

#[test]
fn required_extensions_that_change_no_shape_are_told_and_others_refused() {
    let require = |name: &str| format!(r#""extensionsRequired":["{name}"],"asset""#);
    for name in ["ADOBE_materials_thin_transparency", "VRMC_vrm", "AGI_articulations", "KHR_techniques_webgl"]
    {
        check(&[(r#""asset""#, &require(name), 2, &[Kind::ExtensionLeftOut], name)]);
    }
    for name in ["CESIUM_RTC", "EXT_primitive_voxels"] {
        let why = import(&rewritten(r#""asset""#, &require(name))).unwrap_err().to_string();
        assert!(why.contains(name), "{why}");
    }
}
