//! The text form of RVM files: it behaves like the binary form.

use glam::{DVec3, Vec3};
use trimaran_cook::import::{FilePosition, ImportError, Imported, RvmError, WarningKind};
use trimaran_scene::Rgba8;

use crate::import_files::{RvmWriter, import_beside, import_bytes, names, reals};

const BEGIN: &str = "HEAD\n     1     2\nAVEVA PDMS Design\n\nMon Jan 01 2024\nme@here\nUnicode UTF-8\n\
                     MODL\n     1     1\nSAM\n/SAMPLE\n";
const END: &str = "END:\n     1     1\n";

fn open(name: &str, material: u32) -> String {
    format!("CNTB\n     1     2\n{name}\n          0.00          0.00          0.00\n{material:6}\n")
}

const CLOSE: &str = "CNTE\n     1     2\n";

/// A primitive at (1, 2, 3) metres, with the text after its matrix.
fn primitive(kind: u32, rest: &str) -> String {
    let rows = "0.001 0.0 0.0 1.0\n0.0 0.001 0.0 2.0\n0.0 0.0 0.001 3.0";
    format!("PRIM\n     1     1\n{kind:6}\n{rows}\n{rest}\n")
}

/// A box of this size in millimetres.
fn cuboid(size: f64) -> String {
    let half = size / 2.0;
    primitive(2, &format!("{0} {0} {0}\n{half} {half} {half}\n{size} {size} {size}", -half))
}

fn read(text: &str) -> Imported {
    import_bytes("a.rvm", text.as_bytes()).unwrap()
}

fn kinds(imported: &Imported) -> Vec<(WarningKind, &str, u64)> {
    imported.report.warnings.iter().map(|w| (w.kind, &*w.detail, w.count)).collect()
}

#[test]
fn a_file_of_either_ending_and_any_line_ends_is_read() {
    let pump = open("/PUMP", 2) + &cuboid(100.0) + &open("/PUMP/N1", 5) + &cuboid(50.0) + CLOSE + CLOSE;
    let colour = "COLR\n     1     1\n     5\n   1   2   3\n";
    let text = [BEGIN, &open("/SITE", 0), &pump, CLOSE, colour, END].concat();
    for ends in ["\n", "\r\n", "\r"] {
        for name in ["a.rvm", "a.REV"] {
            let imported = import_bytes(name, text.replace('\n', ends).as_bytes()).unwrap();
            let objects = imported.model.objects.iter().map(|o| (&*o.name, o.source_index));
            assert!(objects.eq([("/PUMP", 1), ("/PUMP/N1", 2)]), "{name} {ends:?}");
            let groups = imported.model.hierarchy.groups.iter().map(|group| &*group.name);
            assert!(groups.eq([name, "/SITE", "/PUMP"]), "{name} {ends:?}");
            // z up turns into y up.
            let place = imported.model.objects[0].to_world.translation;
            assert!(place.distance(DVec3::new(1.0, 3.0, -2.0)) < 1e-9, "{place}");
            let high = imported.model.meshes[0].positions.iter().fold(Vec3::MIN, |high, &p| high.max(p));
            assert!(high.distance(Vec3::splat(0.05)) < 1e-6, "{high}");
            let colours = imported.model.meshes.iter().map(|mesh| mesh.colours[0]);
            assert!(colours.eq([Rgba8([0xcc, 0, 0, 255]), Rgba8([1, 2, 3, 255])]));
            assert_eq!((imported.report.box_mismatches, kinds(&imported)), (0, vec![]));
        }
    }
}

