//! Notes on the command line: lists, BCF files, and what is wrong with them.

use std::{
    fs,
    io::{Cursor, Write as _},
};

use serde_json::{Value, json};
use trimaran::notes::{
    Camera, Guid, Lens, Note, NotesFolder, PartRef, Snapshot, SnapshotKind, Status, Topic, View, Visibility,
};
use zip::{ZipWriter, write::SimpleFileOptions};

use crate::common::program::{Bench, printed, said};

const GUID: &str = "84d4a28c-0638-4813-aa4b-bcd62fe5fc93";
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and pixels";

fn guid(number: u32) -> Guid {
    format!("{number:08x}-0638-4813-aa4b-bcd62fe5fc93").parse().unwrap()
}

/// A note on the second object.
fn note() -> Note {
    let part = PartRef {
        ifc_guid: None,
        system: Some("Trimaran".to_owned()),
        id: Some("boxes.obj>box1".to_owned()),
    };
    let view = View {
        guid: guid(2),
        camera: Some(Camera {
            eye: [1.0, 2.0, 3.0],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            lens: Lens::VfovDeg(50.0),
            aspect: 1.5,
        }),
        sections: Vec::new(),
        selected: vec![part],
        visibility: Visibility::default(),
        see_through: None,
        snapshot: Some(SnapshotKind::Png),
    };
    Note {
        guid: guid(1),
        title: "Flange leaks".to_owned(),
        text: String::new(),
        author: "Ada".to_owned(),
        date: "2026-11-30T13:05:00Z".parse().unwrap(),
        status: Status::Open,
        point: Some([0.0, 1.0, 2.0]),
        views: vec![view],
        replies: Vec::new(),
        owner: None,
        topic: Topic::default(),
    }
}

/// Two boxes as a scene, `boxes.scene`, with a note that has a picture.
fn noted() -> Bench {
    let bench = Bench::empty();
    let corners = |x: f64| format!("v {x} 0 0\nv {} 0 0\nv {x} 1 0\nv {x} 0 1\n", x + 1.0);
    let faces = |at: usize| {
        let [a, b, c, d] = [at, at + 1, at + 2, at + 3];
        format!("f {a} {c} {b}\nf {a} {b} {d}\nf {a} {d} {c}\nf {b} {c} {d}\n")
    };
    bench.write(
        "boxes.obj",
        format!("o box0\n{}{}o box1\n{}{}", corners(0.0), faces(1), corners(4.0), faces(5)),
    );
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let folder = NotesFolder::new(bench.path("boxes.notes"), true);
    let snapshot = Snapshot { view: guid(2), kind: SnapshotKind::Png, bytes: PNG.to_vec() };
    folder.add(&note(), &[snapshot]).unwrap();
    bench
}

fn list(bench: &Bench, scene: &str) -> Value {
    serde_json::from_str(&bench.done(&["notes", scene, "--list", "--json"])).unwrap()
}

