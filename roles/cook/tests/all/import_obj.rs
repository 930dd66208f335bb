//! OBJ files as exporters write them, with deviations that other readers accept: one test per kind.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;
use trimaran_cook::import::{ImportError, ImportOptions, Imported, ObjError, WarningKind, import};
use trimaran_cook::{CookOptions, cook};

use crate::import_files::{import_beside, import_bytes, names};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const RED: [u8; 4] = [255, 0, 0, 255];
const GREY: [u8; 4] = [153, 153, 153, 255];

fn read(text: impl AsRef<[u8]>) -> Imported {
    import_bytes("a.obj", text.as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// A file with libraries beside it.
fn read_beside(text: &str, libraries: &[(&str, &str)]) -> Imported {
    let libraries: Vec<_> = libraries.iter().map(|(name, text)| (*name, text.as_bytes())).collect();
    import_beside("a.obj", text.as_bytes(), &libraries).unwrap_or_else(|error| panic!("{error}"))
}

fn triangles(imported: &Imported) -> u64 {
    imported.report.triangles
}

/// Imports a file that must be without warnings.
fn clean(text: impl AsRef<[u8]>) -> Imported {
    let imported = read(text);
    assert_eq!(imported.report.warnings, []);
    imported
}

fn said(imported: &Imported) -> Vec<String> {
    imported.report.warnings.iter().map(ToString::to_string).collect()
}

/// The only warning.
fn warning(imported: &Imported) -> String {
    let said = said(imported);
    assert_eq!(said.len(), 1, "{said:?}");
    said.concat()
}

/// The groups within the file's: name, and names of objects.
fn groups(imported: &Imported) -> Vec<(&str, Vec<&str>)> {
    let within = |group: &trimaran_scene::Group| group.objects.start as usize..group.objects.end as usize;
    let groups = imported.model.hierarchy.groups.iter().skip(1);
    groups.map(|group| (&*group.name, names(imported)[within(group)].to_vec())).collect()
}

/// The colours of the first object, in the order of its vertices, each once.
fn colours(imported: &Imported) -> Vec<[u8; 4]> {
    let mut colours: Vec<[u8; 4]> = imported.model.meshes[0].colours.iter().map(|colour| colour.0).collect();
    colours.dedup();
    colours
}

/// The colours of a triangle in a material with this library text.
fn in_material(said: &str) -> Vec<[u8; 4]> {
    let text = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}");
    colours(&read_beside(&text, &[("a.mtl", &format!("newmtl m\n{said}"))]))
}

#[test]
fn lines_that_go_on() {
    for ends in ["\\\n", " \\\r\n", "\\  \n  ", "\\\t\r\n", "\\\r"] {
        let text =
            format!("v 0 0 0\nv 2 0{ends} 0\nv 3 1 0\nv 2 2 0\nv 0 2 0\nv -1 1 0\nf 1 2 3 {ends}4 5{ends} 6");
        assert_eq!(triangles(&clean(text)), 4, "{ends:?}");
    }
}

#[test]
fn names_that_are_empty() {
    let imported = clean(format!("o \ng\nusemtl \nusemtl\n{TRIANGLE}"));
    assert_eq!((names(&imported), colours(&imported)), (vec!["unnamed_object"], vec![GREY]));
}

#[test]
fn comments_at_the_end_of_lines() {
    let text = "mtllib a.mtl # colours\no Tank #5 # the old one\nusemtl red # as signals\n\
                v 0 0 0 # origin\nv 1 0 0#x\nv 0 1 0\nf 1 2 3 # bottom\ns off # flat\n";
    let imported = read_beside(text, &[("a.mtl", "newmtl red # signal\nKd 1 0 0 # full\n")]);
    assert_eq!(imported.report.warnings, []);
    assert_eq!((names(&imported), colours(&imported)), (vec!["Tank #5"], vec![RED]));
}

#[test]
fn byte_order_marks() {
    assert_eq!(triangles(&clean(format!("\u{feff}{TRIANGLE}"))), 1);
    let text = format!("\u{feff}mtllib a.mtl\nusemtl m\n{TRIANGLE}");
    assert_eq!(colours(&read_beside(&text, &[("a.mtl", "\u{feff}newmtl m\nKd 1 0 0")])), [RED]);
}

#[test]
fn ends_of_lines_of_any_system_or_none() {
    for end in ["\r", "\r\n", "\n\r\n"] {
        assert_eq!(triangles(&clean(TRIANGLE.replace('\n', end))), 1, "{end:?}");
        assert_eq!(triangles(&clean(TRIANGLE.trim_end().replace('\n', end))), 1, "{end:?}");
    }
    assert_eq!(triangles(&clean(TRIANGLE.replace(' ', " \t  "))), 1);
}

#[test]
fn utf16_is_read_with_and_without_its_mark() {
    let text = format!("\u{feff}o Beh\u{e4}lter\n{TRIANGLE}");
    for to_bytes in [u16::to_le_bytes, u16::to_be_bytes] {
        let bytes: Vec<u8> = text.encode_utf16().flat_map(to_bytes).collect();
        assert_eq!(names(&clean(&bytes)), ["Beh\u{e4}lter"]);
        assert_eq!(names(&clean(&bytes[2..])), ["Beh\u{e4}lter"]);
        let library: Vec<u8> = "\u{feff}newmtl m\nKd 1 0 0".encode_utf16().flat_map(to_bytes).collect();
        let text = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}");
        assert_eq!(colours(&import_beside("a.obj", text.as_bytes(), &[("a.mtl", &library)]).unwrap()), [RED]);
    }
    for binary in [&b"L\x01\0\0\x02\0"[..], b"glTF\0\0\0\n{\"asset\": {}}\n"] {
        let error = import_bytes("a.obj", binary).unwrap_err().to_string();
        assert!(error.contains("binary"), "{error}");
    }
}

