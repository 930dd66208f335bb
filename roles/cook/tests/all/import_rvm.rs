//! RVM files written by hand: groups, colours, units, and the messages for faults.

use glam::{DVec3, Vec3};
use trimaran_cook::import::{
    FilePosition, ImportError, ImportOptions, Imported, RvmError, UpAxis, WarningKind, import,
};
use trimaran_scene::Rgba8;

use crate::import_files::{RvmWriter, import_beside, import_bytes, names, reals, word};

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
    // No curve is cut finer than a ten-thousandth of the radius.
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
fn an_object_all_of_whose_triangles_are_lines_or_points_is_kept_by_name_and_counted() {
    let empty = |file: RvmWriter, name: &str, kind, shape: &[f32]| {
        file.open(name, 2).primitive(kind, [0.0; 3], [0.0; 3], [0.0; 3], &reals(shape)).close()
    };
    let file = empty(RvmWriter::new().open("/ZONE", 1), "/TUBE", 8, &[0.0, 50.0]);
    let file = empty(empty(file, "/BALL", 9, &[0.0]), "/SNOUT", 7, &[0.0; 9]);
    let file = empty(box_in(file, "/A"), "/DECK", 2, &[0.0; 3]).close();
    let imported = import_bytes("a.rvm", &file.finish()).unwrap();
    // The deck has not even a triangle.
    assert_eq!(names(&imported), ["/TUBE", "/BALL", "/SNOUT", "/A"]);
    assert_eq!(imported.report.counts(), [(WarningKind::NoArea, 3), (WarningKind::EmptyObject, 1)]);
    // A plane has a surface.
    let flat = empty(RvmWriter::new(), "/PLATE", 2, &[10.0, 10.0, 0.0]).finish();
    assert_eq!(names(&import_bytes("a.rvm", &flat).unwrap()), ["/PLATE"]);
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

/// A warning: its kind, detail, objects and count.
type Met = (WarningKind, String, Vec<String>, u64);

fn met(imported: &Imported) -> Vec<Met> {
    let warnings = imported.report.warnings.clone();
    warnings.into_iter().map(|w| (w.kind, w.detail, w.objects, w.count)).collect()
}

fn of(kind: WarningKind, detail: &str, objects: &[&str]) -> Met {
    let names = objects.iter().map(|&name| name.to_owned()).collect();
    (kind, detail.to_owned(), names, objects.len().max(1) as u64)
}

fn box_in(file: RvmWriter, name: &str) -> RvmWriter {
    file.open(name, 2).cuboid([0.0; 3], [1.0; 3]).close()
}

#[test]
fn faults_are_told_with_their_place() {
    let open = || RvmWriter::new().open("/PUMP", 1);
    let begun = open().unfinished().len() as u64;
    let cut = |file: &[u8]| match error(file) {
        RvmError::Truncated { at: FilePosition::Byte(byte), .. } => byte,
        other => panic!("{other}"),
    };
    // The file ends while a group is open, between chunks and within one.
    let open_group = open().cuboid([0.0; 3], [1.0; 3]).unfinished();
    let length = open_group.len() as u64;
    assert_eq!(cut(&open_group), length);
    assert_eq!(cut(&open_group[..open_group.len() - 4]), length - 4);
    assert_eq!(cut(&open_group[..begun as usize + 10]), begun + 10);
    assert_eq!(cut(&RvmWriter::new().unfinished()), RvmWriter::new().unfinished().len() as u64);
    let mut letters = open().unfinished();
    letters.extend([1; 24]);
    assert!(matches!(error(&letters), RvmError::Malformed { at: FilePosition::Byte(at), .. } if at == begun));
}

/// A chunk contains the offset of the next one.
#[test]
fn a_length_that_points_backwards_or_out_of_the_file_is_an_error() {
    for id in ["PRIM", "WHAT", "CNTE"] {
        let before = RvmWriter::new().open("/PUMP", 1).unfinished().len();
        for (next, backwards) in
            [(before as u32, true), (before as u32 + 23, true), (0, true), (u32::MAX, false)]
        {
            let mut file = RvmWriter::new().open("/PUMP", 1).chunk(id, &[0; 200]).close().finish();
            file[before + 16..before + 20].copy_from_slice(&next.to_be_bytes());
            match error(&file) {
                RvmError::Malformed { at, what } => {
                    assert!(backwards && what.contains("begins before"), "{id} {next}: {what}");
                    assert_eq!(at, FilePosition::Byte(before as u64));
                }
                RvmError::Truncated { .. } => assert!(!backwards, "{id} {next}"),
                other => panic!("{id} {next}: {other}"),
            }
        }
    }
}

#[test]
fn an_extra_end_of_a_group_is_ignored_and_counted() {
    let first = RvmWriter::new().close();
    let file = box_in(box_in(first, "/A").close(), "/B").close().finish();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!(names(&imported), ["/A", "/B"]);
    let (kind, detail, objects, count) = met(&imported).remove(0);
    assert_eq!((kind, count, &*detail, objects.len()), (WarningKind::ExtraGroupEnd, 3, "", 0));
}

#[test]
fn an_unknown_chunk_is_skipped_by_its_length_and_named() {
    let group = RvmWriter::new().chunk("NEWS", &[]).open("/A", 2).cuboid([0.0; 3], [1.0; 3]);
    let group = group.chunk("ATTR", &[7; 40]).chunk("ATTR", &[]).cuboid([0.0; 3], [1.0; 3]).close();
    let imported = import_bytes("a.rvm", &group.chunk("COLR", &word(1)).finish()).unwrap();
    assert_eq!(imported.report.triangles, 24);
    let (unknown, broken) = (WarningKind::UnknownChunk, WarningKind::BrokenChunk);
    let expected = [(unknown, "NEWS", 1), (unknown, "ATTR", 2), (broken, "COLR: too short", 1)];
    let expected = expected.map(|(kind, detail, count)| (kind, detail.to_owned(), vec![], count));
    assert_eq!(met(&imported), expected);
}

#[test]
fn a_group_that_is_cut_short_opens_with_what_can_be_read() {
    let long_name = [word(2), word(5000), b"/LONG\0\0\0".to_vec(), reals(&[0.0; 3]), word(2)].concat();
    let short = [word(2), word(2), b"/SHORT\0\0".to_vec(), reals(&[0.0; 2])].concat();
    for (body, name) in [(long_name, "/LONG"), (short, "/SHORT"), (word(2), ""), (vec![], "")] {
        let file = box_in(RvmWriter::new().chunk("CNTB", &body).cuboid([0.0; 3], [1.0; 3]).close(), "/B");
        let imported = import_bytes("a.rvm", &file.finish()).unwrap();
        assert_eq!(names(&imported), [name, "/B"]);
        assert_eq!(met(&imported), [of(WarningKind::BrokenGroup, "its colour cannot be read", &[name])]);
        assert_eq!(imported.model.meshes[0].colours[0], Rgba8([0x78, 0x78, 0x78, 255]));
    }
}

#[test]
fn the_last_chunk_may_be_missing_or_cut_and_zeros_may_follow_it() {
    let closed = || box_in(RvmWriter::new(), "/A");
    let zeros = vec![0; 1000];
    let whole = closed().finish();
    for (file, warned) in [
        (closed().unfinished(), true),
        ([closed().unfinished(), zeros.clone()].concat(), true),
        (whole[..whole.len() - 4].to_vec(), false),
        (whole[..whole.len() - 16].to_vec(), false),
        ([whole.clone(), zeros].concat(), false),
    ] {
        let imported = import_bytes("a.rvm", &file).unwrap();
        assert_eq!(imported.report.triangles, 12);
        let expected = if warned { vec![of(WarningKind::EndMissing, "", &[])] } else { Vec::new() };
        assert_eq!(met(&imported), expected, "{} bytes", file.len());
    }
}

#[test]
fn a_group_that_never_ends_ends_with_its_model() {
    let file = box_in(RvmWriter::new().open("/SITE", 1).open("/PUMP", 2).cuboid([0.0; 3], [1.0; 3]), "/N1");
    let imported = import_bytes("a.rvm", &file.finish()).unwrap();
    assert_eq!(names(&imported), ["/PUMP", "/N1"]);
    assert_eq!(met(&imported), [of(WarningKind::GroupLeftOpen, "", &["/PUMP", "/SITE"])]);
}

/// The offsets of the second count from its own beginning, or from that of the file.
#[test]
fn several_models_behind_one_another_are_all_read() {
    let colour = |index: u8| [word(1), word(5), vec![index, 2, 3, 0]].concat();
    let one = |name: &str, index| {
        let file = RvmWriter::new().chunk("COLR", &colour(index)).open(name, 5);
        file.cuboid([0.0; 3], [1.0; 3]).close()
    };
    let joined = [one("/A", 1).finish(), vec![0; 40], one("/B", 9).finish(), one("/C", 8).finish()].concat();
    let mut counted_on = one("/A", 1).chunk("END:", &word(1)).chunk("HEAD", &word(1));
    counted_on = counted_on.chunk("COLR", &colour(9)).open("/B", 5).cuboid([0.0; 3], [1.0; 3]).close();
    for (file, expected) in [(joined, &["/A", "/B", "/C"][..]), (counted_on.finish(), &["/A", "/B"])] {
        let imported = import_bytes("a.rvm", &file).unwrap();
        assert_eq!(names(&imported), expected);
        assert_eq!(met(&imported), []);
        // Each has its own colours.
        let colours = imported.model.meshes.iter().map(|mesh| mesh.colours[0]);
        let own = [[1, 2, 3, 255], [9, 2, 3, 255], [8, 2, 3, 255]].map(Rgba8);
        assert!(colours.eq(own.into_iter().take(expected.len())));
    }
}

#[test]
fn bytes_behind_the_end_that_are_no_model_are_told() {
    let mut file = box_in(RvmWriter::new(), "/A").finish();
    file.extend(b"\0\0left over");
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!((imported.report.triangles, met(&imported)), (12, vec![of(WarningKind::BehindEnd, "", &[])]));
}

#[test]
fn a_model_whose_end_is_missing_does_not_hide_the_next() {
    let file =
        [box_in(RvmWriter::new(), "/A").unfinished(), box_in(RvmWriter::new(), "/B").finish()].concat();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!(
        (names(&imported), met(&imported)),
        (vec!["/A", "/B"], vec![of(WarningKind::EndMissing, "", &[])])
    );
}

/// Opacity is in the colours.
#[test]
fn transparency_is_that_of_the_innermost_group_that_says_one() {
    let cuboid = |file: RvmWriter| file.cuboid([0.0; 3], [1.0; 3]);
    let file = cuboid(RvmWriter::new().open_transparent("/GLASS", 2, 75));
    let file = cuboid(file.open("/PANE", 2)).close();
    let file = cuboid(file.open_transparent("/FRAME", 2, 0)).close();
    let file = cuboid(file.open_transparent("/GAP", 2, 100)).close().close();
    let file = cuboid(file.open("/WALL", 2)).close();
    let file = cuboid(file.open_transparent("/ODD", 2, 101)).close();
    let imported = import_bytes("a.rvm", &file.finish()).unwrap();
    let alpha: Vec<_> = imported.model.meshes.iter().map(|mesh| mesh.colours[0].0).collect();
    let expected = [64, 64, 255, 0, 255, 255].map(|alpha| [0xcc, 0, 0, alpha]);
    assert_eq!(alpha, expected);
    assert_eq!(met(&imported), [of(WarningKind::SenselessTransparency, "transparency 101", &["/ODD"])]);
}

/// AVEVA's newest version has 28 bytes where version 3 has four.
#[test]
fn transparency_of_version_4_is_read() {
    let body =
        [word(4), word(1), b"/A\0\0".to_vec(), reals(&[0.0; 3]), word(2), vec![50], vec![9; 27]].concat();
    let file = RvmWriter::new().chunk("CNTB", &body).cuboid([0.0; 3], [1.0; 3]).close().finish();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!(imported.model.meshes[0].colours[0], Rgba8([0xcc, 0, 0, 128]));
}

#[test]
fn numbers_without_a_colour_are_grey_and_named() {
    let file = [0, 68, 68, 255, 256].into_iter().zip(["/A", "/B", "/C", "/D", "/E"]);
    let file = file.fold(RvmWriter::new(), |file, (material, name)| {
        file.open(name, material).cuboid([0.0; 3], [1.0; 3]).close()
    });
    // Nothing is drawn of this one.
    let imported = import_bytes("a.rvm", &file.open("/F", 1000).close().finish()).unwrap();
    let grey = Rgba8([0x78, 0x78, 0x78, 255]);
    let is_grey: Vec<_> = imported.model.meshes.iter().map(|mesh| mesh.colours[0] == grey).collect();
    assert_eq!(is_grey, [true, true, true, false, true]);
    let unknown = |number, objects: &[&str]| of(WarningKind::UnknownColour, number, objects);
    assert_eq!(
        met(&imported),
        [
            unknown("material 0", &["/A"]),
            unknown("material 68", &["/B", "/C"]),
            unknown("material 256", &["/E"])
        ]
    );
}

#[test]
fn broken_primitives_are_left_out_and_counted_and_the_others_stay() {
    let size = reals(&[10.0; 3]);
    let cuboid = |file: RvmWriter, place| file.primitive(2, place, [-5.0; 3], [5.0; 3], &size);
    let no_box =
        |file: RvmWriter, kind, shape: &[u8]| file.primitive(kind, [0.0; 3], [0.0; 3], [0.0; 3], shape);
    let matrix = "its matrix has a value that is not finite";
    let measure = "one of its measures is not finite";
    let short = "its chunk is too short for it";
    let far = "it is too large or too far away: beyond 1e15 m";
    let greedy = [word(1), word(u32::MAX)].concat();
    let broken = |file: RvmWriter, number: usize| match number {
        0 => cuboid(file, [f32::NAN, 0.0, 0.0]),
        1 => cuboid(file, [f32::INFINITY, 0.0, 0.0]),
        2 => no_box(file, 8, &reals(&[f32::NAN, 1.0])),
        3 => no_box(file, 9, &reals(&[f32::NEG_INFINITY])),
        4 => no_box(file, 8, &reals(&[1.0])),
        5 => no_box(file, 11, &word(u32::MAX)),
        6 => no_box(file, 11, &greedy),
        7 => file.chunk("PRIM", &[]),
        8 => no_box(file, 12, &size),
        9 => cuboid(file, [1e15; 3]),
        _ => no_box(file, 9, &reals(&[1e24])),
    };
    for (number, why) in
        [matrix, matrix, measure, measure, short, short, short, short, "it is of an unknown kind", far, far]
            .into_iter()
            .enumerate()
    {
        let file =
            cuboid(broken(cuboid(RvmWriter::new().open("/PUMP", 2), [0.0; 3]), number), [1.0; 3]).close();
        let options = ImportOptions { unit: Some(10.0), ..Default::default() };
        let imported =
            trimaran_cook::import::import_bytes("a.rvm".as_ref(), &file.finish(), &options).unwrap();
        assert_eq!(imported.report.triangles, 24, "{number}");
        assert_eq!(met(&imported), [of(WarningKind::BrokenPrimitive, why, &["/PUMP"])], "{number}");
    }
}

#[test]
fn a_primitive_in_no_group_is_left_out() {
    let file = box_in(RvmWriter::new().cuboid([0.0; 3], [1.0; 3]), "/A").finish();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!(imported.report.triangles, 12);
    assert_eq!(met(&imported), [of(WarningKind::BrokenPrimitive, "it stands in no group", &[])]);
}

#[test]
fn of_a_facet_group_only_broken_polygons_are_left_out() {
    let polygon = |corner: f32| {
        let corners = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, corner]];
        let corners = corners.map(|[x, y]| reals(&[x, y, 0.0, 0.0, 0.0, 1.0])).concat();
        [word(1), word(4), corners].concat()
    };
    let facets = [word(4), polygon(9.0), polygon(f32::NAN), polygon(f32::INFINITY), polygon(8.0)].concat();
    let file = RvmWriter::new().open("/DECK", 2);
    let file = file.primitive(11, [0.0; 3], [0.0; 3], [9.0, 9.0, 0.0], &facets).close().finish();
    let imported = import_bytes("a.rvm", &file).unwrap();
    assert_eq!((imported.report.triangles, imported.report.box_mismatches), (4, 0));
    let why = "a polygon has a corner that is not finite";
    assert_eq!(met(&imported), [(WarningKind::BrokenPolygon, why.into(), vec!["/DECK".into()], 2)]);
}

