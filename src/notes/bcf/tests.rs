//! BCF files, whole and hostile.

use std::{
    io::{Cursor, Read, Write},
    sync::Arc,
};

use proptest::prelude::*;
use trimaran_transport::causes;
use zip::{ZipArchive, ZipWriter, write::SimpleFileOptions};

use super::{
    super::{
        Camera, Frame, Guid, HeaderFile, Lens, Note, Owner, PartRef, Reply, Section, Snapshot, SnapshotKind,
        Status, Topic, View, Visibility, guid::tests::guid, note::tests::full,
    },
    *,
};

const TOPIC: &str = "84d4a28c-0638-4813-aa4b-bcd62fe5fc93";
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and pixels";

fn packed(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        zip.start_file(*name, SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A file of another tool: one topic with this markup, and other files in its folder.
fn theirs(version: &str, markup: &str, more: &[(&str, &[u8])]) -> Vec<u8> {
    let version = format!("<Version VersionId=\"{version}\"/>");
    let folder = |name: &str| format!("{TOPIC}/{name}");
    let more: Vec<_> = more.iter().map(|(name, bytes)| (folder(name), *bytes)).collect();
    let markup_name = folder("markup.bcf");
    let mut files = vec![("bcf.version", version.as_bytes()), (&*markup_name, markup.as_bytes())];
    files.extend(more.iter().map(|(name, bytes)| (&**name, *bytes)));
    packed(&files)
}

fn markup(topic: &str, rest: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?><Markup><Topic Guid=\"{TOPIC}\"><Title>Clash</Title>\
         <CreationDate>2015-03-23T10:59:26+01:00</CreationDate>\
         <CreationAuthor>a@example.com</CreationAuthor>{topic}</Topic>{rest}</Markup>"
    )
}

fn read(bytes: &[u8]) -> Result<Imported, BcfError> {
    import(bytes, &Frame::default())
}

fn refused(bytes: &[u8]) -> String {
    causes(&read(bytes).unwrap_err())
}

/// Notes as another program gets them.
fn written(notes: &[Note], version: BcfVersion) -> Vec<u8> {
    let notes: Vec<_> = notes.iter().cloned().map(Arc::new).collect();
    let snapshot = |_: &Note, view: &View| {
        let kind = view.snapshot?;
        Some(Snapshot { view: view.guid, kind, bytes: PNG.to_vec() })
    };
    export(&notes, version, &Frame::default(), &snapshot, &<[PartRef]>::to_vec).unwrap()
}

/// The text of a file in an archive.
fn text(bytes: &[u8], name: &str) -> String {
    let mut text = String::new();
    ZipArchive::new(Cursor::new(bytes)).unwrap().by_name(name).unwrap().read_to_string(&mut text).unwrap();
    text
}

/// The part of a note that comes back: BCF has no place, no owner, and no see-through parts.
fn told(note: &Note) -> Note {
    let mut told = Note { point: None, owner: None, ..note.clone() };
    told.topic.kind.get_or_insert_with(|| "Comment".to_owned());
    let status = if told.status == Status::Open { "Open" } else { "Closed" };
    told.topic.status.get_or_insert_with(|| status.to_owned());
    for view in &mut told.views {
        view.see_through = None;
    }
    told
}

#[test]
fn a_note_comes_back_from_both_versions() {
    let mut note = full(7 << 90);
    note.views[0].snapshot = Some(SnapshotKind::Png);
    let second = View { guid: guid(99), snapshot: Some(SnapshotKind::Png), ..note.views[0].clone() };
    note.views.push(second);
    for version in [BcfVersion::V2, BcfVersion::V3] {
        let mut expected = told(&note);
        if version == BcfVersion::V2 {
            for view in &mut expected.views {
                view.camera.as_mut().unwrap().aspect = 1.0;
            }
        }
        let imported = read(&written(std::slice::from_ref(&note), version)).unwrap();
        let [(back, snapshots)] = &imported.notes[..] else { panic!("{imported:?}") };
        assert_eq!(*back, expected, "{version}");
        let views: Vec<_> = snapshots.iter().map(|one| (one.view, &*one.bytes)).collect();
        assert_eq!(views, [(note.views[0].guid, PNG), (guid(99), PNG)]);
        assert_eq!(imported.left_out, Vec::<String>::new());
    }
}

/// The scene has y up, BCF has z up.
#[test]
fn a_camera_and_a_section_are_those_of_the_plant() {
    let mut note = full(1);
    let camera = Camera {
        eye: [1.0, 2.0, 3.0],
        forward: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        lens: Lens::VfovDeg(47.5),
        aspect: 1.5,
    };
    note.views[0].camera = Some(camera);
    note.views[0].sections = vec![Section::Plane { point: [0.0, 30.0, 0.5], direction: [0.0, 1.0, 0.0] }];
    let file = text(&written(&[note], BcfVersion::V3), &format!("{}/viewpoint.bcfv", guid(1)));
    let flat: String = file.split_whitespace().collect();
    let vector = |x: &str, y: &str, z: &str| format!("<X>{x}</X><Y>{y}</Y><Z>{z}</Z>");
    for expected in [
        format!("<CameraViewPoint>{}</CameraViewPoint>", vector("1", "-3", "2")),
        format!("<CameraDirection>{}</CameraDirection>", vector("0", "1", "0")),
        format!("<CameraUpVector>{}</CameraUpVector>", vector("0", "0", "1")),
        "<FieldOfView>47.5</FieldOfView><AspectRatio>1.5</AspectRatio>".to_owned(),
        // The direction is that of what is clipped.
        format!("<Location>{}</Location>", vector("0", "-0.5", "30")),
        format!("<Direction>{}</Direction>", vector("0", "0", "1")),
        "<VisibilityDefaultVisibility=\"true\"><Exceptions>".to_owned(),
    ] {
        assert!(flat.contains(&expected), "{expected} is not in {flat}");
    }
}

#[test]
fn a_topic_of_another_tool_comes_back_as_its_own() {
    let topic = "<Priority>High</Priority><Index>3</Index><Labels>MEP</Labels><Labels>Level 2</Labels>\
        <ModifiedDate>2015-04-01T08:00:00Z</ModifiedDate><ModifiedAuthor>b@example.com</ModifiedAuthor>\
        <DueDate>2015-05-01T00:00:00</DueDate><AssignedTo>c@example.com</AssignedTo><Stage>Tender</Stage>\
        <Description>Line 1\nLine &amp; 2</Description>\
        <BimSnippet SnippetType=\"clash\"><Reference>a.ifc</Reference></BimSnippet>\
        <DocumentReference isExternal=\"true\">\
        <ReferencedDocument>http://a</ReferencedDocument></DocumentReference>\
        <RelatedTopic Guid=\"A2ADE93C-7EE7-4D11-BB55-8292B4940FC3\"/>";
    let rest = "<Comment Guid=\"AABBCCDD-0638-4813-AA4B-BCD62FE5FC93\"><Date>2015-03-24T10:00:00Z</Date>\
        <Author></Author><Comment>Look</Comment>\
        <Viewpoint Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\"/></Comment>\
        <Viewpoints Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\"><Viewpoint>viewpoint.bcfv</Viewpoint>\
        <Snapshot>snapshot.png</Snapshot></Viewpoints>\
        <Viewpoints Guid=\"22222222-0638-4813-aa4b-bcd62fe5fc93\">\
        <Viewpoint>gone.bcfv</Viewpoint></Viewpoints>";
    let header = "<Markup><Header><File IfcProject=\"0YvctVUKr0kugbFTf53O9L\" isExternal=\"false\">\
        <Filename>a.ifc</Filename><Date>2015-03-01T00:00:00Z</Date></File></Header>";
    let view = "<VisualizationInfo Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\"><Components>\
        <ViewSetupHints SpacesVisible=\"false\"/><Selection><Component IfcGuid=\"3Fxyz01234567890123$_A\">\
        <OriginatingSystem>Archicad</OriginatingSystem></Component></Selection>\
        <Visibility DefaultVisibility=\"false\"><Exceptions><Component IfcGuid=\"0aB$_cD1eF2gH3iJ4kL5mN\"/>\
        </Exceptions></Visibility></Components><OrthogonalCamera>\
        <CameraViewPoint><X>1E1</X><Y> -2.5 </Y><Z>0</Z></CameraViewPoint>\
        <CameraDirection><X>0</X><Y>0</Y><Z>-1</Z></CameraDirection>\
        <CameraUpVector><X>0</X><Y>0</Y><Z>0</Z></CameraUpVector>\
        <ViewToWorldScale>12</ViewToWorldScale></OrthogonalCamera></VisualizationInfo>";
    let markup = markup(topic, rest).replace("<Markup>", header);
    let markup = markup.replace("<Topic ", "<Topic TopicType=\"Fault\" TopicStatus=\"In Progress\" ");
    let files: [(&str, &[u8]); 2] = [("viewpoint.bcfv", view.as_bytes()), ("snapshot.png", PNG)];
    let imported = read(&theirs("2.1", &markup, &files)).unwrap();
    let [(note, snapshots)] = &imported.notes[..] else { panic!("{imported:?}") };
    let some = |text: &str| Some(text.to_owned());
    assert_eq!(note.guid.to_string(), TOPIC);
    assert_eq!((&*note.title, &*note.text), ("Clash", "Line 1\nLine & 2"));
    assert_eq!((note.status, note.date.as_str()), (Status::Open, "2015-03-23T10:59:26+01:00"));
    assert_eq!(
        note.topic,
        Topic {
            kind: some("Fault"),
            status: some("In Progress"),
            server_id: None,
            priority: some("High"),
            index: Some(3),
            labels: vec!["MEP".to_owned(), "Level 2".to_owned()],
            links: vec![],
            modified: Some("2015-04-01T08:00:00Z".parse().unwrap()),
            modified_by: some("b@example.com"),
            due: Some("2015-05-01T00:00:00".parse().unwrap()),
            assigned_to: some("c@example.com"),
            stage: some("Tender"),
            related: vec!["a2ade93c-7ee7-4d11-bb55-8292b4940fc3".parse().unwrap()],
            files: vec![HeaderFile {
                project: some("0YvctVUKr0kugbFTf53O9L"),
                is_external: Some(false),
                name: some("a.ifc"),
                date: Some("2015-03-01T00:00:00Z".parse().unwrap()),
                ..HeaderFile::default()
            }],
        }
    );
    assert_eq!((&*note.replies[0].author, &*note.replies[0].text), ("unknown", "Look"));
    assert_eq!(note.replies[0].view, Some(note.views[0].guid));
    let seen = &note.views[0];
    let camera = seen.camera.unwrap();
    assert_eq!((camera.eye, camera.forward), ([10.0, 0.0, 2.5], [0.0, -1.0, 0.0]));
    assert_eq!((camera.up, camera.lens), ([0.0, 1.0, 0.0], Lens::Height(12.0)));
    assert_eq!(camera.aspect, 1.0, "BCF 2.1 does not say it");
    assert_eq!(seen.selected[0].system, some("Archicad"));
    let Visibility { default, exceptions } = &seen.visibility;
    assert_eq!((default, exceptions[0].ifc_guid.as_deref()), (&false, Some("0aB$_cD1eF2gH3iJ4kL5mN")));
    assert_eq!((snapshots.len(), seen.snapshot), (1, Some(SnapshotKind::Png)));
    assert_eq!(imported.left_out.len(), 2, "{:?}", imported.left_out);
    assert!(imported.left_out[0].contains("2 documents") && imported.left_out[1].contains("gone.bcfv"));

    for version in [BcfVersion::V2, BcfVersion::V3] {
        let again = read(&written(std::slice::from_ref(note), version)).unwrap();
        assert_eq!(again.notes[0].0, *note, "{version}");
    }
}

#[test]
fn a_status_that_has_changed_since_is_told() {
    let mut note = full(1);
    note.topic.status = Some("In Progress".to_owned());
    let status = |note: &Note| {
        let imported = read(&written(std::slice::from_ref(note), BcfVersion::V2)).unwrap();
        imported.notes[0].0.topic.status.clone().unwrap()
    };
    assert_eq!(status(&note), "In Progress");
    note.status = Status::Closed;
    assert_eq!(status(&note), "Closed");
    note.topic.status = Some("RESOLVED".to_owned());
    assert_eq!(status(&note), "RESOLVED");
}

#[test]
fn a_file_that_is_none_is_refused_with_what_and_where() {
    for bytes in [&b""[..], b"PK", b"<Markup/>", &written(&[full(1)], BcfVersion::V3)[..300]] {
        assert!(refused(bytes).contains("zip archive"), "{}", refused(bytes));
    }
    assert!(refused(&packed(&[])).contains("bcf.version"));
    let of = |version: &str| theirs(version, &markup("", ""), &[]);
    assert!(refused(&of("2.0")).contains("BCF \"2.0\": save it as 2.1 or 3.0"));
    assert!(read(&of("2.1")).is_ok() && read(&of(" 3.0")).is_ok());
    let wrong = |markup: &str| refused(&theirs("3.0", markup, &[]));
    let whole = markup("", "");
    for (from, to, told) in [
        (TOPIC, "../x", "Guid is \"../x\""),
        ("<Title>Clash</Title>", "", "Title is missing"),
        ("2015-03-23T10:59:26+01:00", "yesterday", "CreationDate is \"yesterday\""),
        ("<Topic ", "<Other ", "line 1"),
        ("Clash", "<![CDATA[\u{1b}]]>", "control characters"),
        ("Clash", &"x".repeat(2000), "more than 1000 bytes"),
    ] {
        let refused = wrong(&whole.replace(from, to));
        assert!(refused.contains(told) && refused.contains("markup.bcf"), "{to}: {refused}");
    }
    let viewpoints = "<Viewpoints Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\">\
        <Viewpoint>a.bcfv</Viewpoint></Viewpoints>";
    let camera = |x: &str, fov: &str| {
        let vector = |name: &str, x: &str| format!("<{name}><X>{x}</X><Y>1</Y><Z>0</Z></{name}>");
        let vectors =
            [vector("CameraViewPoint", x), vector("CameraDirection", "0"), vector("CameraUpVector", "0")];
        let view = format!(
            "<VisualizationInfo><PerspectiveCamera>{}<FieldOfView>{fov}</FieldOfView></PerspectiveCamera>\
             </VisualizationInfo>",
            vectors.concat()
        );
        read(&theirs("2.1", &markup("", viewpoints), &[("a.bcfv", view.as_bytes())])).map_err(|e| causes(&e))
    };
    assert!(camera("1", "60").is_ok());
    for (x, fov, told) in [
        ("NaN", "60", "X is \"NaN\""),
        ("1e999", "60", "X is \"1e999\""),
        ("", "60", "X is \"\""),
        ("1e300", "60", "the camera is not valid"),
        ("1", "0", "the camera is not valid"),
        ("1", "1,5", "FieldOfView is \"1,5\""),
    ] {
        let refused = camera(x, fov).unwrap_err();
        assert!(refused.contains(told), "{x} {fov}: {refused}");
    }
}

#[test]
fn names_that_lead_out_of_the_archive_are_refused() {
    for name in ["../evil", "a/../../evil", "/etc/passwd", "C:/evil", "..\\evil", "a/.."] {
        let bytes = packed(&[("bcf.version", b"<Version VersionId=\"3.0\"/>"), (name, b"x")]);
        assert!(refused(&bytes).contains("leads out of its folder"), "{name}: {}", refused(&bytes));
    }
    // A name in a topic is looked for in the archive alone.
    let viewpoints = |name: &str| {
        let names = format!("<Viewpoint>{name}</Viewpoint><Snapshot>{name}</Snapshot>");
        format!("<Viewpoints Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\">{names}</Viewpoints>")
    };
    for name in ["../../../../../../etc/passwd", "/etc/passwd", "file:///etc/passwd"] {
        let imported = read(&theirs("2.1", &markup("", &viewpoints(name)), &[])).unwrap();
        assert_eq!(imported.left_out.len(), 2, "{:?}", imported.left_out);
        assert_eq!(imported.notes[0].1, []);
    }
}

/// A few kilobytes that unpack to more than is read of a file.
#[test]
fn a_zip_bomb_is_refused() {
    let spaces = vec![b' '; 17 << 20];
    let bomb = [markup("", "").as_bytes(), &spaces].concat();
    let bytes = theirs("2.1", str::from_utf8(&bomb).unwrap(), &[]);
    assert!(bytes.len() < 100_000, "{}", bytes.len());
    assert!(refused(&bytes).contains("unpacks to more than 16777216 bytes"), "{}", refused(&bytes));
    // A picture that claims to be short.
    let viewpoints =
        "<Viewpoints Guid=\"11111111-0638-4813-aa4b-bcd62fe5fc93\"><Snapshot>s.png</Snapshot></Viewpoints>";
    let picture = [PNG, &vec![0; 9 << 20]].concat();
    let bytes = theirs("2.1", &markup("", viewpoints), &[("s.png", &picture)]);
    assert!(refused(&bytes).contains("s.png"), "{}", refused(&bytes));
    // Many small files.
    let many: Vec<String> = (0..50_001).map(|number| format!("{number}")).collect();
    let many: Vec<(&str, &[u8])> = many.iter().map(|name| (&**name, &b""[..])).collect();
    assert!(refused(&packed(&many)).contains("50001 files"));
}

#[test]
fn entities_are_refused_with_their_line() {
    let doctype = "<?xml version=\"1.0\"?>\n<!DOCTYPE x [<!ENTITY e SYSTEM \"file:///etc/passwd\">]>";
    let hostile = markup("<Description>&e;</Description>", "").replace("<?xml version=\"1.0\"?>", doctype);
    let told = refused(&theirs("3.0", &hostile, &[]));
    assert!(told.contains("line 2") && told.contains("DOCTYPE") && told.contains("markup.bcf"), "{told}");
    let told = refused(&theirs("3.0", &markup("<Description>\n&e;</Description>", ""), &[]));
    assert!(told.contains("line 2") && told.contains("entity \"e\""), "{told}");
}

/// Two programs could read another one each.
#[test]
fn a_name_that_comes_twice_is_refused() {
    let bytes = packed(&[("bcf.version", b"<Version VersionId=\"3.0\"/>"), ("a/b", b"1"), ("a\\b", b"2")]);
    assert!(refused(&bytes).contains("\"a/b\" twice"), "{}", refused(&bytes));
}

#[test]
fn a_topic_that_comes_twice_is_refused() {
    let markup = markup("", "");
    let files: [(&str, &[u8]); 3] = [
        ("bcf.version", b"<Version VersionId=\"2.1\"/>"),
        ("a/markup.bcf", markup.as_bytes()),
        ("b/markup.bcf", markup.as_bytes()),
    ];
    let told = refused(&packed(&files));
    assert!(told.contains(TOPIC) && told.contains("twice"), "{told}");
}

fn texts() -> impl Strategy<Value = String> {
    "[a-zA-ZäöüΩ😀<>&\"' \\n\\t]{0,20}"
}

fn filled() -> impl Strategy<Value = String> {
    "[a-zA-ZäöüΩ<>&\"'-]{1,12}"
}

prop_compose! {
    fn any_view()(
        bits in any::<u64>(),
        eye in prop::array::uniform3(-1e6..1e6_f64),
        forward in prop::array::uniform3(0.1..1.0_f64),
        vfov in 1.0..179.0_f64,
        metres in prop::option::of(0.1..1e4_f64),
        planes in prop::collection::vec(
            (prop::array::uniform3(-1e3..1e3_f64), prop::array::uniform3(0.1..1.0_f64)), 0..4,
        ),
        cut in prop::option::of(prop::array::uniform3(-1e3..1e3_f64)),
        default in any::<bool>(),
        parts in prop::collection::vec((filled(), filled()), 0..4),
    ) -> View {
        let parts: Vec<PartRef> = parts
            .into_iter()
            .map(|(system, id)| PartRef { ifc_guid: None, system: Some(system), id: Some(id) })
            .collect();
        let lens = metres.map_or(Lens::VfovDeg(vfov), Lens::Height);
        let plane = |(point, direction)| Section::Plane { point, direction };
        let block = cut.map(|lower| Section::Box { lower, upper: lower.map(|x| x + 1.5) });
        View {
            guid: guid(u128::from(bits)),
            camera: Some(Camera { eye, forward, up: [0.0, 1.0, 0.0], lens, aspect: 1.0 }),
            sections: planes.into_iter().map(plane).chain(block).collect(),
            selected: parts.clone(),
            visibility: Visibility { default: default || parts.is_empty(), exceptions: parts },
            see_through: None,
            snapshot: None,
        }
    }
}

prop_compose! {
    fn any_note()(
        bits in any::<u128>(),
        title in filled(),
        text in texts(),
        author in filled(),
        is_closed in any::<bool>(),
        views in prop::collection::vec(any_view(), 0..3),
        replies in prop::collection::vec((any::<u128>(), filled(), texts()), 0..4),
        labels in prop::collection::vec(filled(), 0..3),
        words in prop::array::uniform5(prop::option::of(filled())),
        index in prop::option::of(any::<i32>()),
    ) -> Note {
        let blank = |text: String| if text.trim().is_empty() { String::new() } else { text };
        let date: super::super::Date = "2026-11-30T13:05:00Z".parse().unwrap();
        let reply = |(bits, author, text)| Reply {
            guid: guid(bits),
            author,
            date: date.clone(),
            text: blank(text),
            view: views.first().map(|view: &View| view.guid),
        };
        let replies = replies.into_iter().map(reply).collect();
        let [kind, priority, stage, assigned_to, modified_by] = words;
        Note {
            guid: guid(bits),
            title,
            text: blank(text),
            author,
            date: date.clone(),
            status: if is_closed { Status::Closed } else { Status::Open },
            point: None,
            views,
            replies,
            owner: Some(Owner::Key("k".to_owned())),
            topic: Topic {
                kind, priority, stage, assigned_to, modified_by, labels, index, ..Topic::default()
            },
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_note_comes_back(note in any_note(), is_new in any::<bool>()) {
        let version = if is_new { BcfVersion::V3 } else { BcfVersion::V2 };
        let imported = read(&written(std::slice::from_ref(&note), version)).unwrap();
        prop_assert_eq!(&imported.notes[0].0, &told(&note));
        prop_assert_eq!(imported.left_out, Vec::<String>::new());
    }

    #[test]
    fn damaged_files_are_refused_or_read(
        at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = written(&[full(1)], BcfVersion::V3);
        let cut = cut.index(bytes.len());
        let _read = read(&bytes[..cut]);
        let at = at.index(bytes.len());
        bytes[at] = byte;
        let _read = read(&bytes);
    }

    #[test]
    fn no_version_panics(text in any::<String>()) {
        let _read = text.parse::<BcfVersion>();
    }
}

#[test]
fn a_guid_is_one_however_it_is_written() {
    let capitals = markup("", "").replace(TOPIC, &TOPIC.to_uppercase());
    let imported = read(&theirs("2.1", &capitals, &[])).unwrap();
    assert_eq!(imported.notes[0].0.guid, TOPIC.parse::<Guid>().unwrap());
}