/// Windows paths, and letters of Shift-JIS and GBK, whose second byte may be a backslash.
#[test]
fn a_backslash_at_the_end_of_a_name_joins_no_lines() {
    let named = |word: &str, name: &[u8]| {
        let head = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{word} ");
        let imported = read([head.as_bytes(), name, b"\nf 1 2 3\n"].concat());
        (triangles(&imported), names(&imported)[0].to_owned(), said(&imported).len())
    };
    assert_eq!(named("o", b"C:\\models\\"), (1, "C:\\models\\".into(), 0));
    assert_eq!(named("g", b"\x95\x5c"), (1, "\u{2022}\\".into(), 0));
    assert_eq!(named("usemtl", b"\x95\x5c"), (1, "unnamed_object".into(), 1));
    assert_eq!(named("mtllib", b"mats\\"), (1, "unnamed_object".into(), 1));
    let library = "newmtl x\\\nKd 0 1 0\nnewmtl a\nKd 1 0 0\n";
    let imported =
        read_beside(&format!("mtllib b.mtl \\\n a.mtl\nusemtl a\n{TRIANGLE}"), &[("a.mtl", library)]);
    assert_eq!(colours(&imported), [RED]);
    assert!(warning(&imported).contains("(b.mtl)"), "{:?}", said(&imported));
}

/// Windows programs write NaN with a `#` in it.
#[test]
fn numbers_that_are_none_cost_their_line() {
    let imported = read(format!("{TRIANGLE}v 0 0 -1.#IND\nv 0 1.#QNAN 0\nf 1 2 4\nf 1 2 5\nf 1 2 3 # 1.\n"));
    assert_eq!(triangles(&imported), 2);
    assert_eq!(imported.report.counts(), [(WarningKind::MalformedLine, 2), (WarningKind::FaceLeftOut, 2)]);
    let said = said(&imported).join("\n");
    assert!(said.contains("first at line 5: \"-1.#IND\" is no number"), "{said}");
    assert!(
        said.contains("first at line 7: vertex 4") && said.contains("first in \"unnamed_object\""),
        "{said}"
    );
    let text = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}");
    let imported = read_beside(&text, &[("a.mtl", "newmtl m\nKd 1.#QNAN 0 0\n")]);
    assert_eq!(
        (colours(&imported), imported.report.counts()),
        (vec![GREY], vec![(WarningKind::MalformedLine, 1)])
    );
}

#[test]
fn words_in_any_case_and_marks_within_are_no_other_words() {
    let text =
        "\u{feff}\u{feff}V 0 0 0\nv 1 0 0\n \u{feff}v 0 1 0\nVN 0 0 1\nO Tank\nUseMtl m\nF 1 2 3\nL 1 2\n";
    let imported = read(text);
    assert_eq!((triangles(&imported), names(&imported)), (1, vec!["Tank"]));
    assert_eq!(
        imported.report.counts(),
        [(WarningKind::PointsOrLines, 1), (WarningKind::MaterialUndefined, 1)]
    );
}