#[test]
fn names_are_read_in_the_encoding_that_the_head_names() {
    for (label, bytes, name) in [
        ("Unicode UTF-8", "/Röhr-1".as_bytes(), "/Röhr-1"),
        ("Japanese Shift-JIS", b"/\x94z\x8a\xc7-1", "/配管-1"),
        ("Simplified Chinese (GB2312)", b"/\xb9\xdc\xb5\xc0-1", "/管道-1"),
        ("ISO-8859-1", b"/R\xf6hr-1", "/Röhr-1"),
        ("Windows-1251", b"/\xd2\xf0\xf3\xe1\xe0", "/Труба"),
        ("", b"/R\xf6hr-1", "/Röhr-1"),
        ("", "/配管-1".as_bytes(), "/配管-1"),
    ] {
        let file = RvmWriter::in_encoding(label).open_bytes(bytes, 2).cuboid([0.0; 3], [1.0; 3]).close();
        let imported = import_bytes("a.rvm", &file.finish()).unwrap();
        assert_eq!((names(&imported), met(&imported)), (vec![name], vec![]), "{label:?}");
    }
}

#[test]
fn an_encoding_that_is_not_known_or_not_kept_is_told() {
    let file =
        |label| RvmWriter::in_encoding(label).open_bytes(b"/R\xf6hr", 2).cuboid([0.0; 3], [1.0; 3]).close();
    let imported = import_bytes("a.rvm", &file("EBCDIC").finish()).unwrap();
    assert_eq!(names(&imported), ["/Röhr"]);
    assert_eq!(met(&imported), [of(WarningKind::UnknownEncoding, "EBCDIC", &[])]);
    let imported = import_bytes("a.rvm", &file("Unicode UTF-8").finish()).unwrap();
    assert_eq!(met(&imported), [of(WarningKind::WrongEncoding, "", &["/Röhr"])]);
}

