//! PLY files as scanners and mesh tools write them, and what is wrong with some.

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use trimaran_cook::import::{FilePosition, ImportError, Imported, PlyError, WarningKind};

use crate::import_files::{import_bytes, names};

const GREY: [u8; 4] = [153, 153, 153, 255];
const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const LIST: &str = "property list uchar int vertex_indices\n";
const SQUARE: &str = "0 0 0\n2 0 0\n2 2 0\n0 2 0\n";

/// A text file of these elements (name, rows, properties) and rows.
fn text(elements: &[(&str, usize, &str)], rows: &str) -> String {
    let elements: String =
        elements.iter().map(|(name, count, said)| format!("element {name} {count}\n{said}")).collect();
    format!("ply\nformat ascii 1.0\ncomment made by a test\n{elements}end_header\n{rows}")
}

/// A square with these faces.
fn square(faces: &[&str]) -> String {
    let rows = faces.join("\n");
    text(&[("vertex", 4, XYZ), ("face", faces.len(), LIST)], &format!("{SQUARE}{rows}\n"))
}

fn read(bytes: impl AsRef<[u8]>) -> Imported {
    import_bytes("scan.ply", bytes.as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Imports a file that must be without warnings.
fn clean(bytes: impl AsRef<[u8]>) -> Imported {
    let imported = read(bytes);
    assert_eq!(imported.report.warnings, []);
    imported
}

fn error(bytes: impl AsRef<[u8]>) -> PlyError {
    match import_bytes("scan.ply", bytes.as_ref()) {
        Err(ImportError::Ply { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

fn warning(bytes: impl AsRef<[u8]>) -> String {
    let said: Vec<String> = read(bytes).report.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 1, "{said:?}");
    said.concat()
}

/// The colours of the vertices, in their order.
fn colours(imported: &Imported) -> Vec<[u8; 4]> {
    imported.model.meshes[0].colours.iter().map(|colour| colour.0).collect()
}

/// Twice the area vector of all triangles.
fn area(imported: &Imported) -> Vec3 {
    let mesh = &imported.model.meshes[0];
    let at = |corner: u32| mesh.positions[corner as usize];
    mesh.indices.as_chunks::<3>().0.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a))).sum()
}

#[test]
fn a_file_is_one_object_in_metres_with_z_up() {
    let imported = clean(square(&["3 0 1 2", "3 0 2 3"]));
    assert_eq!((names(&imported), imported.report.triangles), (vec!["scan"], 2));
    assert_eq!(imported.model.objects[0].to_world.translation, DVec3::new(1.0, 0.0, -1.0));
    assert_eq!((imported.model.meshes[0].positions.len(), area(&imported)), (4, Vec3::Y * 8.0));
}

#[test]
fn faces_of_more_corners_and_strips_are_cut_into_triangles() {
    assert_eq!(area(&clean(square(&["4 0 1 2 3"]))), Vec3::Y * 8.0);
    let strips = "property list uchar int vertex_indices\n";
    // A strip, a break, the same strip in two parts; a corner twice turns a strip.
    for (row, twice) in [("4 0 1 3 2", 8.0), ("9 0 1 3 2 -1 0 1 3 2", 16.0), ("5 0 1 3 3 2", 4.0)] {
        let file = text(&[("vertex", 4, XYZ), ("tristrips", 1, strips)], &format!("{SQUARE}{row}\n"));
        assert_eq!(area(&clean(file)), Vec3::Y * twice, "{row}");
    }
}

/// The same square with unknown properties and elements, in one of the binary forms.
fn binary(format: &str, bytes_of: fn(&mut Vec<u8>, f64, &str)) -> Vec<u8> {
    let head = format!(
        "ply\r\nformat {format} 1.0\r\nelement camera 1\r\nproperty list ushort double view\r\n\
         element vertex 4\r\nproperty double x\r\nproperty float32 y\r\nproperty short quality (2)\r\n\
         property int8 z\r\nproperty uint16 red\r\nproperty uint16 green\r\nproperty uint16 blue\r\n\
         element nothing 4000000000\r\n\
         element face 2\r\nproperty uchar flags\r\nproperty list uint32 uint8 vertex_index\r\n\
         property list uchar float texcoord\r\nend_header\r\n"
    );
    let mut file = head.into_bytes();
    let mut put =
        |values: &[(f64, &str)]| values.iter().for_each(|(value, kind)| bytes_of(&mut file, *value, kind));
    put(&[(2.0, "u16"), (0.5, "f64"), (0.25, "f64")]);
    for (x, y) in [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)] {
        put(&[(x, "f64"), (y, "f32"), (-7.0, "i16"), (-3.0, "i8")]);
        put(&[(65535.0, "u16"), (0.0, "u16"), (13107.0, "u16")]);
    }
    for corners in [[0.0, 1.0, 2.0], [0.0, 2.0, 3.0]] {
        put(&[(1.0, "u8"), (3.0, "u32")]);
        put(&corners.map(|corner| (corner, "u8")));
        put(&[(1.0, "u8"), (0.5, "f32")]);
    }
    file
}

fn little(file: &mut Vec<u8>, value: f64, kind: &str) {
    match kind {
        "i8" => file.extend((value as i8).to_le_bytes()),
        "u8" => file.extend((value as u8).to_le_bytes()),
        "i16" => file.extend((value as i16).to_le_bytes()),
        "u16" => file.extend((value as u16).to_le_bytes()),
        "u32" => file.extend((value as u32).to_le_bytes()),
        "f32" => file.extend((value as f32).to_le_bytes()),
        _ => file.extend(value.to_le_bytes()),
    }
}

fn big(file: &mut Vec<u8>, value: f64, kind: &str) {
    let start = file.len();
    little(file, value, kind);
    file[start..].reverse();
}

#[test]
fn both_binary_forms_are_read_and_what_is_unknown_is_ignored() {
    for file in [binary("binary_little_endian", little), binary("binary_big_endian", big)] {
        let imported = clean(&file);
        assert_eq!(area(&imported), Vec3::Y * 8.0);
        assert_eq!(imported.model.objects[0].to_world.translation, DVec3::new(1.0, -3.0, -1.0));
        assert_eq!(colours(&imported), [[255, 0, 51, 255]; 4]);
        let more = [&*file, b"\0"].concat();
        assert!(warning(more).contains("(1 bytes)"));
    }
}

#[test]
fn every_cut_of_a_binary_file_is_an_error() {
    let file = binary("binary_little_endian", little);
    let head = file.len() - (2 + 16 + 4 * (8 + 4 + 2 + 1 + 6) + 2 * (1 + 4 + 3 + 1 + 4));
    for end in 0..file.len() {
        let error = import_bytes("a.ply", &file[..end]).unwrap_err();
        if end >= head {
            let ImportError::Ply { source: PlyError::Cut { at, .. }, .. } = error else { panic!("{error}") };
            assert!(matches!(at, FilePosition::Byte(at) if at <= end as u64), "{at}");
        }
    }
}

#[test]
fn colours_are_those_of_vertices_or_else_of_faces() {
    let rgb = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let floats = "property float r\nproperty float g\nproperty float b\nproperty float alpha\n";
    let coloured = |said: &str, values: [&str; 3], face: &str, of_face: &str| {
        let rows =
            format!("0 0 0 {}\n1 0 0 {}\n0 1 0 {}\n3 0 1 2 {of_face}\n", values[0], values[1], values[2]);
        let (vertex, face) = (format!("{XYZ}{said}"), format!("{LIST}{face}"));
        colours(&clean(text(&[("vertex", 3, &vertex), ("face", 1, &face)], &rows)))
    };
    let three = ["255 0 0", "0 255 0", "0 0 255"];
    let found = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]];
    assert_eq!(coloured(rgb, three, "", ""), found);
    assert_eq!(coloured(rgb, three, rgb, "9 9 9"), found);
    assert_eq!(coloured("", [""; 3], rgb, "9 8 7"), [[9, 8, 7, 255]; 3]);
    assert_eq!(coloured("", [""; 3], "", ""), [GREY; 3]);
    let red = "1 0 0.2 0.4";
    assert_eq!(coloured(floats, [red, red, "255 0 51 102"], "", ""), [[255, 0, 51, 102]; 3]);
    // Two of three are no colour.
    assert_eq!(coloured("property uchar red\nproperty uchar blue\n", ["9 9"; 3], "", ""), [GREY; 3]);
}

