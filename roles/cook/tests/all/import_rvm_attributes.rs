//! Attribute files beside RVM files: finding them, reading them, and matching their groups.

use std::path::PathBuf;

use trimaran_cook::import::{
    ImportError, ImportLimits, ImportOptions, Imported, OverBudget, Resource, RvmError, WarningKind, import,
};

use crate::import_files::{RvmWriter, import_beside, import_bytes};

const FIRST: &str = "CADC_Attributes_File v1.0 , start: NEW , end: END , name_end: := , sep: &end&\r\n\
                     NEW Header Information\r\n Source := PDMS Data &end& User := x\r\nEND\r\n";

fn file(groups: impl Fn(RvmWriter) -> RvmWriter) -> Vec<u8> {
    groups(RvmWriter::new()).finish()
}

/// A group with a box in it, not closed.
fn part(file: RvmWriter, name: &str) -> RvmWriter {
    file.open(name, 2).cuboid([0.0; 3], [1.0; 3])
}

/// One group called /A.
fn one() -> Vec<u8> {
    file(|file| part(file, "/A").close())
}

fn said(text: &str) -> String {
    FIRST.to_owned() + text
}

/// Name and value of all attributes of an object.
fn of(imported: &Imported, object: u32) -> Vec<(&str, &str)> {
    imported.model.hierarchy.attributes_of(object).iter().map(|of| (&*of.name, &*of.value)).collect()
}

fn warnings(imported: &Imported) -> Vec<(WarningKind, &str)> {
    imported.report.warnings.iter().map(|w| (w.kind, &*w.detail)).collect()
}

fn matched(imported: &Imported) -> (u64, u64) {
    (imported.report.parts_matched, imported.report.parts)
}

#[test]
fn parts_of_one_name_have_the_attributes_of_their_paths() {
    let model = file(|file| {
        let first = part(part(file, "/PIPE-1"), "FLANGE 1").close().close();
        let second = part(part(first, "/PIPE-2"), "FLANGE 1").close().close();
        part(part(second, "/PIPE-3"), "FLANGE 1").close().close()
    });
    let flange = |pipe: &str, spec: &str| format!("NEW {pipe}\n NEW FLANGE 1\n  SPEC := {spec}\n END\nEND\n");
    let text = said(&(flange("/PIPE-2", "B7C") + &flange("/PIPE-1", "A1A")));
    let imported = import_beside("a.rvm", &model, &[("a.att", text.as_bytes())]).unwrap();
    let specs: Vec<_> = (0..6).map(|object| of(&imported, object)).collect();
    assert_eq!(specs, [vec![], vec![("SPEC", "A1A")], vec![], vec![("SPEC", "B7C")], vec![], vec![]]);
    assert_eq!(matched(&imported), (4, 6));
}

#[test]
fn attributes_are_found_beside_the_file_and_in_a_folder_of_its_name() {
    let text = |value: &str| said(&format!("NEW /A\n TYPE := {value}\nEND\n"));
    let (near, far) = (text("near"), text("far"));
    for name in ["a.att", "a.ATT", "a.txt", "a.TXT"] {
        let others = [(name, near.as_bytes()), ("a/b.att", far.as_bytes())];
        let imported = import_beside("a.rvm", &one(), &others).unwrap();
        assert_eq!(of(&imported, 0), [("TYPE", "near")], "{name}");
    }
    // In another system's case; of the folder as well.
    for name in ["A.Att", "a.Txt", "A/B.att"] {
        let imported = import_beside("a.rvm", &one(), &[(name, near.as_bytes())]).unwrap();
        assert_eq!((of(&imported, 0), warnings(&imported)), (vec![("TYPE", "near")], vec![]), "{name}");
    }
    // A text of another kind.
    let others = [("a.txt", &b"read me"[..]), ("a/b.Att", far.as_bytes()), ("a/c.log", near.as_bytes())];
    let imported = import_beside("a.rvm", &one(), &others).unwrap();
    assert_eq!((of(&imported, 0), warnings(&imported)), (vec![("TYPE", "far")], vec![]));
    let ends_with = |end: &str| imported.report.looked_for.iter().any(|path| path.ends_with(end));
    assert!(["a.rvm", "a.att", "a.TXT", "a", "a/b.Att"].into_iter().all(ends_with));
    assert_eq!(matched(&import_bytes("a.rvm", &one()).unwrap()), (0, 0));
}

