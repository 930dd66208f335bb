//! Imports real scenes and compares counts with known ones. Needs the data folder: see `Data`.

use std::collections::HashSet;
use std::path::PathBuf;

use data::Data;
use glam::DVec3;
use trimaran_cook::import::{ImportOptions, Imported, WarningKind, import};
use trimaran_scene::Attribute;

/// Shared with the whole program's tests on real models.
#[path = "../../../../tests/common/data.rs"]
#[allow(dead_code, unreachable_pub, reason = "each test file uses its part of this")]
mod data;

fn import_files(files: &[PathBuf]) -> Imported {
    import(files, &ImportOptions::default(), &mut |_| {}).unwrap()
}

#[test]
fn platform_in_14_copies() {
    let Some(data) = Data::find() else { return };
    let Imported { model, report } = import_files(&[data.unpacked("huldra_x14_13Mtri.glb")]);
    assert_eq!((report.objects, report.meshes), (135_830, 3_951));
    assert_eq!((report.triangles, report.unique_triangles), (12_804_256, 658_592));
    assert_eq!(report.counts(), [(WarningKind::NoArea, 14 * 7)]);
    assert_eq!(model.sources[0].name, "huldra_x14_13Mtri.glb");
}

#[test]
fn town_hall_with_sheared_nodes() {
    let Some(data) = Data::find() else { return };
    let Imported { model, report } = import_files(&[data.unpacked("ldraw_town_hall_1.3Mtri.glb")]);
    assert_eq!((report.objects, report.meshes), (2_799, 345));
    assert_eq!((report.triangles, report.unique_triangles), (1_307_423, 309_303));

    // Axes more than 0.1 milliradian off a right angle.
    let sheared = model.objects.iter().filter(|object| {
        let m = object.to_world.matrix3;
        let cosine = |a: DVec3, b: DVec3| a.dot(b).abs() / (a.length() * b.length());
        [cosine(m.x_axis, m.y_axis), cosine(m.y_axis, m.z_axis), cosine(m.z_axis, m.x_axis)]
            .iter()
            .any(|&cosine| cosine > 1e-4)
    });
    assert_eq!(sheared.count(), 22);
    let nodes: HashSet<u32> = model.objects.iter().map(|object| object.source_index).collect();
    assert_eq!(nodes.len(), 2_799);
    // The parts are placed y down, and the root swaps y and z: the hall stands on its floor.
    let heights = model.objects.iter().map(|object| object.to_world.translation.y);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(y), high.max(y)));
    assert!(low == 0.0 && (0.49..0.50).contains(&high), "from {low} to {high}");
}

#[test]
fn city_at_full_size() {
    let Some(data) = Data::find() else { return };
    let Imported { report, .. } = import_files(&[data.unpacked("ldraw_city_88Mtri.glb")]);
    assert_eq!((report.objects, report.meshes), (128_635, 1_791));
    assert_eq!((report.triangles, report.unique_triangles), (87_606_788, 2_582_126));
}

#[test]
fn platform_from_its_review_files() {
    let Some(data) = Data::find() else { return };
    let Imported { model, report } = import_files(&data.platform());
    // 129 more have no triangle.
    assert_eq!((report.files, report.objects, report.meshes), (8, 9_720, 9_720));
    assert_eq!(model.sources[3].name, "HA-MECH.RVM");
    // With the whole tolerance for each direction of a torus, evenly all around, there would be 0.92 million;
    // with half of it for each, 1.03 million. No curve here is large enough for its tolerance to depend on
    // its size.
    assert_eq!(report.triangles, 950_820);
    // Sheared snouts and eccentric pyramids, whose stored boxes are loose; an independent reader finds 232.
    assert!(report.box_mismatches <= 232, "{}", report.box_mismatches);
    // One of the files has its attributes beside it.
    assert_eq!((report.parts, report.parts_matched), (3_214, 3_214));
    assert_eq!(report.counts(), [(WarningKind::NoArea, 7), (WarningKind::EmptyObject, 129)]);
}