/// Fields of fixed width, and stretches lost by a disk.
#[test]
fn bytes_of_zero_are_white_space_and_counted() {
    let zeros = "\0".repeat(5000);
    for text in [
        format!("o Pump\0\0\n{TRIANGLE}"),
        format!("o Pump\n{TRIANGLE}{zeros}\n"),
        format!("{zeros}\no Pump\n{TRIANGLE}"),
        "o Pump\nv 0 0 0\0\nv 1 0 0\nv 0 1 0\nf\x001 2 3\n".to_owned(),
    ] {
        let imported = read(&text);
        assert_eq!((triangles(&imported), names(&imported)), (1, vec!["Pump"]));
        let counts = imported.report.counts();
        assert!(matches!(*counts, [(WarningKind::MalformedLine, 1 | 2)]), "{counts:?}");
    }
    let text = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}");
    let imported = read_beside(&text, &[("a.mtl", "newmtl m\0\0\nKd 1 0 0\n")]);
    assert_eq!(colours(&imported), [RED]);
    assert!(
        warning(&imported).contains("(a.mtl, first at line 1: it has bytes of zero"),
        "{:?}",
        said(&imported)
    );
}

#[test]
fn names_in_latin_1() {
    let text = [b"o Beh\xE4lter 5\nusemtl Gr\xFCn\nmtllib a.mtl\n", TRIANGLE.as_bytes()].concat();
    let imported = import_beside("a.obj", &text, &[("a.mtl", b"newmtl Gr\xFCn\nKd 1 0 0\n")]).unwrap();
    assert_eq!(imported.report.warnings, []);
    assert_eq!((names(&imported), colours(&imported)), (vec!["Beh\u{e4}lter 5"], vec![RED]));
}

#[test]
fn objects_hold_groups() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\no Pump-101\ng casing\nf 1 2 3\ng shaft\nf 1 2 3\nf 1 2 3\n\
                o Tank-7\nf 1 2 3\ng nozzle N1\nf 1 2 3\no Sign\ng Sign\nf 1 2 3\no Post\nf 1 2 3\n";
    let imported = clean(text);
    assert_eq!(names(&imported), ["casing", "shaft", "Tank-7", "nozzle N1", "Sign", "Post"]);
    let expected = [("Pump-101", vec!["casing", "shaft"]), ("Tank-7", vec!["Tank-7", "nozzle N1"])];
    assert_eq!(groups(&imported), expected);
    let indices: Vec<u32> = imported.model.objects.iter().map(|object| object.source_index).collect();
    assert_eq!(indices, [0, 1, 2, 3, 4, 5]);
}

#[test]
fn objects_alone_and_groups_alone_are_objects() {
    for word in ["o", "g"] {
        let text = format!(
            "{TRIANGLE}{word} a b\nf 1 2 3\nusemtl x\nf 1 2 3\n{word} c\n{word} d\nf 1 2 3\n{word} d\nf 3 2 1\n"
        );
        let imported = read(text);
        assert_eq!(names(&imported), ["unnamed_object", "a b", "d"]);
        assert!(groups(&imported).is_empty());
    }
    // A group above an object does not contain it.
    let imported = clean(format!("{TRIANGLE}g default\no a\nf 1 2 3\no b\nf 1 2 3\n"));
    assert_eq!((names(&imported).len(), groups(&imported)), (3, vec![]));
}

#[test]
fn libraries_are_found_by_any_name_that_programs_write() {
    let red = "newmtl m\nKd 1 0 0\n";
    let named = |line: &str, library: &str| {
        let imported = read_beside(&format!("mtllib {line}\nusemtl m\n{TRIANGLE}"), &[(library, red)]);
        (colours(&imported), said(&imported).len())
    };
    for (line, library) in [
        ("a.mtl", "a.mtl"),
        ("  my steel  v2.mtl ", "my steel  v2.mtl"),
        ("\"my steel.mtl\"", "my steel.mtl"),
        ("RED.MTL", "red.mtl"),
        ("red.mtl", "Red.MTL"),
        (".\\red.mtl", "red.mtl"),
        ("C:\\models\\red.mtl", "red.mtl"),
        ("/home/me/red.mtl", "red.mtl"),
        ("../red.mtl", "red.mtl"),
        ("mats\\red.mtl", "red.mtl"),
    ] {
        assert_eq!(named(line, library), (vec![RED], 0), "{line}");
    }
    for line in ["lost.mtl a.mtl", "a.mtl lost.mtl", "my lost one.mtl a.mtl", "lost a.mtl"] {
        assert_eq!(named(line, "a.mtl"), (vec![RED], 1), "{line}");
    }
    assert_eq!(named("b c a.txt d", "a.txt"), (vec![RED], 3));
}