#[test]
fn faces_of_different_colours_share_no_vertex() {
    let face = format!(
        "{LIST}property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar diffuse_blue\n"
    );
    let rows = format!("{SQUARE}3 0 1 2 255 0 0\n3 0 2 3 0 255 0\n");
    let imported = clean(text(&[("vertex", 4, XYZ), ("face", 2, &face)], &rows));
    let mut all = colours(&imported);
    all.sort_unstable();
    assert_eq!((all[0], all[5], all.len()), ([0, 255, 0, 255], [255, 0, 0, 255], 6));
    assert_eq!(area(&imported), Vec3::Y * 8.0);
}

#[test]
fn points_without_faces_are_an_error_that_says_so() {
    for elements in [&[("vertex", 4, XYZ)][..], &[("vertex", 4, XYZ), ("face", 0, LIST)]] {
        let error = error(text(elements, SQUARE));
        assert_eq!(error, PlyError::PointCloud { points: 4 });
        assert!(error.to_string().contains("4 points and no faces") && error.to_string().contains("MeshLab"));
    }
}

#[test]
fn headers_that_are_wrong_are_named_by_line() {
    let said = |from: &str, to: &str| {
        let file = square(&["3 0 1 2"]);
        assert!(file.contains(from), "{from}");
        error(file.replace(from, to)).to_string()
    };
    assert!(said("ascii", "ebcdic").contains("line 2 of its header: \"ebcdic 1.0\" is no format"));
    assert!(said("format ascii 1.0\n", "").contains("line 9 of its header: no line gives the format"));
    assert!(said("float z", "quad z").contains("line 7 of its header: \"quad\" is no kind"));
    assert!(said("float z", "float w").contains("line 4 of its header: a vertex has no x, y and z"));
    assert!(said("vertex 4", "vertex four").contains("\"four\" is no number of rows"));
    assert!(said("vertex 4", "point 4").contains("no element is called vertex"));
    assert!(said("element vertex 4\n", "").contains("line 4 of its header: it is before any element"));
    assert!(said("comment", "remark").contains("\"remark made by a test\" is unknown"));
    let whole = square(&["3 0 1 2"]);
    let (head, _) = whole.split_at(whole.find("end_header").unwrap());
    assert!(error(head).to_string().contains("line 9 of its header: the file ends before end_header"));
}

