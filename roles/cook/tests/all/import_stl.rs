//! STL files as exporters write them, and what is wrong with some.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use trimaran_cook::import::{
    ImportError, ImportOptions, Imported, StlError, UpAxis, import_bytes as import_in_memory,
};
use trimaran_cook::{CookOptions, cook};

use crate::import_files::{floats, import_bytes, names};

const GREY: [u8; 4] = [153, 153, 153, 255];
/// Both triangles of a square of 2 m, in millimetres.
const SQUARE: [[f32; 9]; 2] = [
    [0.0, 0.0, 0.0, 2000.0, 0.0, 0.0, 2000.0, 2000.0, 0.0],
    [0.0, 0.0, 0.0, 2000.0, 2000.0, 0.0, 0.0, 2000.0, 0.0],
];

/// A binary file with this header, count, and triangles with two bytes each.
fn binary(header: &[u8], count: u32, triangles: &[([f32; 9], u16)]) -> Vec<u8> {
    let mut file = header.to_vec();
    file.resize(80, b' ');
    file.extend(count.to_le_bytes());
    for (corners, attribute) in triangles {
        file.extend(floats(&[0.0, 0.0, 1.0]));
        file.extend(floats(corners));
        file.extend(attribute.to_le_bytes());
    }
    file
}

fn square(header: &[u8], attributes: [u16; 2]) -> Vec<u8> {
    let [first, second] = SQUARE;
    binary(header, 2, &[(first, attributes[0]), (second, attributes[1])])
}

/// A facet of the text form.
fn facet(corners: &str) -> String {
    let vertices: String = corners.split(',').map(|corner| format!("      vertex {corner}\n")).collect();
    format!("  facet normal 0 0 1\n    outer loop\n{vertices}    endloop\n  endfacet\n")
}

fn solid(name: &str, facets: &[&str]) -> String {
    let facets: String = facets.iter().map(|corners| facet(corners)).collect();
    format!("solid {name}\n{facets}endsolid {name}\n")
}