fn bcf(files: &[(&str, &str)]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, text) in files {
        zip.start_file(*name, SimpleFileOptions::default()).unwrap();
        zip.write_all(text.as_bytes()).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn notes_are_listed_for_people_and_for_scripts() {
    let bench = noted();
    let told = bench.done(&["notes", "boxes.scene", "--list"]);
    assert_eq!(told, "2026-11-30T13:05:00Z  open    Ada: Flange leaks (0 replies)\n");
    let listed = list(&bench, "boxes.scene");
    assert_eq!(listed["notes"][0]["title"], "Flange leaks");
    assert_eq!(listed["notes"][0]["views"][0]["camera"]["vfovDeg"], 50.0);
    assert_eq!(listed["damaged"], json!([]));
    // A damaged file is named, and the others are listed.
    fs::write(bench.path(&format!("boxes.notes/{GUID}.json")), "{").unwrap();
    let output = bench.trimaran(&["notes", "boxes.scene", "--list"]);
    assert!(printed(&output).contains("Flange leaks") && said(&output).contains(GUID), "{}", said(&output));
    assert_eq!(list(&bench, "boxes.scene")["damaged"].as_array().unwrap().len(), 1);
    // One of three things is to be done.
    assert_eq!(bench.trimaran(&["notes", "boxes.scene"]).status.code(), Some(2));
    assert_eq!(
        bench.trimaran(&["notes", "boxes.scene", "--list", "--version", "3.0"]).status.code(),
        Some(2)
    );
}

#[test]
fn notes_go_to_another_folder_by_both_versions_of_bcf() {
    let bench = noted();
    for version in ["2.1", "3.0"] {
        let told = bench.trimaran(&["notes", "boxes.scene", "--export", "boxes.bcf", "--version", version]);
        assert!(said(&told).contains(&format!("1 note as BCF {version}")), "{}", said(&told));
        let other = format!("other-{version}.notes");
        let import = ["notes", "boxes.scene", "--import", "boxes.bcf", "--notes", &other, "--json"];
        let imported: Value = serde_json::from_str(&bench.done(&import)).unwrap();
        assert_eq!(imported, json!({ "notes": 1, "leftOut": [] }));
        let back = NotesFolder::new(bench.path(&other), false);
        let there = back.get(guid(1)).unwrap();
        assert_eq!((&there.views[0].selected, &*there.title), (&note().views[0].selected, "Flange leaks"));
        assert_eq!(back.snapshot(guid(1), guid(2), SnapshotKind::Png).unwrap().bytes, PNG);
        // BCF has no place: it is that of the part.
        let [x, y, z] = there.point.unwrap();
        assert!(
            (4.0..=5.0).contains(&x) && (0.0..=1.0).contains(&y) && (0.0..=1.0).contains(&z),
            "{x} {y} {z}"
        );
        // Once more, and nothing is there twice.
        bench.done(&import);
        assert_eq!(back.all().unwrap().notes.len(), 1);
    }
    // Only a BCF file is written over.
    bench.write("plant.txt", "mine");
    let refused = bench.trimaran(&["notes", "boxes.scene", "--export", "plant.txt"]);
    assert_eq!(
        (refused.status.code(), fs::read(bench.path("plant.txt")).unwrap()),
        (Some(2), b"mine".to_vec())
    );
}

#[test]
fn a_hostile_file_changes_nothing_and_is_told_where() {
    let bench = noted();
    let version = ("bcf.version", "<Version VersionId=\"2.1\"/>");
    let doctype = "<!DOCTYPE x [<!ENTITY e SYSTEM \"file:///etc/passwd\">]><Markup/>";
    let markup = format!("{GUID}/markup.bcf");
    for (bytes, told) in [
        (b"no zip".to_vec(), "zip archive"),
        (bcf(&[("a", "b")]), "no \"bcf.version\""),
        (bcf(&[("bcf.version", "<Version VersionId=\"2.0\"/>")]), "save it as 2.1 or 3.0"),
        (bcf(&[version, ("../../evil", "x")]), "\"../../evil\" in it leads out"),
        (bcf(&[version, (&markup, doctype)]), "DOCTYPE"),
        (bcf(&[version, (&markup, "<Markup>\n\n<Topic>")]), "line 3"),
        (bcf(&[version, (&markup, &format!("<Markup/>{}", " ".repeat(17 << 20)))]), "unpacks to more than"),
    ] {
        bench.write("hostile.bcf", bytes);
        let output = bench.trimaran(&["notes", "boxes.scene", "--import", "hostile.bcf"]);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(told) && text.contains("hostile.bcf"), "{told}: {text}");
    }
    assert_eq!(list(&bench, "boxes.scene")["notes"].as_array().unwrap().len(), 1);
    assert!(!bench.path("evil").exists());
    let missing = bench.trimaran(&["notes", "boxes.scene", "--import", "none.bcf"]);
    assert!(said(&missing).contains("none.bcf"), "{}", said(&missing));
}