/// One of each kind, in both forms: the meshes are the same.
#[test]
fn primitives_are_those_of_the_binary_form() {
    let shapes: [(u32, &[f32]); 10] = [
        (1, &[10.0, 20.0, 5.0, 8.0, 1.0, 2.0, 30.0]),
        (2, &[10.0, 20.0, 30.0]),
        (3, &[10.0, 20.0, 5.0, 1.5]),
        (4, &[30.0, 5.0, 1.5]),
        (5, &[10.0, 4.0]),
        (6, &[10.0, 4.0]),
        (7, &[10.0, 5.0, 20.0, 1.0, 2.0, 0.125, 0.25, 0.0, -0.125]),
        (8, &[10.0, 50.0]),
        (9, &[10.0]),
        (10, &[0.0, 50.0]),
    ];
    let mut binary = RvmWriter::new().open("/ALL", 2);
    let mut text = BEGIN.to_owned() + &open("/ALL", 2);
    let spot = |numbers: &[f32]| numbers.iter().map(f32::to_string).collect::<Vec<_>>().join("\n ");
    for (kind, numbers) in shapes {
        binary = binary.primitive(kind, [1.0, 2.0, 3.0], [-1.0; 3], [1.0; 3], &reals(numbers));
        text += &primitive(kind, &format!("-1 -1 -1\n1 1 1\n{}", spot(numbers)));
    }
    let corners = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]];
    let facet =
        corners.map(|[x, y]| format!("{x:14.5}{y:14.5}{:14.5}\n{:14.5}{:14.5}{:14.5}\n", 0.0, 0.0, 0.0, 1.0));
    text += &primitive(11, &format!("0 0 0\n9 9 0\n  1\n  1\n  4\n{}", facet.concat()));
    let facet = corners.map(|[x, y]| reals(&[x, y, 0.0, 0.0, 0.0, 1.0])).concat();
    let facet = [[1, 1, 4].map(u32::to_be_bytes).concat(), facet].concat();
    binary = binary.primitive(11, [1.0, 2.0, 3.0], [0.0; 3], [9.0, 9.0, 0.0], &facet);

    let text = read(&(text + CLOSE + END));
    let binary = import_bytes("a.rvm", &binary.close().finish()).unwrap();
    assert!(text.report.triangles > 100);
    assert_eq!(
        text.report,
        trimaran_cook::import::ImportReport {
            looked_for: text.report.looked_for.clone(),
            ..binary.report.clone()
        }
    );
    let spread = |imported: &Imported| {
        let object = &imported.model.objects[0];
        let mesh = &imported.model.meshes[0];
        let at = |p: &Vec3| object.to_world.transform_point3(p.as_dvec3());
        mesh.indices.iter().map(|&index| at(&mesh.positions[index as usize])).collect::<Vec<_>>()
    };
    let (text, binary) = (spread(&text), spread(&binary));
    // 0.001 is not exactly a float, and the text is read in double precision.
    assert!(text.iter().zip(&binary).all(|(a, b)| a.distance(*b) < 1e-7) && text.len() == binary.len());
}

/// A quarter turn about z: x becomes y.
#[test]
fn a_matrix_stands_row_by_row() {
    let turned = "PRIM\n 1 1\n 2\n0 -0.001 0 0\n0.001 0 0 0\n0 0 0.001 0\n-50 -5 -5 50 5 5\n100 10 10\n";
    let imported = read(&[BEGIN, &open("/A", 2), turned, CLOSE, END].concat());
    let high = imported.model.meshes[0].positions.iter().fold(Vec3::MIN, |high, &p| high.max(p));
    assert!(high.distance(Vec3::new(0.005, 0.005, 0.05)) < 1e-6, "{high}");
    assert_eq!(imported.report.box_mismatches, 0);
}

#[test]
fn names_may_be_in_any_encoding() {
    let text = |label: &str| {
        let begin = BEGIN.replace("Unicode UTF-8\n", &format!("{label}\n"));
        [&*begin, &open("NAME", 2), &cuboid(10.0), CLOSE, END].concat()
    };
    let named = |text: &str, name: &[u8]| {
        let (before, behind) = text.split_once("NAME").unwrap();
        [before.as_bytes(), name, behind.as_bytes()].concat()
    };
    let sixteen = |text: String| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    for (file, name) in [
        (named(&text("Unicode UTF-8"), "/Röhr-1".as_bytes()), "/Röhr-1"),
        (named(&text("Japanese Shift-JIS"), b"/\x94z\x8a\xc7-1"), "/配管-1"),
        (named(&text("GBK"), b"/\xb9\xdc\xb5\xc0-1"), "/管道-1"),
        (named(&text("ISO-8859-1"), b"/R\xf6hr-1"), "/Röhr-1"),
        (named(&text(""), b"/R\xf6hr-1"), "/Röhr-1"),
        (named(&text("\u{feff}").replace('\u{feff}', ""), "/管".as_bytes()), "/管"),
        ([b"\xff\xfe".to_vec(), sixteen(text("").replace("NAME", "/Röhr-1"))].concat(), "/Röhr-1"),
        (sixteen(text("").replace("NAME", "/管")), "/管"),
        (named(&("\u{feff}".to_owned() + &text("")), "/管".as_bytes()), "/管"),
    ] {
        let imported = import_bytes("a.rev", &file).unwrap();
        assert_eq!((names(&imported), kinds(&imported)), (vec![name], vec![]));
    }
    let imported = read(&text("EBCDIC"));
    assert_eq!(kinds(&imported), [(WarningKind::UnknownEncoding, "EBCDIC", 1)]);
}