fn read(bytes: impl AsRef<[u8]>) -> Imported {
    import_bytes("bracket.stl", bytes.as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Imports a file that must be without warnings.
fn clean(bytes: impl AsRef<[u8]>) -> Imported {
    let imported = read(bytes);
    assert_eq!(imported.report.warnings, []);
    imported
}

fn error(bytes: &[u8]) -> StlError {
    match import_bytes("bracket.stl", bytes) {
        Err(ImportError::Stl { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

fn warning(bytes: &[u8]) -> String {
    let said: Vec<String> = read(bytes).report.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 1, "{said:?}");
    said.concat()
}

/// The colours of the triangles, by their first corners.
fn colours(imported: &Imported) -> Vec<[u8; 4]> {
    let mesh = &imported.model.meshes[0];
    mesh.indices.iter().step_by(3).map(|&corner| mesh.colours[corner as usize].0).collect()
}

#[test]
fn a_binary_file_is_an_object_in_metres_with_z_up_and_joined_vertices() {
    // Programs begin the header of binary files with this word as well.
    for header in [&b"made by a test"[..], b"solid bracket", b""] {
        let Imported { model, report } = clean(square(header, [0; 2]));
        assert_eq!((model.objects[0].name.as_str(), report.triangles), ("bracket", 2), "{header:?}");
        assert_eq!(model.objects[0].to_world.translation, DVec3::new(1.0, 0.0, -1.0));
        assert_eq!(model.meshes[0].positions.len(), 4);
        assert_eq!(model.meshes[0].positions[0], Vec3::new(-1.0, 0.0, 1.0));
        assert!(model.meshes[0].colours.iter().all(|colour| colour.0 == GREY));
    }
}

#[test]
fn unit_and_axis_can_be_given() {
    let options = ImportOptions { unit: Some(1.0), up: Some(UpAxis::Y), ..Default::default() };
    let Imported { model, .. } = import_in_memory("a.stl".as_ref(), &square(b"", [0; 2]), &options).unwrap();
    assert_eq!(model.objects[0].to_world.translation, DVec3::new(1000.0, 1000.0, 0.0));
}

#[test]
fn solids_of_the_text_form_are_objects() {
    let text = [
        solid("left arm", &["0 0 0,1 0 0,0 1 0", "1 0 0,1 1 0,0 1 0"]),
        solid("", &["0 0 5,1 0 5,0 1 5"]),
        solid("hand # 2", &["0 0 9,1e1 0 9,10. +1 9,.0 1 9"]),
    ];
    let imported = clean(text.concat());
    assert_eq!(names(&imported), ["left arm", "bracket", "hand # 2"]);
    let indices: Vec<u32> = imported.model.objects.iter().map(|object| object.source_index).collect();
    assert_eq!(indices, [0, 1, 2]);
    let sizes: Vec<_> =
        imported.model.meshes.iter().map(|mesh| (mesh.triangle_count(), mesh.positions.len())).collect();
    assert_eq!(sizes, [(2, 4), (1, 3), (2, 4)]);
}

#[test]
fn words_in_capitals_lines_of_windows_and_facets_on_one_line_are_read() {
    let text = solid("A", &["0 0 0,1 0 0,0 1 0", "1 0 0,1 1 0,0 1 0"]);
    for text in [
        text.to_uppercase(),
        text.replace('\n', "\r\n"),
        text.replace('\n', "\r"),
        text.replace("  ", "\t"),
        format!("\u{feff}\n {text}"),
        text.replace("loop\n", "loop ").replace("0\n      vertex", "0 vertex"),
        // Without the words around the corners.
        text.replace("    outer loop\n", "").replace("    endloop\n", ""),
    ] {
        let imported = clean(&text);
        assert_eq!((names(&imported), imported.report.triangles), (vec!["A"], 2), "{text}");
    }
}

#[test]
fn names_keep_their_letters() {
    let text =
        [b"solid Beh\xE4lter C:\\parts\\\n", facet("0 0 0,1 0 0,0 1 0").as_bytes(), b"endsolid"].concat();
    assert_eq!(names(&clean(text)), ["Beh\u{e4}lter C:\\parts\\"]);
}

#[test]
fn colours_are_those_of_viscam_or_of_magics() {
    let of = |header: &[u8], attributes| colours(&clean(square(header, attributes)));
    // Red in VisCAM has the flag and the highest five bits.
    assert_eq!(of(b"", [0x8000 | 31 << 10, 0x8000 | 16]), [[255, 0, 0, 255], [0, 0, 132, 255]]);
    assert_eq!(of(b"", [0x001F, 0]), [GREY; 2]);
    let magics = b"COLOR=\x0A\x14\x1E\x80,MATERIAL=";
    assert_eq!(of(magics, [0x001F, 0xFFFF]), [[255, 0, 0, 255], [10, 20, 30, 128]]);
    assert_eq!(of(magics, [0, 0]), [[10, 20, 30, 128]; 2]);
    assert_eq!(of(b"x COLOR=\x0A\x14\x1E\0", [0, 0]), [[10, 20, 30, 255]; 2]);
    // The header ends in the middle of the colour.
    let cut = [&[b'x'; 72][..], b"COLOR=\x01\x02"].concat();
    assert_eq!(of(&cut, [0, 0]), [GREY; 2]);
}

#[test]
fn a_file_that_is_cut_off_says_so() {
    let file = square(b"", [0; 2]);
    for end in [84, 84 + 50, file.len() - 1] {
        let present = (end - 84) / 50;
        assert_eq!(error(&file[..end]), StlError::Cut { announced: 2, present });
    }
    let text = solid("a", &["0 0 0,1 0 0,0 1 0", "1 0 0,1 1 0,0 1 0"]);
    let whole = text.find("endloop").unwrap();
    let cut = text.rfind("vertex").unwrap();
    assert_eq!(error(&text.as_bytes()[..cut]), StlError::CutFacet { line: 13 });
    assert!(warning(&text.as_bytes()[..whole + 20]).contains("1 solids that never end"));
    let wrong = import_bytes("a.stl", &file[..50]).unwrap_err().to_string();
    assert!(wrong.contains("not what its name says"), "{wrong}");
}

#[test]
fn a_count_that_is_wrong_is_told() {
    let [first, second] = SQUARE.map(|corners| (corners, 0));
    for count in [0, u32::MAX] {
        let said = warning(&binary(b"", count, &[first, second]));
        assert!(said.contains("placeholders") && said.contains(&format!("({count} for 2)")), "{said}");
    }
    let said = warning(&binary(b"", 1, &[first, second]));
    assert!(said.contains("(50 bytes)"), "{said}");
    let more = [binary(b"", 2, &[first, second]), b"\0end".to_vec()].concat();
    assert!(warning(&more).contains("1 stretches of bytes behind the last triangle"), "{}", warning(&more));
    assert_eq!(
        error(&binary(b"", 2_000_000_000, &[first])),
        StlError::Cut { announced: 2_000_000_000, present: 1 }
    );
}

#[test]
fn a_facet_that_cannot_be_drawn_costs_only_itself() {
    let mut bad = SQUARE[1];
    for value in [f32::NAN, f32::INFINITY, 1e30] {
        bad[4] = value;
        let said = warning(&binary(b"", 2, &[(SQUARE[0], 0), (bad, 0)]));
        assert!(
            said.contains("1 faces left out") && said.contains("first at triangle 2: a corner"),
            "{said}"
        );
        let nothing = error(&binary(b"", 1, &[(bad, 0)])).to_string();
        assert!(nothing.contains("triangle 1: a corner has no finite place"), "{nothing}");
    }
    let good = "0 0 0,1 0 0,0 1 0";
    for (bad, what) in [
        ("0 0 0,1 0 0", "line 13: a facet of 2 corners"),
        ("0 0 0,1 x 0,0 1 0", "line 14: \"x\" is no number"),
        ("0 0 0,1 0,0 1 0", "line 14: \"\" is no number"),
        ("0 0 0,1 nan 0,0 1 0", "line 14: a corner has no finite place"),
    ] {
        let text = solid("a", &[good, bad]);
        assert!(warning(text.as_bytes()).contains(what), "{}", warning(text.as_bytes()));
        assert_eq!(read(text).report.triangles, 1);
    }
    let said = warning(format!("{}what is this\nnothing\n", solid("a", &[good])).as_bytes());
    assert!(said.contains("2 statements left out") && said.contains("line 10: \"what is this\""), "{said}");
}

#[test]
fn a_file_without_a_triangle_is_refused() {
    for file in [binary(b"", 0, &[]), binary(b"", 1, &[([0.0; 9], 0)]), b"solid a\nendsolid a\n".to_vec()] {
        let said = read(file).with_objects().unwrap_err().to_string();
        assert!(said.starts_with("bracket.stl has nothing to draw"), "{said}");
    }
}

#[test]
fn what_is_no_stl_is_refused() {
    let page =
        "<html><body>Not found: the file that you asked for is no longer here.</body></html> Good bye.";
    for bytes in [page.as_bytes(), b"", b"ply\n"] {
        let said = import_bytes("a.stl", bytes).unwrap_err().to_string();
        assert!(said.contains("a .stl file starts with the word solid"), "{said}");
    }
}

#[test]
fn packed_files_are_read() {
    let text = solid("a", &["0 0 0,1 0 0,0 1 0"]);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text.as_bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    for (name, bytes) in [("b.stl.gz", &packed), ("b.gz", &packed), ("b.stl.gz", &text.clone().into_bytes())]
    {
        assert_eq!(names(&import_bytes(name, bytes).unwrap()), ["a"], "{name}");
    }
}

#[test]
fn a_solid_of_many_facets_has_levels_of_detail() {
    let step = |number: u32| f64::from(number) * std::f64::consts::TAU / 96.0;
    let point = |i: u32, j: u32| {
        let ((a, b), (c, d)) = (step(i).sin_cos(), step(j).sin_cos());
        let ring = 100.0 + 30.0 * d;
        [ring * b, ring * a, 30.0 * c].map(|value| value as f32)
    };
    let mut triangles = Vec::new();
    for (i, j) in (0..96).flat_map(|i| (0..96).map(move |j| (i, j))) {
        let [a, b, c, d] =
            [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| point(i % 96, j % 96));
        for corners in [[a, b, c], [a, c, d]] {
            triangles.push((corners.concat().try_into().unwrap(), 0));
        }
    }
    let imported = clean(binary(b"", triangles.len() as u32, &triangles));
    assert_eq!(imported.model.meshes[0].positions.len(), 96 * 96);
    let scene = cook(&imported.model, &CookOptions::default(), &()).unwrap();
    let fewest = scene.drawables().iter().map(|drawable| drawable.triangles).min().unwrap();
    assert!(fewest < triangles.len() as u32 / 8, "{fewest}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..Default::default() })]

    /// A binary and a text file of the same triangles are the same mesh.
    #[test]
    fn both_forms_are_the_same(corners in prop::collection::vec(prop::array::uniform9(-1e3_f32..1e3), 1..20)) {
        let triangles: Vec<_> = corners.iter().map(|corners| (*corners, 0)).collect();
        let facets: Vec<String> = corners
            .iter()
            .map(|corners| corners.chunks(3).map(|c| format!("{} {} {}", c[0], c[1], c[2])).collect::<Vec<_>>().join(","))
            .collect();
        let text = solid("bracket", &facets.iter().map(String::as_str).collect::<Vec<_>>());
        let [a, b] = [read(binary(b"", triangles.len() as u32, &triangles)), read(text)];
        // Text has more digits than single precision, so only rounding differs.
        let [a, b] = [a, b].map(|imported| imported.model.meshes[0].clone());
        prop_assert_eq!(a.indices, b.indices);
        for (a, b) in a.positions.iter().zip(&b.positions) {
            prop_assert!(a.distance(*b) < 1e-6, "{} {}", a, b);
        }
    }
}