#[test]
fn a_value_that_is_none_is_named_by_its_row() {
    let file = square(&["3 0 1 2"]);
    let PlyError::Value { at, element, row, what } = error(file.replace("2 2 0", "2 , 0")) else { panic!() };
    assert_eq!((at, &*element, row, &*what), (FilePosition::Line(13), "vertex", 3, "\",\" is no number"));
    assert!(error(square(&["-3 0 1 2"])).to_string().contains("-3 is no length of a list"));
    let PlyError::Cut { at, element, row, rows } = error(square(&["3 0 1 2", "3 0 1"])) else { panic!() };
    assert_eq!((at, &*element, row, rows), (FilePosition::Line(16), "face", 2, 2));
}

#[test]
fn a_face_that_cannot_be_drawn_costs_only_itself() {
    for (face, what) in [
        ("3 0 1 4", "first at face 2: a corner is at none of the 4 vertices"),
        ("3 0 1 -1", "first at face 2: a corner is at none of the 4 vertices"),
    ] {
        assert!(
            warning(square(&["3 0 1 2", face])).contains(what),
            "{}",
            warning(square(&["3 0 1 2", face]))
        );
        assert!(error(square(&[face])).to_string().contains("nothing of it can be drawn: face 1"));
    }
    for number in ["nan", "-1.#IND", "inf", "1e300", "-nan(ind)"] {
        let file = square(&["3 0 1 2", "3 0 2 3"]).replace("0 2 0\n", &format!("0 {number} 0\n"));
        assert!(warning(&file).contains("face 2: vertex 3 has no finite place"), "{}", warning(&file));
        // The vertex of no face moves nothing.
        let imported = clean(square(&["3 0 1 2"]).replace("0 2 0\n", &format!("0 {number} 0\n")));
        assert_eq!(imported.model.objects[0].to_world.translation, DVec3::new(1.0, 0.0, -1.0));
    }
}

#[test]
fn what_has_no_surface_is_counted() {
    let edges =
        [("vertex", 4, XYZ), ("face", 2, LIST), ("edge", 1, "property int vertex1\nproperty int vertex2\n")];
    let file = text(&edges, &format!("{SQUARE}3 0 1 2\n2 0 3\n0 1\n"));
    assert_eq!(read(file).report.counts(), [(WarningKind::PointsOrLines, 2)]);
    let said = warning(square(&["3 0 1 2"]).replace("made by a test", "TextureFile skin.png"));
    assert!(said.contains("base colour (skin.png)"), "{said}");
    let none =
        read(text(&[("vertex", 0, XYZ), ("face", 0, LIST)], "")).with_objects().unwrap_err().to_string();
    assert!(none.starts_with("scan.ply has nothing to draw"), "{none}");
}

#[test]
fn rows_may_be_broken_into_lines_and_end_in_any_way() {
    let file = square(&["3 0 1 2", "3 0 2 3"]);
    let (head, rows) = file.split_at(file.find("end_header\n").unwrap() + 11);
    for rows in [
        rows.replace(' ', "\n"),
        rows.replace('\n', "\r\n"),
        rows.trim_end().to_owned(),
        format!("\n\n {rows}"),
    ] {
        assert_eq!(area(&clean([head, &*rows].concat())), Vec3::Y * 8.0, "{rows:?}");
    }
    assert_eq!(area(&clean(file.replace('\n', "\r"))), Vec3::Y * 8.0);
    // A comment in Latin-1.
    let latin: Vec<u8> =
        file.replace("a test", "B~r").bytes().map(|b| if b == b'~' { 0xE4 } else { b }).collect();
    assert_eq!(area(&clean(latin)), Vec3::Y * 8.0);
}

#[test]
fn what_is_no_ply_is_refused() {
    for bytes in [&b"solid a\n"[..], b"", b"\x1f\x8b"] {
        let said = import_bytes("a.ply", bytes).unwrap_err().to_string();
        assert!(said.contains("a.ply"), "{said}");
    }
    assert!(error("plywood\n").to_string().contains("\"plywood\" is unknown"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..Default::default() })]

    /// Rows that the header does not announce, or too few.
    #[test]
    fn any_rows_do_no_harm(
        counts in prop::array::uniform3(0..30_u64),
        rows in prop::collection::vec("(-?[0-9]{1,3}(\\.[0-9])? ){0,6}", 0..20),
    ) {
        let [vertices, faces, strips] = counts;
        let head = format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\n{XYZ}element face {faces}\n{LIST}\
             element tristrips {strips}\n{LIST}end_header\n"
        );
        crate::models::ply(format!("{head}{}", rows.join("\n")).as_bytes());
    }
}