/// Programs other than AVEVA's write a head of version 1 and name no encoding.
#[test]
fn a_head_without_an_encoding_and_names_that_look_like_chunks_are_read() {
    let begin = "HEAD\n     1     1\nprogram\nEND\nMODL\nme\nMODL\n     1     1\nCNTB\nPRIM\n";
    let text =
        [begin, &open("CNTB", 2), &cuboid(10.0), CLOSE, &open("", 2), &cuboid(10.0), CLOSE, END].concat();
    let imported = read(&text);
    assert_eq!((names(&imported), kinds(&imported)), (vec!["CNTB", ""], vec![]));
}

#[test]
fn transparency_of_version_3_is_read() {
    let glass = open("/GLASS", 2).replace("     1     2", "     1     3") + "    75     0     0     0\n";
    let text = [BEGIN, &glass, &open("/PANE", 2), &cuboid(10.0), CLOSE, CLOSE, END].concat();
    assert_eq!(read(&text).model.meshes[0].colours[0], Rgba8([0xcc, 0, 0, 64]));
}

#[test]
fn what_is_odd_is_left_out_and_told() {
    let odd = "ATTR\n     1     1\nwhat ever\n  7\nATTR\n     1     1\nOBST\n     1     1\n     2\n  0 0 0\n";
    let broken = [
        primitive(2, "0 0 0\n1 1 1\n 1.#QNAN 1 1"),
        primitive(2, "0 0 0\n1 1 1\n 1 1"),
        primitive(12, "0 0 0\n1 1 1\n 1 1"),
        "PRIM\n 1 1\n".to_owned(),
    ];
    let file = [BEGIN, CLOSE, &open("/A", 300), &cuboid(10.0), odd, &broken.concat(), CLOSE].concat();
    let imported = read(&file);
    assert_eq!(imported.report.triangles, 12);
    assert_eq!(
        kinds(&imported),
        [
            (WarningKind::ExtraGroupEnd, "", 1),
            (WarningKind::UnknownChunk, "ATTR", 2),
            (WarningKind::VolumeLeftOut, "", 1),
            (WarningKind::BrokenPrimitive, "one of its measures is not finite", 1),
            (WarningKind::BrokenPrimitive, "its chunk is too short for it", 2),
            (WarningKind::BrokenPrimitive, "it is of an unknown kind", 1),
            (WarningKind::EndMissing, "", 1),
            (WarningKind::UnknownColour, "material 300", 1),
        ]
    );
    // Padding behind the end, other words, and another model.
    let whole = [BEGIN, &open("/A", 2), &cuboid(10.0), CLOSE, END].concat();
    assert_eq!(kinds(&read(&(whole.clone() + "\0\0\n \u{1a}\n"))), []);
    assert_eq!(kinds(&read(&(whole.clone() + "by me\n"))), [(WarningKind::BehindEnd, "", 1)]);
    let two = read(&(whole.clone() + &whole.replace("/A", "/B")));
    assert_eq!((names(&two), kinds(&two)), (vec!["/A", "/B"], vec![]));
}