#[test]
fn every_part_has_the_attributes_of_its_own_path() {
    let Some(data) = Data::find() else { return };
    let mut files = data.platform();
    files.retain(|file| file.ends_with("WD1-PSUP.RVM"));
    let Imported { model, .. } = import_files(&files);
    let hierarchy = &model.hierarchy;
    let value = |attributes: &[Attribute], name: &str| {
        attributes.iter().find(|of| *of.name == *name).map(|of| of.value.to_string())
    };
    // Groups below the file's, and objects. Those with a name of their own have it as attribute.
    let groups = hierarchy.groups.iter().skip(1).map(|group| (&*group.name, &*group.attributes));
    let objects = (0..).zip(&model.objects).map(|(id, of)| (&*of.name, hierarchy.attributes_of(id)));
    let (mut parts, mut own) = (0, 0);
    for (name, attributes) in groups.chain(objects) {
        assert!(value(attributes, "Type").is_some(), "{name}: {attributes:?}");
        if let Some(said) = value(attributes, "Name") {
            assert_eq!(said, name);
            own += 1;
        }
        parts += 1;
    }
    assert_eq!(parts, 3_214);
    assert!(own > 100, "{own}");
    let site = hierarchy.groups.iter().find(|group| *group.name == *"/WD1-PSUP").unwrap();
    assert_eq!(value(&site.attributes, "Description").unwrap(), "PSUP - HC - WEATHER DECK");
}

/// Small files of kinds that other readers accept, described in the folder's own README.
#[test]
fn small_gltf_files_that_other_readers_bear() {
    let Some(data) = Data::find() else { return };
    let read = |name: &str| import(&[data.small(name)], &ImportOptions::default(), &mut |_| {});
    let good = |name: &str| read(name).unwrap_or_else(|error| panic!("{name}: {error}"));
    let boxes = [
        "40-specgloss.gltf",
        "41-version-2.1.gltf",
        "42-integer-as-float.gltf",
        "44-matrix-w.gltf",
        "49-mesh-extras.gltf",
        "50-morph-weights.gltf",
        "51-palette-texture.gltf",
        "53-glb-called-gltf.gltf",
        "54-backslash-uri.gltf",
        "56-null-children.gltf",
    ];
    for name in boxes {
        let report = good(name).report;
        assert_eq!((report.triangles, report.objects, report.warnings), (12, 1, vec![]), "{name}");
    }
    let colour = |name: &str, mesh: usize| good(name).model.meshes[mesh].colours[0].0;
    assert_eq!(colour("40-specgloss.gltf", 0), [231, 63, 63, 255]);
    assert_eq!(colour("47-blend.gltf", 0)[3], 64);
    let [red, green, blue, _] = colour("51-palette-texture.gltf", 0);
    assert!(green > 2 * red && green > 2 * blue, "{red} {green} {blue}");
    let gradient = good("52-vertex-colour-gradient.gltf").model;
    let colours: HashSet<[u8; 4]> = gradient.meshes[0].colours.iter().map(|colour| colour.0).collect();
    assert!(colours.len() > 12, "{}", colours.len());
    let attributes = good("49-mesh-extras.gltf").model.hierarchy.attributes_of(0).to_vec();
    assert_eq!((&*attributes[0].name, &*attributes[0].value), ("IfcGUID", "2O2Fr$t4X7Zf8NOew3FL9r"));
    let morphed = good("50-morph-weights.gltf").model;
    assert!(morphed.meshes[0].positions.iter().all(|position| position.x >= 5.0));
    for (name, kind) in [
        ("46-nan-one-vertex.gltf", WarningKind::TriangleLeftOut),
        ("48-hidden.gltf", WarningKind::HiddenNode),
        ("57-structural-metadata.gltf", WarningKind::MetadataLeftOut),
        ("45-draco-used-only.gltf", WarningKind::PrimitiveLeftOut),
    ] {
        assert_eq!(good(name).report.counts()[0].0, kind, "{name}");
    }
    let said = read("43-gltf1.gltf").unwrap_err().to_string();
    assert!(said.contains("glTF 1.0") && said.contains("convert"), "{said}");
    let said = good("45-draco-used-only.gltf").report.warnings[0].to_string();
    assert!(said.contains("KHR_draco_mesh_compression") && said.contains("gltf-transform"), "{said}");
}