#[test]
fn a_library_in_a_folder_below() {
    let folder = tempfile::TempDir::new().unwrap();
    std::fs::create_dir(folder.path().join("Mats")).unwrap();
    std::fs::write(folder.path().join("Mats/Red.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, format!("mtllib mats\\red.MTL\nusemtl m\n{TRIANGLE}")).unwrap();
    let imported = import(&[path], &ImportOptions::default(), &mut |_| {}).unwrap();
    assert_eq!((colours(&imported), said(&imported)), (vec![RED], vec![]));
}

#[test]
fn libraries_that_are_lost_are_named() {
    let text = format!("mtllib lost.mtl\nmtllib a.mtl\nmtllib lost.mtl\n{TRIANGLE}");
    let imported = read_beside(&text, &[("a.mtl", "newmtl m\n")]);
    assert_eq!(warning(&imported), "a.obj: 2 material libraries that cannot be read: drawn grey (lost.mtl)");
    let names: String = (0..5000).map(|number| format!("mtllib {number}.mtl\n")).collect();
    let imported = read(names + TRIANGLE);
    assert_eq!((said(&imported).len(), imported.report.counts()[0].1), (101, 5000));
}

#[test]
fn materials_that_nothing_defines_are_named_with_their_objects() {
    let text = format!(
        "mtllib a.mtl\no grate\nusemtl Steel\n{TRIANGLE}o post\nusemtl steel\nf 1 2 3\nusemtl Steel\nf 1 2 3\n"
    );
    let imported = read_beside(&text, &[("a.mtl", "newmtl steel\nKd 1 0 0\n")]);
    let said = warning(&imported);
    assert!(said.contains("2 uses of materials that no library defines: drawn grey (\"Steel\")"), "{said}");
    assert!(said.ends_with("first in \"grate\", \"post\""), "{said}");
    // Statements that draw nothing are no fault; nor is the notation of programs for no material.
    clean(format!("usemtl Steel\nusemtl (null)\n{TRIANGLE}"));
    let many: String = (0..5000).map(|number| format!("usemtl {number}\nf 1 2 3\n")).collect();
    let imported = read(format!("{TRIANGLE}{many}"));
    assert_eq!((imported.report.warnings.len(), imported.report.counts()[0].1), (101, 5000));
}

#[test]
fn a_library_that_stands_behind_its_use() {
    let text = format!("usemtl m\n{TRIANGLE}mtllib a.mtl\n");
    let imported = read_beside(&text, &[("a.mtl", "newmtl m\nKd 1 0 0\n")]);
    assert_eq!((colours(&imported), said(&imported)), (vec![RED], vec![]));
}

/// Files that were put together from others use one name for several things.
#[test]
fn a_material_is_the_one_that_was_defined_before() {
    let text = format!("mtllib 1.mtl\nusemtl m\n{TRIANGLE}mtllib 2.mtl\no b\nusemtl m\nf 1 2 3\n");
    let imported =
        read_beside(&text, &[("1.mtl", "newmtl m\nKd 1 0 0\n"), ("2.mtl", "newmtl m\nKd 0 0 1\n")]);
    let of = |mesh: usize| imported.model.meshes[mesh].colours[0].0;
    assert_eq!((of(0), of(1)), (RED, [0, 0, 255, 255]));
}

#[test]
fn colours_of_one_to_three_values() {
    assert_eq!(in_material("Kd 0.2\nKa 1\nKs 1\nKe 1"), [[51, 51, 51, 255]]);
    assert_eq!(in_material("Kd 0.2 1"), [[51, 255, 51, 255]]);
    assert_eq!(in_material("Kd 1 0 0"), [RED]);
    assert_eq!(in_material("Kd 204 51 51"), [[204, 51, 51, 255]]);
    assert_eq!(in_material("Kd spectral a.rfl\nKa xyz 1 1 1"), [GREY]);
}

#[test]
fn opacity_of_materials_is_kept() {
    assert_eq!(in_material("Kd 1 0 0\nd 0.4"), [[255, 0, 0, 102]]);
    assert_eq!(in_material("Kd 1 0 0\nTr 0.6"), [[255, 0, 0, 102]]);
    assert_eq!(in_material("Tr 0.9\nd -halo 0.4"), [[153, 153, 153, 102]]);
}

#[test]
fn a_line_of_a_library_that_is_wrong_costs_that_line() {
    let library = "newmtl m\nKd 1 0 0\nmap_Kd \nd x\nKd 1,0 0 0\nnewmtl b\nKd 0 0 1\n";
    let imported = read_beside(&format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}"), &[("a.mtl", library)]);
    assert_eq!(colours(&imported), [RED]);
    let said = warning(&imported);
    assert!(
        said.contains("3 malformed lines") && said.contains("(a.mtl, first at line 3: \"map_Kd \")"),
        "{said}"
    );
}

#[test]
fn textured_materials_are_counted() {
    let library = "newmtl m\nKd 1 0 0\nmap_Kd -s 2 2 2 my picture.png\nnewmtl b\nmap_Kd b.png\n";
    let imported = read_beside(&format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}"), &[("a.mtl", library)]);
    assert_eq!(colours(&imported), [RED]);
    let said = warning(&imported);
    assert!(
        said.contains("2 textured") && said.contains("(a.mtl, first at line 3: material \"m\")"),
        "{said}"
    );
}

#[test]
fn colours_of_vertices_times_those_of_their_material() {
    let text = "v 0 0 0 1 0 0\nv 1 0 0 0 0 1\nv 0 1 0\nmtllib a.mtl\nusemtl m\nf 1 2 3\n";
    let with = |library: &str| colours(&read_beside(text, &[("a.mtl", library)]));
    let white = [255; 4];
    assert_eq!(with("newmtl m\nKd 1 1 1\n"), [RED, [0, 0, 255, 255], white]);
    assert_eq!(
        with("newmtl m\nKd 0.2 1 0.6\nd 0.4\n"),
        [[51, 0, 0, 102], [0, 0, 153, 102], [51, 255, 153, 102]]
    );
    assert_eq!(with("newmtl m\n"), [RED, [0, 0, 255, 255], GREY]);
}

#[test]
fn colours_of_vertices_up_to_255() {
    let text = "v 0 0 0 200 30 30\nv 1 0 0 200 30 30\nv 0 1 0 1 1 1\nf 1 2 3\n";
    assert_eq!(colours(&clean(text)), [[200, 30, 30, 255], [1, 1, 1, 255]]);
}

#[test]
fn weights_of_vertices_do_not_move_them() {
    let text = "v 0 0 0 0.5\nv 2 0 0 0\nv 0 2 0 1 1 0 0\nv 2 2 0 1 0 0 1\nf 1 2 3\nf 2 3 4\n";
    let imported = clean(text);
    let high =
        imported.model.meshes[0].positions.iter().fold(glam::Vec3::NEG_INFINITY, |high, p| high.max(*p));
    assert_eq!(high, glam::Vec3::new(1.0, 1.0, 0.0));
    assert_eq!(colours(&imported), [GREY, RED, [0, 0, 255, 255]]);
    let opacities = "v 0 0 0 0.8 0 0 0.4\nv 2 0 0 0.8 0 0 0.4\nv 0 2 0 0.8 0 0 0.4\nf 1 2 3\n";
    assert_eq!(colours(&clean(opacities)), [[204, 0, 0, 102]]);
}

#[test]
fn free_form_surfaces_are_left_out_by_name() {
    let text = format!(
        "o hull\n{TRIANGLE}v 1 1 0\ncstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 3 4\nparm u 0 1\nend\n\
         o rail\ncurv 0 1 1 2\nend\ncurv 0 1 2 3\nend\n"
    );
    let imported = read(text);
    assert_eq!(triangles(&imported), 1);
    let said = said(&imported);
    assert_eq!(
        said[0],
        "a.obj: 2 free-form curves and surfaces left out (curv, first at line 13); first in \"rail\""
    );
    assert_eq!(
        said[1],
        "a.obj: 1 free-form curves and surfaces left out (surf, first at line 9); first in \"hull\""
    );
}

#[test]
fn a_line_that_is_wrong_costs_that_line() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1,5 2,5 3\nv 1.0D+02 0 0\nv 1 2\nv\nv 5 5 5 x\nmtllib\n\
                o plate\nf 1 2 3\nf 1 2 8\nf 1 2 4\nf 1 2 5\nf 1 2 6\n";
    let imported = read(text);
    assert_eq!(triangles(&imported), 2);
    assert_eq!(imported.report.counts(), [(WarningKind::MalformedLine, 6), (WarningKind::FaceLeftOut, 3)]);
    let said = said(&imported).join("\n");
    assert!(said.contains("(first at line 4: \"1,5\" is no number)"), "{said}");
    assert!(said.contains("(first at line 13: vertex 4 has no finite place, or is too far away)"), "{said}");
}

#[test]
fn a_face_that_is_wrong_costs_that_face() {
    let faces = [
        "1 2 900",
        "0 1 2",
        "-4 -2 -1",
        "1 2 x",
        "1 2 99999999999999999999",
        "1 2 4294967297",
        "1 2 3.0",
        "1,2,3",
    ];
    for face in faces {
        let imported = read(format!("o t\n{TRIANGLE}o u\nf {face}\nf 1 2 3\n"));
        assert_eq!((triangles(&imported), names(&imported)), (2, vec!["t", "u"]), "{face}");
        let said = warning(&imported);
        assert!(said.contains("1 faces left out") && said.contains("first at line 7: "), "{said}");
        assert!(said.ends_with("first in \"u\""), "{said}");
    }
    let said = warning(&read(format!("{TRIANGLE}f 1 2 900\n")));
    assert!(said.contains("vertex 900 of 3"), "{said}");
}

#[test]
fn corners_are_numbered_in_any_way() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nf 4 5 6\nv 5 0 0\nv 6 0 0\nv 5 1 0\n\
                f 1//2 2/3 3/4/5\nf 1/ 2// 3/x/9999\nf -3/-1/-1 +5 -1\nf 1 2 6 3\nfo 1 2 3\n";
    assert_eq!(triangles(&clean(text)), 8);
}