/// A sparse file: a volume of nearly 4 GiB is passed over, and offsets begin at 0 again.
#[test]
fn a_file_of_more_than_4_gib_is_read_without_taking_that_memory() {
    use std::io::{Seek, SeekFrom, Write};
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("big.rvm");
    let mut file = std::fs::File::create(&path).unwrap();
    let begin = RvmWriter::new().open("/BIG", 2).unfinished();
    file.write_all(&begin).unwrap();
    let mut at = 0xffff_ff00_u64;
    let mut volume = RvmWriter::new().chunk("OBST", &[]).unfinished();
    let header = volume.split_off(volume.len() - 24);
    file.write_all(&header[..16]).unwrap();
    file.write_all(&word(at as u32)).unwrap();
    file.seek(SeekFrom::Start(at)).unwrap();
    let whole = RvmWriter::new().open("/BIG", 2).cuboid([0.0; 3], [1.0; 3]).close().finish();
    let primitive = whole.len() - begin.len() - 28 * 2;
    for part in [
        &whole[begin.len()..][..primitive],
        &whole[begin.len()..][..primitive],
        &whole[begin.len() + primitive..],
    ] {
        let mut part = part.to_vec();
        let ends: &[usize] = if part.len() == primitive { &[0] } else { &[0, 28] };
        for &start in ends {
            let length = if part.len() == primitive { primitive } else { 28 };
            let next = (at + start as u64 + length as u64) as u32;
            part[start + 16..start + 20].copy_from_slice(&next.to_be_bytes());
        }
        file.write_all(&part).unwrap();
        at += part.len() as u64;
    }
    assert!(at > 1 << 32);
    drop(file);
    let imported = import(&[path], &ImportOptions::default(), &mut |_| {}).unwrap();
    assert_eq!((names(&imported), imported.report.triangles), (vec!["/BIG"], 24));
    assert_eq!(met(&imported), [(WarningKind::VolumeLeftOut, String::new(), vec![], 1)]);
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