#[test]
fn all_files_of_the_folder_are_read() {
    let model = file(|file| part(part(file, "/A").close(), "/B").close());
    let text = |name: &str| said(&format!("NEW {name}\n TYPE := {name}\n"));
    let others = [("m/2.att", text("/A")), ("m/1.txt", text("/B"))];
    let others = others.each_ref().map(|(name, text)| (*name, text.as_bytes()));
    let imported = import_beside("m.rvm", &model, &others).unwrap();
    assert_eq!([of(&imported, 0), of(&imported, 1)], [[("TYPE", "/A")], [("TYPE", "/B")]]);
}

#[test]
fn names_and_values_may_be_in_any_encoding() {
    let text = said("NEW /NAME-5\n DESC := 'NAME'\nEND\n");
    let filled = |name: &[u8]| {
        let parts: Vec<&[u8]> = text.split("NAME").map(str::as_bytes).collect();
        parts.join(name)
    };
    let sixteen = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    let unicode = text.replace("NAME", "Röhr");
    let cases = [
        ("", &b"R\xf6hr"[..], filled(b"R\xf6hr"), "Röhr"),
        ("Unicode UTF-8", "Röhr".as_bytes(), filled("Röhr".as_bytes()), "Röhr"),
        // A program that writes both files, each in its own way.
        ("Unicode UTF-8", "Röhr".as_bytes(), filled(b"R\xf6hr"), "Röhr"),
        ("Unicode UTF-8", "Röhr".as_bytes(), [b"\xff\xfe".to_vec(), sixteen(&unicode)].concat(), "Röhr"),
        ("Unicode UTF-8", "Röhr".as_bytes(), sixteen(&unicode), "Röhr"),
        ("ISO-8859-1", b"R\xf6hr", ["\u{feff}", &*unicode].concat().into_bytes(), "Röhr"),
        ("Japanese Shift-JIS", b"\x94z\x8a\xc7", filled(b"\x94z\x8a\xc7"), "配管"),
        ("Japanese Shift-JIS", b"\x94z\x8a\xc7", filled("配管".as_bytes()), "配管"),
        ("GBK", b"\xb9\xdc\xb5\xc0", filled(b"\xb9\xdc\xb5\xc0"), "管道"),
    ];
    for (label, name, attributes, expected) in cases {
        let name = [b"/", name, b"-5"].concat();
        let model = RvmWriter::in_encoding(label).open_bytes(&name, 2).cuboid([0.0; 3], [1.0; 3]).close();
        let imported = import_beside("a.rvm", &model.finish(), &[("a.att", &attributes)]).unwrap();
        assert_eq!(
            (of(&imported, 0), matched(&imported)),
            (vec![("DESC", expected)], (1, 1)),
            "{label} {expected}"
        );
    }
}

/// For any position of the letters: only the first bytes of a file identify it.
#[test]
fn a_marked_file_is_known_whatever_the_model_is_in() {
    let model = RvmWriter::in_encoding("GBK").open("/A", 2).cuboid([0.0; 3], [1.0; 3]).close().finish();
    for more in 0..3 {
        let value = "x".repeat(more) + &"管".repeat(99);
        let text = format!("\u{feff}{FIRST}NEW /A\n DESC := {value}\nEND\n");
        let imported = import_beside("a.rvm", &model, &[("a.att", text.as_bytes())]).unwrap();
        assert_eq!((of(&imported, 0), warnings(&imported)), (vec![("DESC", &*value)], vec![]), "{more}");
    }
}

