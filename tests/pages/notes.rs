//! Notes in a real browser: written, read by others, answered, closed and deleted, and exchanged as BCF.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;

use serde_json::{Value, json};

use super::controls::{ROOM, becomes, look, number, numbers, opened, press, said, state};
use crate::common::page::{Browser, Service, TOKEN};
use crate::common::program::{Bench, printed, said as told};

/// Waits until the texts of some elements are as they should be.
fn reads(browser: &mut Browser, selector: &str, is_it: impl Fn(&[String]) -> bool) -> Vec<String> {
    for _ in 0..600 {
        let texts = browser.done(json!({ "do": "text", "selector": selector }));
        let texts: Vec<String> = serde_json::from_value(texts).unwrap();
        if is_it(&texts) {
            return texts;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("{selector} never reads so: {}", browser.done(json!({ "do": "text", "selector": selector })))
}

const ROWS: &str = ".notes li > .link";

fn rows(browser: &mut Browser, wanted: &[&str]) {
    reads(browser, ROWS, |texts| texts == wanted);
}

fn button(browser: &mut Browser, name: &str) {
    browser.done(json!({ "do": "button", "name": name }));
}

fn fill(browser: &mut Browser, label: &str, text: &str) {
    browser.done(json!({ "do": "label", "name": label }));
    browser.done(json!({ "do": "type", "text": text }));
}

/// Clicks an object where it can be met.
fn click(browser: &mut Browser, object: u32) {
    let place = browser.done(json!({ "do": "place", "object": object }));
    browser.done(json!({ "do": "click", "x": place["x"], "y": place["y"] }));
    becomes(browser, "the pick", |now| now["selected"] == json!([object]));
}

fn stand(browser: &mut Browser, eye: [f64; 3]) -> Value {
    browser.done(json!({ "do": "stand", "eye": eye, "forward": [0.0, -0.3, -1.0] }));
    look(browser)
}

/// The notes that the folder has.
fn kept(bench: &Bench) -> Vec<Value> {
    let listed = bench.done(&["notes", "boxes.scene", "--list", "--json"]);
    serde_json::from_str::<Value>(&listed).unwrap()["notes"].as_array().unwrap().clone()
}

/// The answer to a message of a page.
fn post(service: &Service, target: &str, body: &[u8]) -> String {
    let mut stream = TcpStream::connect(&service.at).unwrap();
    write!(
        stream,
        "POST {target} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n",
        service.at,
        body.len()
    )
    .unwrap();
    // It may refuse a long one early.
    let _refused = stream.write_all(body);
    let mut answer = Vec::new();
    let _cut = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

/// A note as a page sends it.
fn message(text: &str) -> Value {
    json!({
        "do": "write", "text": text, "author": "Eve", "key": "k", "point": [0, 1, 0], "eye": [0, 1, 2],
        "forward": [0, 0, -1], "up": [0, 1, 0], "vfovDeg": 60, "aspect": 1.5, "sections": [],
        "selected": [[1, 0]], "hidden": [], "isolated": null, "seeThrough": null, "picture": null,
    })
}

/// By the mouse: a note brings back what its writer saw, and another person answers it.
#[test]
fn a_note_brings_back_camera_sections_and_hidden_parts_and_others_answer() {
    let bench = Bench::empty();
    let Some((service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    press(&mut browser, "2");
    stand(&mut browser, [0.3, 2.0, 4.0]);
    // The note is about this: one box is hidden, the wall ahead is cut, the other box is picked.
    click(&mut browser, 2);
    press(&mut browser, "h");
    becomes(&mut browser, "a hidden box", |now| now["hidden"] == json!([2]));
    press(&mut browser, "b");
    button(&mut browser, "Plane ahead");
    let cut = becomes(&mut browser, "a section", |now| now["sections"].as_array().unwrap().len() == 1);
    browser.done(json!({ "do": "label", "name": "Cut away less" }));
    for _ in 0..40 {
        browser.done(json!({ "do": "label", "name": "Cut away less" }));
    }
    let written = becomes(&mut browser, "a moved section", |now| now["sections"] != cut["sections"]);
    look(&mut browser);
    click(&mut browser, 1);
    press(&mut browser, "n");
    reads(&mut browser, ".notes li", |texts| texts == ["There are no notes yet."]);
    button(&mut browser, "New note");
    reads(&mut browser, ".notes > p", |texts| texts == ["About box1"]);
    fill(&mut browser, "Your name", "Ada");
    fill(&mut browser, "Note", "Flange <leaks>\nsince Monday & before");
    button(&mut browser, "Keep note");
    rows(&mut browser, &["Flange <leaks>"]);
    reads(&mut browser, ".notes .note > p", |texts| texts == ["since Monday & before"]);
    let notes = kept(&bench);
    let [note] = &notes[..] else { panic!("{notes:?}") };
    assert_eq!((&note["author"], &note["status"]), (&json!("Ada"), &json!("open")));
    let view = &note["views"][0];
    assert_eq!(view["selected"], json!([{ "system": "Trimaran", "id": "boxes.obj>box1" }]));
    assert_eq!(
        view["visibility"],
        json!({ "default": true, "exceptions": [{ "system": "Trimaran", "id": "boxes.obj>box2" }] })
    );
    let point = numbers(&note["point"]);
    assert!((-3.0..=-2.0).contains(&point[0]) && (0.0..=1.0).contains(&point[1]), "on the box: {point:?}");
    // Its marker is where it was clicked, and its picture is one.
    let [x, y] =
        [0, 1].map(|axis| number(&browser.done(json!({ "do": "point", "point": note["point"] }))[axis]));
    let marker = browser.done(json!({ "do": "rects", "selector": ".marker" }));
    assert!((number(&marker[0]["x"]) - x).abs() < 2.0, "{marker} {x}");
    assert!((0.0..40.0).contains(&(y - number(&marker[0]["y"]))), "above it: {marker} {y}");
    let guid = note["guid"].as_str().unwrap();
    let picture = service.ask(&format!("/note-picture?token={TOKEN}&guid={guid}"), "");
    assert!(picture.contains("content-type: image/png") && picture.contains("PNG"), "{}", &picture[..200]);

    // Elsewhere, and whole again.
    press(&mut browser, "Shift+H");
    press(&mut browser, "Escape");
    press(&mut browser, "Escape");
    let elsewhere = stand(&mut browser, [7.0, 3.0, 9.0]);
    assert_eq!((&elsewhere["hidden"], &elsewhere["sections"]), (&json!([]), &json!([])));
    button(&mut browser, "Flange <leaks>");
    let back = becomes(&mut browser, "the note's view", |now| now["hidden"] == json!([2]));
    assert_eq!(back["sections"], written["sections"]);
    for (now, then) in numbers(&back["eye"]).iter().zip(numbers(&written["eye"])) {
        assert!((now - then).abs() < 1e-9, "{back}");
    }
    for (now, then) in numbers(&back["forward"]).iter().zip(numbers(&written["forward"])) {
        assert!((now - then).abs() < 1e-9, "{back}");
    }
    becomes(&mut browser, "the part", |now| now["selected"] == json!([1]));
    // One step of undo.
    press(&mut browser, "Control+z");
    becomes(&mut browser, "whole again", |now| now["hidden"] == json!([]) && now["sections"] == json!([]));

    // Somebody else reads and answers it, and cannot delete it.
    let mut other = Browser::start(900, 700).unwrap();
    other.done(json!({ "do": "open", "url": service.url() }));
    other.done(json!({ "do": "settle" }));
    press(&mut other, "n");
    rows(&mut other, &["Flange <leaks>"]);
    button(&mut other, "Flange <leaks>");
    becomes(&mut other, "the note's view", |now| now["hidden"] == json!([2]));
    reads(&mut other, ".notes .note button", |texts| texts == ["Reply", "Close note"]);
    button(&mut other, "Reply");
    fill(&mut other, "Your name", "Bob");
    fill(&mut other, "Reply", "Seen it.");
    button(&mut other, "Send reply");
    reads(&mut browser, ".note li p", |texts| texts == ["Seen it."]);
    // A new one of his is seen here soon.
    button(&mut other, "New note");
    fill(&mut other, "Note", "Second");
    button(&mut other, "Keep note");
    rows(&mut browser, &["Second", "Flange <leaks>"]);
    browser.done(json!({ "do": "choose", "label": "Author", "value": "Bob" }));
    rows(&mut browser, &["Second"]);
    browser.done(json!({ "do": "choose", "label": "Author", "value": "everybody" }));

    // Closed, it is struck through and can be opened again. It leaves the list of open ones with the panel.
    let struck = ".notes li.closed > .link";
    button(&mut browser, "Flange <leaks>");
    button(&mut browser, "Close note");
    for browser in [&mut browser, &mut other] {
        reads(browser, struck, |texts| texts == ["Flange <leaks>"]);
        rows(browser, &["Second", "Flange <leaks>"]);
    }
    button(&mut browser, "Open again");
    reads(&mut browser, struck, |texts| texts.is_empty());
    button(&mut browser, "Close note");
    reads(&mut browser, struck, |texts| texts == ["Flange <leaks>"]);
    press(&mut browser, "n");
    press(&mut browser, "n");
    rows(&mut browser, &["Second"]);
    browser.done(json!({ "do": "choose", "label": "Status", "value": "closed" }));
    rows(&mut browser, &["Flange <leaks>"]);
    button(&mut browser, "Flange <leaks>");
    button(&mut browser, "Open again");
    reads(&mut browser, ".notes .note button", |texts| texts.iter().any(|text| text == "Close note"));
    rows(&mut browser, &["Flange <leaks>"]);
    browser.done(json!({ "do": "choose", "label": "Status", "value": "open" }));
    rows(&mut browser, &["Second", "Flange <leaks>"]);
    browser.done(json!({ "do": "choose", "label": "Status", "value": "all" }));
    button(&mut browser, "Flange <leaks>");
    button(&mut browser, "Delete note");
    rows(&mut browser, &["Second"]);
    assert_eq!(kept(&bench).len(), 1);
    assert_eq!(fs::read_dir(bench.path("boxes.notes")).unwrap().count(), 3, "a note, its picture, the lock");
}

/// A marker behind a wall is pale, and bright again in front of it.
#[test]
fn markers_lead_to_their_notes_and_are_pale_behind_things() {
    let bench = Bench::empty();
    let wall = ([-4.0, 0.0, -2.0], [-1.0, 2.0, -1.8]);
    let Some((service, mut browser)) = opened(&bench, &[ROOM[0], ROOM[1], ROOM[2], wall], [900, 700]) else {
        return;
    };
    let mut note = message("Behind the wall");
    note["point"] = json!([-2.5, 0.5, -3.0]);
    let body = serde_json::to_vec(&note).unwrap();
    assert!(post(&service, &format!("/notes?token={TOKEN}"), &body).starts_with("HTTP/1.1 200"));
    press(&mut browser, "2");
    stand(&mut browser, [-2.5, 1.0, 3.0]);
    press(&mut browser, "n");
    let class = |browser: &mut Browser, selector: &str, count: usize| {
        reads(browser, selector, |found| found.len() == count);
    };
    class(&mut browser, ".marker.behind", 1);
    browser.done(json!({ "do": "stand", "eye": [-2.5, 6.0, -1.0], "forward": [0.0, -0.94, -0.34] }));
    look(&mut browser);
    class(&mut browser, ".marker:not(.behind)", 1);
    let marker = browser.done(json!({ "do": "rects", "selector": ".marker" }));
    browser.done(json!({ "do": "click", "x": marker[0]["x"], "y": marker[0]["y"] }));
    becomes(&mut browser, "the note's eye", |now| now["eye"] == json!([0, 1, 2]));
    becomes(&mut browser, "its part", |now| now["selected"] == json!([1]));
    // Without the panel there is none.
    press(&mut browser, "n");
    class(&mut browser, ".marker", 0);
}

#[test]
fn a_note_is_written_and_read_by_the_keyboard_alone() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    press(&mut browser, "2");
    let written = stand(&mut browser, [0.3, 2.0, 4.0]);
    press(&mut browser, "n");
    let tab = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tab", "name": name }));
    };
    reads(&mut browser, ".notes li", |texts| texts == ["There are no notes yet."]);
    tab(&mut browser, "New note");
    press(&mut browser, "Enter");
    reads(&mut browser, ".notes form", |forms| forms.len() == 1);
    // The text has the focus, and its keys move nothing.
    browser.done(json!({ "do": "type", "text": "wasd" }));
    press(&mut browser, "Shift+Tab");
    browser.done(json!({ "do": "type", "text": "Ada" }));
    press(&mut browser, "Tab");
    press(&mut browser, "Control+Enter");
    rows(&mut browser, &["wasd"]);
    assert_eq!(state(&mut browser)["eye"], written["eye"]);
    // The middle of the picture is its place.
    let point = numbers(&kept(&bench)[0]["point"]);
    assert!(point[1].abs() < 0.01, "on the floor: {point:?}");
    press(&mut browser, "Escape");
    browser.done(json!({ "do": "stand", "eye": [5.0, 3.0, 9.0], "forward": [0.0, 0.0, -1.0] }));
    tab(&mut browser, "wasd");
    press(&mut browser, "Enter");
    becomes(&mut browser, "the note's eye", |now| now["eye"] == written["eye"]);
    // Escape leaves a form, and keeps nothing.
    tab(&mut browser, "Reply");
    press(&mut browser, "Enter");
    reads(&mut browser, ".notes form", |forms| forms.len() == 1);
    browser.done(json!({ "do": "type", "text": "no" }));
    press(&mut browser, "Escape");
    reads(&mut browser, ".notes form", |forms| forms.is_empty());
    assert_eq!(kept(&bench)[0]["replies"], json!([]));
}

#[test]
fn a_note_is_written_by_touch_on_a_phone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", super::controls::boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    tap(&mut browser, "Notes");
    tap(&mut browser, "New note");
    tap(&mut browser, "Your name");
    browser.done(json!({ "do": "type", "text": "Ada" }));
    browser.done(json!({ "do": "label", "name": "Note" }));
    browser.done(json!({ "do": "type", "text": "From the deck" }));
    tap(&mut browser, "Keep note");
    rows(&mut browser, &["From the deck"]);
    // A finger meets each control, and none makes the phone zoom in.
    let targets = browser.done(json!({ "do": "targets" }));
    for target in targets.as_array().unwrap() {
        let is_field = matches!(target["tag"].as_str(), Some("input" | "select"));
        assert!(number(&target["height"]) >= 44.0, "{target}");
        assert!(!is_field || number(&target["letters"]) >= 16.0, "{target}");
    }
    tap(&mut browser, "Close note");
    reads(&mut browser, ".notes li.closed > .link", |texts| texts == ["From the deck"]);
    assert_eq!(kept(&bench)[0]["status"], "closed");
}

/// A token that may only look, and a service that only shows.
#[test]
fn notes_are_written_only_by_those_who_may() {
    let bench = Bench::empty();
    bench.write("boxes.obj", super::controls::boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let token = |name: &str, flags: &[&str]| {
        let output = bench.trimaran(&[&["token", "new", name][..], flags].concat());
        (told(&output).trim().rsplit(' ').next().unwrap().to_owned(), printed(&output))
    };
    let ((ada, entry_of_ada), (eve, entry_of_eve)) = (token("Ada", &[]), token("Eve", &["--look"]));
    assert!(entry_of_eve.contains("may = \"look\""), "{entry_of_eve}");
    bench.write("tokens.toml", [entry_of_ada, entry_of_eve].concat());
    let serve = ["serve", "boxes.scene", "--listen", "127.0.0.1:0", "--tokens", "tokens.toml"];
    let Some(service) = Service::by(bench.command(&serve)) else { return };
    let send = |service: &Service, token: &str, message: &Value| {
        post(service, &format!("/notes?token={token}"), &serde_json::to_vec(message).unwrap())
    };
    let refused = send(&service, &eve, &message("No"));
    assert!(refused.starts_with("HTTP/1.1 409") && refused.contains("write nothing"), "{refused}");
    let bcf = post(&service, &format!("/notes.bcf?token={eve}"), b"PK");
    assert!(bcf.starts_with("HTTP/1.1 409"), "{bcf}");
    assert!(!bench.path("boxes.notes").exists());
    // The author is the one whom the service knows, whatever the page says.
    let written = send(&service, &ada, &message("Yes"));
    assert!(written.starts_with("HTTP/1.1 200"), "{written}");
    let note = kept(&bench)[0].clone();
    assert_eq!((&note["author"], &note["owner"]), (&json!("Ada"), &json!({ "name": "Ada" })));
    let guid = note["guid"].as_str().unwrap();
    for change in [
        json!({ "do": "reply", "guid": guid, "text": "x", "author": "Ada" }),
        json!({ "do": "status", "guid": guid, "status": "closed" }),
        json!({ "do": "delete", "guid": guid, "key": "k" }),
    ] {
        assert!(send(&service, &eve, &change).starts_with("HTTP/1.1 409"), "{change}");
    }
    assert_eq!(kept(&bench), std::slice::from_ref(&note));
    let Some(mut browser) = Browser::start(900, 700) else { return };
    browser.done(json!({ "do": "open", "url": format!("http://{}/?token={eve}", service.at) }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "n");
    rows(&mut browser, &["Yes"]);
    button(&mut browser, "Yes");
    becomes(&mut browser, "the note's eye", |now| now["eye"] == json!([0, 1, 2]));
    reads(&mut browser, ".notes button", |texts| texts == ["Yes", "Save as BCF"]);
    drop(service);

    let shown = [&serve[..], &["--read-only"]].concat();
    let service = Service::by(bench.command(&shown)).unwrap();
    let refused = send(&service, &ada, &message("No"));
    assert!(refused.starts_with("HTTP/1.1 409") && refused.contains("only shown"), "{refused}");
    let list = service.ask(&format!("/notes?token={ada}"), "");
    assert!(list.contains("\"mayWrite\":false") && list.contains("\"title\":\"Yes\""), "{list}");
    assert_eq!(kept(&bench), [note]);
}

/// A note is whole or not there, for any message of a page.
#[test]
fn malformed_messages_keep_nothing() {
    let bench = Bench::empty();
    bench.write("boxes.obj", super::controls::boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let send = |body: &[u8]| post(&service, &format!("/notes?token={TOKEN}"), body);
    let with = |name: &str, value: Value| {
        let mut message = message("Note");
        message[name] = value;
        serde_json::to_vec(&message).unwrap()
    };
    let many: Vec<_> = (0..10_001).map(|_| json!([1, 0])).collect();
    let huge = String::from_utf8(with("eye", json!("E"))).unwrap().replace("\"E\"", "[1e999,0,0]");
    for (body, status) in [
        (b"".to_vec(), 400),
        (b"{".to_vec(), 400),
        (b"\xff\xfe".to_vec(), 400),
        (with("do", json!("dance")), 400),
        (with("text", json!(" \n ")), 400),
        (with("text", json!("\u{1b}[2J")), 400),
        (with("text", json!("x".repeat(70_000))), 400),
        (with("author", json!("")), 400),
        (with("point", json!([1e300, 0, 0])), 400),
        (huge.into_bytes(), 400),
        (with("forward", json!([0, 0, 0])), 400),
        (with("vfovDeg", json!(180)), 400),
        (with("sections", json!([{ "kind": "plane", "point": [0, 0, 0], "direction": [0, 0, 0] }])), 400),
        (with("selected", json!([[u32::MAX, 1]])), 400),
        (with("picture", json!("PHN2Zz4=")), 400),
        (with("picture", json!("***")), 400),
        (serde_json::to_vec(&json!({ "do": "status", "guid": "../x", "status": "open" })).unwrap(), 400),
    ] {
        let answer = send(&body);
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status}")),
            "{}: {answer}",
            String::from_utf8_lossy(&body[..body.len().min(300)])
        );
    }
    // The connection may end before the refusal is read.
    let long = send(&with("picture", json!("A".repeat(5 << 20))));
    assert!(long.is_empty() || long.starts_with("HTTP/1.1 413"), "{long}");
    // Objects that the scene does not have are left out.
    assert!(send(&with("selected", json!(many))).starts_with("HTTP/1.1 200"));
    let notes = kept(&bench);
    assert_eq!(
        (notes.len(), &notes[0]["views"][0]["selected"]),
        (1, &json!([{ "system": "Trimaran", "id": "boxes.obj>box1" }]))
    );
    let unknown =
        json!({ "do": "reply", "guid": "84d4a28c-0638-4813-aa4b-bcd62fe5fc93", "text": "x", "author": "y" });
    assert!(send(&serde_json::to_vec(&unknown).unwrap()).starts_with("HTTP/1.1 404"));
    // A key is never told, and another one does not delete.
    let guid = notes[0]["guid"].as_str().unwrap();
    assert!(!notes[0].to_string().contains("\"k\""));
    let delete =
        |key: &str| send(&serde_json::to_vec(&json!({ "do": "delete", "guid": guid, "key": key })).unwrap());
    for key in ["", "x", notes[0]["owner"]["key"].as_str().unwrap()] {
        assert!(delete(key).starts_with("HTTP/1.1 409"), "{key}");
    }
    assert!(delete("k").starts_with("HTTP/1.1 200"));
    // A wrong token, and a file that is no BCF.
    assert!(post(&service, "/notes?token=0123456789abcdef", b"{}").starts_with("HTTP/1.1 403"));
    let bcf = post(&service, &format!("/notes.bcf?token={TOKEN}"), b"PK");
    assert!(bcf.starts_with("HTTP/1.1 400") && bcf.contains("zip archive"), "{bcf}");
    let longer = post(&service, &format!("/notes.bcf?token={TOKEN}"), &vec![0; 33 << 20]);
    assert!(longer.is_empty() || longer.starts_with("HTTP/1.1 413"), "{longer}");
    assert!(service.ask(&format!("/notes?token={TOKEN}"), "").contains("\"notes\":[]"), "it goes on");
}

#[test]
fn notes_leave_a_page_as_bcf_and_come_back() {
    let bench = Bench::empty();
    let Some((service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    let body = serde_json::to_vec(&message("To and fro")).unwrap();
    assert!(post(&service, &format!("/notes?token={TOKEN}"), &body).starts_with("HTTP/1.1 200"));
    press(&mut browser, "n");
    rows(&mut browser, &["To and fro"]);
    for version in ["3.0", "2.1"] {
        browser.done(json!({ "do": "choose", "label": "Version", "value": version }));
        let path = bench.path(&format!("{version}.bcf"));
        let name = browser.done(json!({ "do": "download", "name": "Save as BCF", "path": path }));
        assert_eq!(name, "boxes.bcf");
        let before = kept(&bench)[0]["guid"].clone();
        let delete = json!({ "do": "delete", "guid": before, "key": "k" });
        let deleted = post(&service, &format!("/notes?token={TOKEN}"), &serde_json::to_vec(&delete).unwrap());
        // After the first round nobody owns it any more.
        if deleted.starts_with("HTTP/1.1 409") {
            fs::remove_file(bench.path(&format!("boxes.notes/{}.json", before.as_str().unwrap()))).unwrap();
        }
        rows(&mut browser, &[]);
        browser.done(json!({ "do": "upload", "selector": ".notes .file-input", "path": path }));
        rows(&mut browser, &["To and fro"]);
        said(&mut browser, |text| text.contains(&format!("{version}.bcf has 1 note.")));
        let note = &kept(&bench)[0];
        assert_eq!((&note["guid"], &note["author"]), (&before, &json!("Eve")));
        assert_eq!(note["views"][0]["selected"][0]["id"], "boxes.obj>box1");
    }
    bench.write("bad.bcf", "no zip");
    // The browser logs a refusal as an error.
    browser.tell(json!({ "do": "upload", "selector": ".notes .file-input", "path": bench.path("bad.bcf") }));
    said(&mut browser, |text| text.contains("zip archive"));
}