#[test]
fn numbers_of_any_length() {
    let long = format!("1.{}1", "0".repeat(5000));
    let imported =
        clean(format!("v 0 0 0\nv {long} 0 0\nv 0 +.5 0\nv 0 5. -0\nv 0 1e0 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n"));
    assert_eq!(triangles(&imported), 3);
    for far in ["nan", "-inf", "1e16", "1e400"] {
        let imported = read(format!("{TRIANGLE}v {far} 0 0\no b\nf 1 2 4\nf 1 2 3\n"));
        assert_eq!(
            (triangles(&imported), imported.report.counts()),
            (2, vec![(WarningKind::FaceLeftOut, 1)])
        );
    }
}

#[test]
fn statements_of_others_are_left_out_and_those_that_would_do_something_are_named() {
    let text = format!(
        "#pragma x\ncall other.obj 1\ncsh rm -rf /\n{TRIANGLE}bevel on\nlod 3\nvc 1 0 0\ns 1\nmg 0\nfoo\n"
    );
    let imported = read(text);
    assert_eq!(imported.report.counts(), [(WarningKind::UnknownStatement, 4)]);
    let said = said(&imported);
    assert!(
        said[0].contains("2 statements left out") && said[0].contains("first at line 10: \"vc 1 0 0\""),
        "{said:?}"
    );
    assert!(said[1].contains("(call, first at line 2: \"call other.obj 1\")"), "{said:?}");
    assert!(said[2].contains("csh"), "{said:?}");
}