#[test]
fn lines_that_are_no_attribute_are_counted() {
    let text = said("NEW /A\n TYPE = PIPE\n L := line 1\nline 2 &end&\n\nEND\n");
    let imported = import_beside("a.rvm", &one(), &[("a.att", text.as_bytes())]).unwrap();
    assert_eq!(of(&imported, 0), [("L", "line 1")]);
    let said: Vec<_> = imported.report.warnings.iter().map(ToString::to_string).collect();
    let odd = "a.rvm: 2 lines of attribute files left out: they say no attribute \
               (a.att, first at line 6: \"TYPE = PIPE\")";
    assert_eq!(said, [odd]);
}

#[test]
fn quotes_and_spaces_around_a_value_or_a_name_are_no_part_of_it() {
    let model = file(|file| part(part(file, "/A  ").close(), "/B").close());
    let text =
        said("NEW /A\r\n\tTYPE:= 'EQUI' &end& DESC := 'Pump (duty)' &end&\r\nEND  \r\nNEW /B  \nT:=1\nEND");
    let imported = import_beside("a.rvm", &model, &[("a.att", text.as_bytes())]).unwrap();
    assert_eq!(of(&imported, 0), [("TYPE", "EQUI"), ("DESC", "Pump (duty)")]);
    assert_eq!(of(&imported, 1), [("T", "1")]);
    assert_eq!(imported.model.objects[0].name, "/A");
}

/// The same path twice, as in a file with several models.
#[test]
fn parts_of_one_path_share_what_is_said_and_each_copy_counts() {
    let model = file(|file| (0..40).fold(file, |file, _| part(file, "/A").close()));
    let text = said(&format!("NEW /A\n LONG := {}\nEND\n", "x".repeat(1000)));
    let import_within = |attribute_bytes| {
        let folder = tempfile::TempDir::new().unwrap();
        let path: PathBuf = folder.path().join("a.rvm");
        std::fs::write(&path, &model).unwrap();
        std::fs::write(folder.path().join("a.att"), &text).unwrap();
        let limits = ImportLimits { attribute_bytes, ..Default::default() };
        import(&[path], &ImportOptions { limits, ..Default::default() }, &mut |_| {})
    };
    let over = |imported: Result<Imported, ImportError>| match imported {
        Err(ImportError::Rvm { source: RvmError::Budget(OverBudget { resource, user, .. }), .. }) => {
            assert_eq!(resource, Resource::AttributeBytes);
            user
        }
        other => panic!("{:?}", other.map(|imported| imported.report)),
    };
    // 39 copies of 4 + 1000 + 16 bytes, besides the file.
    let exactly = text.len() as u64 + 39 * 1020;
    let imported = import_within(exactly).unwrap();
    assert_eq!((imported.model.hierarchy.attributes.len(), matched(&imported)), (40, (40, 40)));
    assert!(over(import_within(exactly - 1)).contains("several parts"));
    assert!(over(import_within(text.len() as u64 - 1)).contains("a.att"));
}

#[test]
fn an_attribute_file_that_cannot_be_used_is_told() {
    let imported = import_beside("a.rvm", &one(), &[("a.att", b"NEW /A\n")]).unwrap();
    let why = "a.att: it does not begin as an attribute file does";
    assert_eq!(warnings(&imported), [(WarningKind::AttributesUnread, why)]);
    let other = said("NEW /B\nEND\n");
    let imported = import_beside("a.rvm", &one(), &[("a.att", other.as_bytes())]).unwrap();
    assert_eq!(
        (warnings(&imported), matched(&imported)),
        (vec![(WarningKind::AttributesUnmatched, "")], (0, 1))
    );
}

/// Reading a pipe beside the model would never end.
#[cfg(unix)]
#[test]
fn a_pipe_beside_the_file_is_told_and_not_waited_for() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("a.rvm");
    std::fs::write(&path, one()).unwrap();
    for pipe in ["a.att", "a.txt"] {
        let made = std::process::Command::new("mkfifo").arg(folder.path().join(pipe)).status().unwrap();
        assert!(made.success());
    }
    let imported = import(&[path], &ImportOptions::default(), &mut |_| {}).unwrap();
    let why = ["a.att", "a.txt"].map(|name| format!("{name}: it is not a regular file"));
    let expected = why.each_ref().map(|why| (WarningKind::AttributesUnread, &**why));
    assert_eq!(warnings(&imported), expected);
}
