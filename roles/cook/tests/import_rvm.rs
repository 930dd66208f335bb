//! RVM files written by hand: groups, colours, units, and how each fault is told.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: a failure is a test's failure")]
#![allow(dead_code, reason = "each test file uses its part of the helpers")]

mod import_files;

use glam::{DVec3, Vec3};
use import_files::{RvmWriter, import_beside, import_bytes, reals, word};
use trimaran_cook::import::{ImportError, ImportOptions, RvmError, UpAxis, WarningKind, import};
use trimaran_scene::Rgba8;

fn error(file: &[u8]) -> RvmError {
    match import_bytes("a.rvm", file) {
        Err(ImportError::Rvm { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

#[test]
fn groups_with_primitives_become_objects() {
    let file = RvmWriter::new()
        .open("/SITE", 0)
        .open("/PUMP", 2)
        .cuboid([1.0, 2.0, 3.0], [1000.0, 2000.0, 4000.0])
        .open("/PUMP/N1", 5)
        .cuboid([0.0; 3], [1.0; 3])
        .close()
        .cuboid([1.0, 2.0, 6.0], [1000.0, 2000.0, 2000.0])
        .close()
        .close()
        .chunk("COLR", &[word(1), word(5), vec![1, 2, 3, 0]].concat())
        .finish();
    let imported = import_bytes("a.RVM", &file).unwrap();
    let objects: Vec<_> = imported.model.objects.iter().map(|o| (o.name.as_str(), o.source_index)).collect();
    assert_eq!(objects, [("/PUMP", 1), ("/PUMP/N1", 2)]);
    let pump = &imported.model.meshes[0];
    assert_eq!(pump.triangle_count(), 24);
    // z up turns into y up; the two boxes are 6 m high together, from 1 m to 7 m.
    // 0.001 is not exactly a float.
    let place = imported.model.objects[0].to_world.translation;
    assert!(place.distance(DVec3::new(1.0, 4.0, -2.0)) < 1e-6, "{place}");
    let high = pump.positions.iter().fold(Vec3::MIN, |high, &p| high.max(p));
    assert!(high.distance(Vec3::new(0.5, 3.0, 1.0)) < 1e-6, "{high}");
    assert_eq!(pump.colours[0], Rgba8([0xcc, 0, 0, 255]));
    assert_eq!(imported.model.meshes[1].colours[0], Rgba8([1, 2, 3, 255]));
    assert_eq!(imported.report.box_mismatches, 0);
}

#[test]
fn unit_axis_and_tolerance_are_the_callers() {
    let file = RvmWriter::new()
        .open("/PIPE", 1)
        .primitive(8, [0.0, 0.0, 1.0], [-500.0, -500.0, -1.0], [500.0, 500.0, 1.0], &reals(&[500.0, 2.0]))
        .close()
        .finish();
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("a.rvm");
    std::fs::write(&path, file).unwrap();
    let run = |options: ImportOptions| import(std::slice::from_ref(&path), &options, &mut |_| {}).unwrap();

    let coarse = run(ImportOptions::default());
    // 500 mm at 1 mm: a half angle of acos(1 - 1/500), so 50 chords.
    assert_eq!(coarse.report.triangles, 50 * 4 - 4);
    let metres =
        ImportOptions { unit: Some(1.0), up: Some(UpAxis::Y), chord_tolerance: 1.0, ..Default::default() };
    let scaled = run(metres);
    assert_eq!(scaled.report.triangles, 50 * 4 - 4);
    assert_eq!(scaled.model.objects[0].to_world.translation, DVec3::new(0.0, 0.0, 1000.0));
    let triangles_at =
        |chord_tolerance| run(ImportOptions { chord_tolerance, ..Default::default() }).report.triangles;
    assert_eq!(triangles_at(1e-4), 158 * 4 - 4);
    // Finer than a ten-thousandth of the radius is no curve cut.
    assert_eq!([triangles_at(1e-5), triangles_at(1e-9)], [223 * 4 - 4; 2]);
}

#[test]
fn what_has_no_surface_is_left_out_and_counted() {
    let file = RvmWriter::new()
        .open("/AXIS", 1)
        .primitive(10, [0.0; 3], [0.0; 3], [5.0, 0.0, 0.0], &reals(&[0.0, 5.0]))
        .chunk("INSU", &[0; 8])
        .close()
        .finish();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!(imported.report.objects, 0);
    assert_eq!(imported.report.counts(), [(WarningKind::VolumeLeftOut, 1), (WarningKind::EmptyObject, 1)]);
}

#[test]
fn a_primitive_that_does_not_fill_its_box_is_counted() {
    let size = reals(&[10.0, 10.0, 10.0]);
    let file = RvmWriter::new()
        .open("/A", 1)
        .primitive(2, [0.0; 3], [-5.0; 3], [5.0, 5.0, 8.0], &size)
        .primitive(2, [0.0; 3], [-5.0; 3], [5.0, 5.0, f32::NAN], &size)
        .close()
        .finish();
    assert_eq!(import_bytes("a.rvm", &file).unwrap().report.box_mismatches, 2);
}

#[test]
fn faults_are_told_with_their_place() {
    let open = || RvmWriter::new().open("/PUMP", 1);
    let nan = open().primitive(8, [0.0; 3], [0.0; 3], [0.0; 3], &reals(&[f32::NAN, 1.0])).close().finish();
    assert!(matches!(error(&nan), RvmError::Unusable { group, .. } if group == "/PUMP"));
    let far = open().cuboid([f32::INFINITY, 0.0, 0.0], [1.0; 3]).close().finish();
    assert!(matches!(error(&far), RvmError::Unusable { what, .. } if what.contains("matrix")));
    let kind = open().primitive(12, [0.0; 3], [0.0; 3], [0.0; 3], &[]).close().finish();
    assert!(matches!(error(&kind), RvmError::UnknownPrimitive { kind: 12, .. }));
    let short = open().primitive(8, [0.0; 3], [0.0; 3], [0.0; 3], &reals(&[1.0])).close().finish();
    assert!(matches!(error(&short), RvmError::Truncated { what: "a cylinder", .. }));
    let chunk = open().chunk("WHAT", &[]).close().finish();
    assert!(matches!(error(&chunk), RvmError::UnknownChunk { id, .. } if id == "WHAT"));
    assert!(matches!(error(&RvmWriter::new().close().finish()), RvmError::Malformed { .. }));
    assert!(matches!(error(&open().finish()), RvmError::Malformed { .. }));
    assert!(matches!(
        error(&RvmWriter::new().cuboid([0.0; 3], [1.0; 3]).finish()),
        RvmError::Malformed { .. }
    ));
    // A facet group that claims 4 thousand million facets must not make room for them.
    let greedy = open().primitive(11, [0.0; 3], [0.0; 3], [0.0; 3], &word(u32::MAX)).close().finish();
    assert!(matches!(error(&greedy), RvmError::Truncated { .. }));
}

#[test]
fn groups_of_groups_are_the_hierarchy_and_have_the_attributes_beside_the_file() {
    let file = RvmWriter::new()
        .open("/SITE", 0)
        .open("/EMPTY", 0)
        .open("/NOTHING", 0)
        .close()
        .close()
        .open("/PUMP", 2)
        .cuboid([0.0; 3], [1.0; 3])
        .open("/PUMP/N1", 5)
        .cuboid([0.0; 3], [1.0; 3])
        .close()
        .close()
        .open("/TANK", 2)
        .cuboid([0.0; 3], [1.0; 3])
        .close()
        .close()
        .finish();
    let attributes =
        "CADC_Attributes_File v1.0\nNEW /SITE\n OWNER := me\n NEW /PUMP/N1\n  BORE := 80\n END\nEND\n";
    let imported = import_beside("a.rvm", &file, &[("a.att", attributes.as_bytes())]).unwrap();
    let hierarchy = &imported.model.hierarchy;
    let groups: Vec<_> = hierarchy
        .groups
        .iter()
        .map(|g| (&*g.name, g.parent, g.objects.clone(), g.attributes.len()))
        .collect();
    assert_eq!(groups, [("a.rvm", None, 0..3, 0), ("/SITE", Some(0), 0..3, 1), ("/PUMP", Some(1), 0..2, 0)]);
    assert_eq!(&*hierarchy.attributes_of(1)[0].value, "80");
    assert_eq!(hierarchy.attributes_of(0), []);
    let alone = import_bytes("a.rvm", &file).unwrap();
    assert!(alone.model.hierarchy.attributes.is_empty());
}