#[test]
fn points_and_lines_are_counted() {
    let imported = read(format!("{TRIANGLE}o rail\nl 1 2 3\np 1\nf 1 2\nf 1\nf\n"));
    assert_eq!(imported.report.counts(), [(WarningKind::PointsOrLines, 5)]);
    assert_eq!(names(&imported), ["unnamed_object"]);
}

#[test]
fn objects_that_draw_nothing_are_left_out() {
    let text = format!(
        "o good\n{TRIANGLE}o flat\nv 50 50 50\nv 50 50 51\nf 4 5 4\no dot\nf 4 4 4\no thin\nf 1 2 3 2\n"
    );
    let imported = read(text);
    assert_eq!(names(&imported), ["good"]);
    assert_eq!(imported.report.counts(), [(WarningKind::EmptyObject, 3)]);
    assert!(warning(&imported).ends_with("first in \"flat\", \"dot\", \"thin\""), "{:?}", said(&imported));
}

#[test]
fn a_face_that_crosses_itself_evenly_is_covered() {
    let imported = clean("o bow\nv 0 0 0\nv 0.1 0.1 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3 4\n");
    assert_eq!((names(&imported), triangles(&imported)), (vec!["bow"], 2));
}

#[test]
fn every_object_that_is_left_has_a_place_in_the_scene() {
    // Also without area, but with a box.
    let imported = clean("o line\nv 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\no good\nv 0 1 0\nf 1 2 4\n");
    let scene = cook(&imported.model, &CookOptions::default(), &()).unwrap();
    assert!(scene.objects().iter().all(|object| (object.node as usize) < scene.nodes().len()));
    assert_eq!(scene.objects().len(), 2);
}