#[test]
fn blank_lines_may_stand_anywhere() {
    let part = |name: &str| [open(name, 2), cuboid(10.0), cuboid(20.0), CLOSE.into()].concat();
    let text = [BEGIN, &part("/A"), &part("/B"), END].concat();
    let within = text.replace("PRIM\n", "PRIM\n\n \n").replace("CNTE\n", "CNTE\n\n");
    let doubled = text.replace('\n', "\n\n");
    for text in [&within, &doubled, &doubled.replace('\n', "\r\n")] {
        let imported = read(text);
        assert_eq!((names(&imported), kinds(&imported)), (vec!["/A", "/B"], vec![]));
        assert_eq!(imported.report.triangles, 48);
    }
    let error =
        import_bytes("a.rvm", text.replace(END, "").replace(CLOSE, "").replace('\n', "\n\n").as_bytes());
    let Err(ImportError::Rvm { source: RvmError::Truncated { at: FilePosition::Line(line), .. }, .. }) =
        error
    else {
        panic!("{error:?}")
    };
    assert_eq!(line as usize, 2 * (text.lines().count() - 3 * 2) + 2);
    // A line that should begin a chunk and does not causes a warning.
    let lost = text.replacen("PRIM\n     1     1\n", "PRIM\n", 1);
    let imported = read(&lost);
    assert_eq!(imported.report.triangles, 36);
    assert_eq!(kinds(&imported), [(WarningKind::BrokenChunk, "PRIM: without its two numbers", 1)]);
    assert_eq!(imported.report.warnings[0].objects, ["/A"]);
}

#[test]
fn a_group_that_is_broken_opens_with_what_can_be_read() {
    let group = |head: &str| [BEGIN, "CNTB\n 1 2\n", head, &cuboid(10.0), CLOSE, END].concat();
    let broken = WarningKind::BrokenGroup;
    let (colour, nameless) = ("its colour cannot be read", "its name is missing");
    for (head, name, expected) in [
        ("/A\n0 0 0\n2.0\n", "/A", vec![]),
        ("/A\n0 0 0\n -1\n", "/A", vec![(broken, colour, 1)]),
        ("/A\n0 0 0\nred\n", "/A", vec![(broken, colour, 1)]),
        ("/A\n0 0 0\n\n", "/A", vec![(broken, colour, 1)]),
        ("/A\n0 0\n2\n", "/A", vec![(broken, colour, 1)]),
        ("", "", vec![(broken, colour, 1)]),
        ("0.00 0.00 0.00\n 2\n", "", vec![(broken, nameless, 1)]),
        ("END:\n0.00 0.00 0.00\n 2\n", "END:", vec![]),
    ] {
        let imported = read(&group(head));
        assert_eq!((names(&imported), kinds(&imported)), (vec![name], expected.clone()), "{head:?}");
        let is_grey = imported.model.meshes[0].colours[0] == Rgba8([0x78, 0x78, 0x78, 255]);
        assert_eq!(is_grey, expected.iter().any(|(_, why, _)| *why == colour), "{head:?}");
    }
    let corners = "0 0 0 0 0 1\n9 0 0 0 0 1\n0 9 0 0 0 1";
    let facets = primitive(11, &format!("0 0 0\n9 9 0\n1.0\n 1.0\n3.0\n{corners}"));
    assert_eq!(read(&[BEGIN, &open("/A", 2), &facets, CLOSE, END].concat()).report.triangles, 1);
}

#[test]
fn a_file_that_is_cut_off_or_no_review_file_is_refused() {
    let text = [BEGIN, &open("/A", 2), &cuboid(10.0)].concat();
    for file in [&*text, BEGIN, "HEAD\n", "HEAD\r\n 1 2\n"] {
        match import_bytes("a.rev", file.as_bytes()) {
            Err(ImportError::Rvm {
                source: RvmError::Truncated { at: FilePosition::Line(line), .. },
                ..
            }) => {
                assert_eq!(line as usize, file.split('\n').count(), "{file:?}");
            }
            other => panic!("{file:?}: {other:?}"),
        }
    }
    for other in ["HEADER\n", "", "solid\n"] {
        let error = import_bytes("a.rvm", other.as_bytes()).unwrap_err();
        assert!(matches!(error, ImportError::WrongMagic { .. }), "{error}");
    }
}

#[test]
fn attributes_beside_a_text_file_are_matched() {
    let text = [BEGIN, &open("/P1", 2), &cuboid(10.0), CLOSE, END].concat();
    let said = "CADC_Attributes_File v1.0\nNEW /P1\n SPEC := 'A1A'\nEND\n";
    let imported = import_beside("a.rev", text.as_bytes(), &[("a.att", said.as_bytes())]).unwrap();
    assert_eq!((imported.report.parts, imported.report.parts_matched), (1, 1));
    assert_eq!(&*imported.model.hierarchy.attributes_of(0)[0].value, "A1A");
}