#[test]
fn packed_files_are_read() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}").as_bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    for name in ["a.obj.gz", "A.OBJ.GZ", "a.gz", "a.obj"] {
        let imported = import_beside(name, &packed, &[("a.mtl", b"newmtl m\nKd 1 0 0\n")]).unwrap();
        assert_eq!((colours(&imported), &*imported.model.sources[0].name), (vec![RED], name));
    }
    let error = import_bytes("a.rvm.gz", &packed).unwrap_err().to_string();
    assert!(error.contains("gunzip"), "{error}");
    let imported = import_bytes("a.obj.gz", &[&*packed, b"<!-- -->"].concat()).unwrap();
    assert!(
        said(&imported)
            .contains(&"a.obj.gz: 1 stretches of bytes behind what gzip packed ignored (8 bytes)".into())
    );
    // Unpacked by the downloading program.
    assert_eq!(triangles(&import_bytes("a.obj.gz", TRIANGLE.as_bytes()).unwrap()), 1);
}

/// Cutting it exactly would take time quadratic in its corners.
#[test]
fn a_face_of_very_many_corners_is_drawn() {
    use std::fmt::Write;
    let corners: u32 = 120_000;
    let mut text = String::new();
    for corner in 0..corners {
        let (sin, cos) = (f64::from(corner) * std::f64::consts::TAU / f64::from(corners)).sin_cos();
        let far = if corner % 2 == 0 { 100.0 } else { 90.0 };
        writeln!(text, "v {} {} 0", far * cos, far * sin).unwrap();
    }
    text += "f";
    (1..=corners).for_each(|corner| write!(text, " {corner}").unwrap());
    let imported = read(text);
    assert_eq!(triangles(&imported), u64::from(corners) - 2);
}

#[test]
fn nothing_but_faults_is_an_error() {
    match import_bytes("a.obj", b"<html>\n<body>v 1 2 3</body>\n") {
        Err(ImportError::Obj { source: ObjError::Nothing { first }, .. }) => {
            assert_eq!(first, "line 1: \"<html>\"");
        }
        other => panic!("{:?}", other.map(|imported| imported.report)),
    }
}

#[test]
fn the_first_line_that_is_wrong_is_told() {
    let error =
        import_bytes("a.obj", b"hello world\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\nv 1 x 0\n").unwrap_err();
    assert!(error.to_string().contains("line 1: \"hello world\""), "{error}");
}

#[test]
fn a_file_without_an_object_is_told_beside_others_and_refused_alone() {
    let folder = tempfile::TempDir::new().unwrap();
    let file = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    };
    let files = [file("a.obj", TRIANGLE), file("b.obj", "v 0 0 0\np 1\n"), file("c.obj", "")];
    let read =
        |files: &[_]| import(files, &ImportOptions::default(), &mut |_| {}).and_then(Imported::with_objects);
    let imported = read(&files).unwrap();
    let found: Vec<_> = imported.report.warnings.iter().map(|of| (&*of.file, of.kind)).collect();
    let without = WarningKind::FileWithoutObject;
    assert_eq!(found, [("b.obj", WarningKind::PointsOrLines), ("b.obj", without), ("c.obj", without)]);
    let error = read(&files[1..]).unwrap_err().to_string();
    for part in ["b.obj and 1 other files have nothing to draw", "(b.obj: 1 primitives of points", "export"] {
        assert!(error.contains(part), "{error}");
    }
    assert!(read(&files[2..]).unwrap_err().to_string().starts_with("c.obj has nothing to draw"));
}

/// Variations of a file with the same meaning.
#[derive(Debug, Clone)]
struct Style {
    end: &'static str,
    gap: &'static str,
    mark: bool,
    utf16: bool,
    comments: bool,
    relative: bool,
    textures: &'static str,
    goes_on: bool,
    last_end: bool,
    packed: bool,
    triangles: bool,
    weight: bool,
}

fn styles() -> impl Strategy<Value = Style> {
    let flags = prop::array::uniform8(any::<bool>());
    let ends = prop::sample::select(vec!["\n", "\r\n", "\r"]);
    let gaps = prop::sample::select(vec![" ", "\t", "  \t "]);
    let textures = prop::sample::select(vec!["", "/1", "//1", "/1/1"]);
    (flags, ends, gaps, textures, any::<bool>()).prop_map(|(flags, end, gap, textures, weight)| {
        let [mark, utf16, comments, relative, goes_on, last_end, packed, triangles] = flags;
        Style {
            end,
            gap,
            mark,
            utf16,
            comments,
            relative,
            textures,
            goes_on,
            last_end,
            packed,
            triangles,
            weight,
        }
    })
}

/// A cube of side 2 in a style.
fn cube(style: &Style) -> Vec<u8> {
    let Style { end, gap, .. } = style;
    let mut lines = vec!["o cube".to_owned(), "vt 0 0".to_owned(), "vn 0 0 1".to_owned()];
    let weight = if style.weight { format!("{gap}0.25") } else { String::new() };
    for corner in 0..8 {
        let side = |axis: u32| if corner >> axis & 1 == 1 { "1.0" } else { "-1" };
        lines.push(format!("v{gap}{}{gap}{}{gap}{}{weight}", side(0), side(1), side(2)));
    }
    let quads: [[i32; 4]; 6] =
        [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    let break_here = if style.goes_on { format!(" \\{end} ") } else { String::new() };
    for quad in quads {
        let corners = quad.map(|corner| {
            let number = if style.relative { corner - 9 } else { corner };
            format!("{number}{}", style.textures)
        });
        let [a, b, c, d] = &corners;
        if style.triangles {
            lines.push(format!("f{gap}{a}{gap}{b}{break_here}{gap}{c}"));
            lines.push(format!("f{gap}{a}{gap}{c}{gap}{d}"));
        } else {
            lines.push(format!("f{gap}{a}{gap}{b}{break_here}{gap}{c}{gap}{d}"));
        }
    }
    let comment = if style.comments { " # it's so" } else { "" };
    let mut text: String = lines.iter().map(|line| format!("{gap}{line}{comment}{end}")).collect();
    if !style.last_end {
        text.truncate(text.trim_end().len());
    }
    if style.mark || style.utf16 {
        text.insert(0, '\u{feff}');
    }
    let bytes = if style.utf16 {
        text.encode_utf16().flat_map(u16::to_le_bytes).collect()
    } else {
        text.into_bytes()
    };
    if !style.packed {
        return bytes;
    }
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&bytes).unwrap();
    encoder.finish().unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..Default::default() })]

    #[test]
    fn a_cube_is_the_same_however_it_is_written(style in styles()) {
        let imported = import_bytes("a.obj", &cube(&style)).unwrap();
        prop_assert_eq!(&imported.report.warnings, &[]);
        prop_assert_eq!(names(&imported), ["cube"]);
        let mesh = &imported.model.meshes[0];
        prop_assert_eq!((mesh.positions.len(), mesh.triangle_count()), (8, 12));
        let volume: f32 = mesh.indices.as_chunks::<3>().0.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
            a.dot(b.cross(c)) / 6.0
        }).sum();
        prop_assert!((volume - 8.0).abs() < 1e-4, "{}", volume);
    }

    #[test]
    fn any_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(imported) = import_bytes("a.obj", &bytes) {
            prop_assert_eq!(imported.model.check(), Ok(()));
        }
    }

    #[test]
    fn any_lines_do_no_harm(
        lines in prop::collection::vec(
            "(v|vn|f|fo|o|g|l|usemtl|mtllib|surf|call|#)?( |\t|-|\\.|/|#|\\\\|e|inf|nan|a\\.mtl|m|[0-9]{1,25}){0,9}", 0..20,
        ),
        library in prop::collection::vec("(newmtl|Kd|d|Tr|map_Kd|Ks)?( |-|\\.|#|m|nan|[0-9]{1,9}){0,9}", 0..9),
        end in prop::sample::select(vec!["\n", "\r", "\r\n", "\\\n"]),
    ) {
        let (text, library) = (TRIANGLE.to_owned() + &lines.join(end), library.join(end));
        let imported = import_beside("a.obj", text.as_bytes(), &[("a.mtl", library.as_bytes())]).unwrap();
        prop_assert_eq!(imported.model.check(), Ok(()));
    }
}
