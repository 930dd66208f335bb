//! Plant coordinates in a real browser: where the eye is, what is at the pointer, and the way to others.

use std::fs;

use glam::DVec3;
use serde_json::{Value, json};

use super::controls::{ROOM, becomes, boxes, goes, look, number, numbers, press, state};
use crate::common::data::Data;
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// The room in a plant far away whose north is the model's x.
const PLANT: [&str; 2] = ["--origin=1000000,2000000,30", "--north=90"];

/// A service of the room with these flags of the import.
fn room(bench: &Bench, flags: &[&str]) -> Option<Service> {
    bench.write("room.obj", boxes(&ROOM));
    bench.done(&[&["import", "room.obj", "-o", "room.scene"], flags].concat());
    Service::of(bench, "room.scene", "127.0.0.1:0")
}

fn opened(browser: &mut Browser, service: &Service) {
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
}

/// Waits until the texts of elements are as expected, and returns them.
fn texts(browser: &mut Browser, selector: &str, holds: impl Fn(&[String]) -> bool) -> Vec<String> {
    let mut all = Vec::new();
    for _ in 0..1200 {
        all = serde_json::from_value(browser.done(json!({ "do": "text", "selector": selector }))).unwrap();
        if holds(&all) {
            return all;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("{selector}: {all:?}")
}

fn shows(browser: &mut Browser, selector: &str, expected: &[&str]) {
    texts(browser, selector, |all| all == expected);
}

fn row(name: &str) -> String {
    format!(".where [data-name={name}] > span")
}

fn stand(browser: &mut Browser, eye: [f64; 3], forward: [f64; 3]) {
    browser.done(json!({ "do": "stand", "eye": eye, "forward": forward }));
    browser.done(json!({ "do": "settle" }));
}

/// Types into the field for coordinates, in place of its text, and goes there.
fn type_coordinates(browser: &mut Browser, text: &str) {
    browser.done(json!({ "do": "tab", "name": "Go to coordinates" }));
    press(browser, "Control+a");
    browser.done(json!({ "do": "type", "text": text }));
    press(browser, "Enter");
}

fn copied(browser: &mut Browser, label: &str) -> Value {
    browser.done(json!({ "do": "label", "name": label }));
    texts(browser, &format!("[aria-label='{label}']"), |all| all == ["Copied"]);
    browser.done(json!({ "do": "pass" }));
    browser.done(json!({ "do": "clipboard" }))
}

/// The size of the picture, CSS pixels.
const SIZE: [u32; 2] = [1000, 800];

fn at_point(browser: &mut Browser, point: [f64; 3]) -> [f64; 2] {
    let place = numbers(&browser.done(json!({ "do": "point", "point": point })));
    [place[0], place[1]]
}

#[test]
fn by_keyboard_alone_one_reads_where_one_is_and_goes_to_coordinates() {
    let bench = Bench::empty();
    let Some(service) = room(&bench, &PLANT) else { return };
    let Some(mut browser) = Browser::start(SIZE[0], SIZE[1]) else { return };
    opened(&mut browser, &service);
    press(&mut browser, "2");
    stand(&mut browser, [0.0, 1.7, 6.0], [0.0, -0.2, -1.0]);
    press(&mut browser, "j");
    // East is z, and north x.
    let eye = "E 1000006.000 m, N 2000000.000 m, U 31.700 m";
    shows(&mut browser, &row("eye"), &[eye]);
    shows(&mut browser, ".where p:not([data-name])", &["looks W 270°, 11° down"]);
    // The floor in the middle of the picture, without a pointer.
    texts(&mut browser, &row("middle"), |all| all[0].ends_with(", U 30.000 m (face)"));
    shows(&mut browser, &row("pointer"), &["–"]);
    assert_eq!(copied(&mut browser, "Copy eye"), json!(eye));

    // North leads to the right, and east to the eye.
    let middle_of = |browser: &mut Browser, selector: &str| {
        let rect = browser.done(json!({ "do": "rects", "selector": selector }))[0].take();
        [number(&rect["x"]), number(&rect["y"])]
    };
    shows(&mut browser, ".compass text", &["N", "E", "S", "U"]);
    let [cube, north, up] =
        [".cube", ".compass .N", ".compass .U"].map(|selector| middle_of(&mut browser, selector));
    assert!(north[0] - cube[0] > 40.0 && up[1] - cube[1] < -40.0, "{cube:?} {north:?} {up:?}");

    // A corner of a box, and the way back.
    let before = state(&mut browser);
    type_coordinates(&mut browser, "E 999997 N 2000002 U 31");
    becomes(&mut browser, "going there", |now| now["eye"] != before["eye"]);
    let there = look(&mut browser);
    let corner = [2.0, 1.0, -3.0];
    let [x, y] = at_point(&mut browser, corner);
    assert!((x - 500.0).abs() < 2.0 && (y - 400.0).abs() < 2.0, "it is in the middle: {x} {y}");
    let way = DVec3::from_slice(&numbers(&there["eye"])).distance(DVec3::from_array(corner));
    assert!((2.0..12.0).contains(&way), "a few steps away: {way}");
    shows(&mut browser, &row("middle"), &["E 999997.000 m, N 2000002.000 m, U 31.000 m (vertex)"]);
    assert_eq!(browser.done(json!({ "do": "focused" }))["tag"], "canvas");
    assert_eq!(browser.done(json!({ "do": "rects", "selector": ".target" })).as_array().unwrap().len(), 1);
    press(&mut browser, "Alt+ArrowLeft");
    assert_eq!(look(&mut browser)["eye"], before["eye"]);

    // Anything else is told, and the eye stays.
    let faults = [
        ("12 13", "These are 2 numbers: it takes three, for E, N and U."),
        ("E 1 N 2 U", "U has no number."),
        ("999997, 1999998, 31 furlong", "“furlong” is neither a direction nor a unit."),
    ];
    for (text, fault) in faults {
        type_coordinates(&mut browser, text);
        shows(&mut browser, ".where [role=alert]", &[fault]);
    }
    type_coordinates(&mut browser, "0 0 0");
    let far = texts(&mut browser, ".where [role=alert]", |all| all.len() == 1 && all[0].contains("outside"));
    let extent = "E 999990.000 m to 1000010.000 m, N 1999990.000 m to 2000010.000 m, U 29.800 m to 31.000 m";
    assert!(far[0].ends_with(&format!("outside of the model, which has {extent}.")), "{far:?}");
    assert_eq!(look(&mut browser)["eye"], before["eye"]);
    // Escape leaves the field.
    press(&mut browser, "Escape");
    assert_eq!(browser.done(json!({ "do": "focused" }))["tag"], "canvas");
    press(&mut browser, "j");
    shows(&mut browser, ".where p", &[]);
}

#[test]
fn by_mouse_one_reads_points_boxes_sections_and_deltas_in_any_unit() {
    let bench = Bench::empty();
    let Some(service) = room(&bench, &PLANT) else { return };
    let Some(mut browser) = Browser::start(SIZE[0], SIZE[1]) else { return };
    opened(&mut browser, &service);
    press(&mut browser, "2");
    // The corner is in the middle, where no panel is.
    stand(&mut browser, [-2.0, 3.0, 4.0], [0.0, -0.35, -1.0]);
    let corner = [-2.0, 1.0, -3.0];
    let [x, y] = at_point(&mut browser, corner);
    browser.done(json!({ "do": "click", "x": x.round() - 2.0, "y": y.round() + 2.0 }));
    let box_of =
        ["E 999996.000 m to 999997.000 m", "N 1999997.000 m to 1999998.000 m", "U 30.000 m to 31.000 m"];
    let point = "E 999997.000 m, N 1999998.000 m, U 31.000 m";
    browser.done(json!({ "do": "button", "name": "Coordinates" }));
    shows(&mut browser, ".places li", &box_of);
    shows(&mut browser, ".places p > span", &[&format!("vertex: {point}")]);
    assert_eq!(copied(&mut browser, "Copy clicked point"), json!(point));
    assert_eq!(copied(&mut browser, "Copy box"), json!(box_of.join(", ")));

    // At the pointer, which rests on the corner before the panel opens.
    browser.done(json!({ "do": "wheel", "x": x.round() - 2.0, "y": y.round() + 2.0, "down": 0 }));
    press(&mut browser, "j");
    for name in ["pointer", "picked"] {
        shows(&mut browser, &row(name), &[&format!("{point} (vertex)")]);
    }
    for (unit, expected) in [
        ("mm", "E 999997000 mm, N 1999998000 mm, U 31000 mm"),
        ("ft-in", "E 3280830' 0.63\", N 6561673' 2.74\", U 101' 8.47\""),
        ("m", point),
    ] {
        browser.done(json!({ "do": "choose", "label": "Unit", "value": unit }));
        shows(&mut browser, &row("picked"), &[&format!("{expected} (vertex)")]);
        assert_eq!(copied(&mut browser, "Copy picked"), json!(expected));
        // Copied text leads back.
        browser.done(json!({ "do": "label", "name": "Go to coordinates" }));
        press(&mut browser, "Control+a");
        press(&mut browser, "Control+v");
        let now = goes(&mut browser, |browser| {
            browser.done(json!({ "do": "button", "name": "Go" }));
        });
        assert_eq!(now["mode"], "fly");
        let [x, y] = at_point(&mut browser, corner);
        assert!((x - 500.0).abs() < 2.0 && (y - 400.0).abs() < 2.0, "{unit}: {x} {y}");
        stand(&mut browser, [-2.0, 3.0, 4.0], [0.0, -0.35, -1.0]);
    }

    // A section around the picked box, and its sides.
    browser.done(json!({ "do": "button", "name": "Cut" }));
    browser.done(json!({ "do": "button", "name": "Box around" }));
    let around = "E 999995.965 m to 999997.035 m, N 1999996.965 m to 1999998.035 m, U 29.965 m to 31.035 m";
    shows(&mut browser, ".sections .place", &[around]);
    assert_eq!(copied(&mut browser, "Copy box of section"), json!(around));
    browser.done(json!({ "do": "button", "name": "Box ▸" }));
    browser.done(json!({ "do": "label", "name": "upper N in metres" }));
    press(&mut browser, "Control+a");
    browser.done(json!({ "do": "type", "text": "1999999.5" }));
    press(&mut browser, "Enter");
    let sections = becomes(&mut browser, "a larger box", |now| {
        now["sections"][0]["upper"].as_array().is_some_and(|upper| (number(&upper[0]) + 0.5).abs() < 1e-6)
    });
    assert!((number(&sections["sections"][0]["lower"][2]) + 4.0346).abs() < 1e-3, "{sections}");
    browser.done(json!({ "do": "button", "name": "Plane ahead" }));
    let planes = texts(&mut browser, ".sections .place", |all| all.len() == 2);
    assert!(planes[1].starts_with("E ") && !planes[1].contains(','), "across its axis: {planes:?}");

    // From one box to the other: four metres to the north.
    press(&mut browser, "Escape");
    press(&mut browser, "Escape");
    becomes(&mut browser, "nothing picked", |now| now["selected"] == json!([]));
    press(&mut browser, "Shift+H");
    browser.done(json!({ "do": "button", "name": "Measure" }));
    stand(&mut browser, [0.0, 3.0, 4.0], [0.0, -0.35, -1.0]);
    for corner in [corner, [2.0, 1.0, -3.0]] {
        let [x, y] = at_point(&mut browser, corner);
        let inwards = if corner[0] < 0.0 { -2.0 } else { 2.0 };
        browser.done(json!({ "do": "click", "x": x.round() + inwards, "y": y.round() + 2.0 }));
    }
    let other = "E 999997.000 m, N 2000002.000 m, U 31.000 m";
    shows(
        &mut browser,
        "[aria-label=Distances] p > span",
        &["dE 0.000 m, dN 4.000 m, dU 0.000 m", point, other],
    );
    assert_eq!(copied(&mut browser, "Copy parts of distance 1"), json!("dE 0.000 m, dN 4.000 m, dU 0.000 m"));
    assert_eq!(copied(&mut browser, "Copy to of distance 1"), json!(other));
}

#[test]
fn by_touch_one_goes_to_coordinates_on_a_phone() {
    let bench = Bench::empty();
    let Some(service) = room(&bench, &[]) else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    opened(&mut browser, &service);
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    stand(&mut browser, [0.0, 1.7, 6.0], [0.0, 0.0, -1.0]);
    tap(&mut browser, "Where");
    texts(&mut browser, &row("eye"), |all| all.len() == 1 && all[0].starts_with("E "));
    for target in browser.done(json!({ "do": "targets" })).as_array().unwrap() {
        assert!(number(&target["width"]) >= 43.9 && number(&target["height"]) >= 43.9, "{target}");
        assert_eq!(target["isMet"], true, "something is over {target}");
    }
    tap(&mut browser, "Go to coordinates");
    // Without flags, x is east and -z north.
    browser.done(json!({ "do": "type", "text": "-2; 3; 1" }));
    let now = goes(&mut browser, |browser| tap(browser, "Go"));
    let [x, y] = at_point(&mut browser, [-2.0, 1.0, -3.0]);
    assert!((x - 195.0).abs() < 2.0 && (y - 422.0).abs() < 2.0, "{x} {y}: {now}");
    // A finger picks, and its point is told.
    browser.done(json!({ "do": "touch", "x": x.round() - 2.0, "y": y.round() + 2.0, "milliseconds": 60 }));
    shows(&mut browser, &row("picked"), &["E -2.000 m, N 3.000 m, U 1.000 m (vertex)"]);
}

/// The review file of the platform with upright boxes that are large enough.
const REVIEW_FILE: &str = "HA-MECH.RVM";

/// A group of a review file whose only primitive is a box, upright along the axes of the plant.
#[derive(Debug)]
struct BoxGroup {
    name: String,
    min: DVec3,
    max: DVec3,
}

/// Reads such groups from the bytes of a binary file: only what this test needs, apart from the importer.
fn box_groups(bytes: &[u8]) -> Vec<BoxGroup> {
    let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let real = |at: usize| f64::from(f32::from_bits(word(at)));
    // The open groups: the name, the number of primitives, and the box of the last one.
    let mut open: Vec<(String, u32, Option<[DVec3; 2]>)> = Vec::new();
    let (mut found, mut at) = (Vec::new(), 0);
    while at + 24 <= bytes.len() {
        let id: String = (0..4).map(|letter| char::from(bytes[at + 4 * letter + 3])).collect();
        let body = at + 24;
        match id.as_str() {
            "CNTB" => {
                let length = 4 * word(body + 4) as usize;
                let name = String::from_utf8_lossy(&bytes[body + 8..body + 8 + length]);
                open.push((name.trim_end_matches('\0').to_owned(), 0, None));
            }
            "PRIM" => {
                let group = open.last_mut().unwrap();
                group.1 += 1;
                // Columns of a matrix in metres, the box stored with it, and the sides in millimetres.
                let column = |index: usize| {
                    let at = body + 8 + 12 * index;
                    DVec3::new(real(at), real(at + 4), real(at + 8))
                };
                let half = |axis: usize| real(body + 80 + 4 * axis) / 2.0;
                let is_box = word(body + 4) == 2;
                group.2 = is_box.then(|| {
                    let sides: [DVec3; 3] = [0, 1, 2].map(|axis| column(axis) * half(axis));
                    let reach = sides[0].abs() + sides[1].abs() + sides[2].abs();
                    // Upright boxes alone: others do not fill the box around them.
                    let is_upright =
                        sides.iter().all(|side| side.abs().max_element() > 0.9999 * side.length());
                    if is_upright { [column(3) - reach, column(3) + reach] } else { [DVec3::NAN; 2] }
                });
            }
            "CNTE" => {
                if let Some((name, 1, Some([min, max]))) = open.pop()
                    && min.is_finite()
                {
                    found.push(BoxGroup { name, min, max });
                }
            }
            "END:" => break,
            _ => {}
        }
        at = word(at + 16) as usize;
    }
    found
}

/// The numbers of a text with letters and units between.
fn metres_in(text: &str) -> Vec<f64> {
    text.split([' ', ',']).filter_map(|word| word.parse().ok()).collect()
}

/// On the real platform: the page tells the coordinates that stand in the review file.
#[test]
fn coordinates_on_the_platform_are_those_of_its_review_file() {
    let Some(data) = Data::find() else { return };
    let file = data.platform().into_iter().find(|file| file.ends_with(REVIEW_FILE)).unwrap();
    let groups = box_groups(&fs::read(&file).unwrap());
    // Large enough to tell its corners apart, one for each place and not many.
    let mut groups: Vec<BoxGroup> =
        groups.into_iter().filter(|group| (group.max - group.min).min_element() > 0.25).collect();
    println!("{} boxes", groups.len());
    let each = groups.len().div_ceil(20).max(1);
    groups = groups.into_iter().step_by(each).collect();
    assert!(groups.len() >= 5, "{} boxes", groups.len());

    let bench = Bench::empty();
    bench.done(&["import", file.to_str().unwrap(), "-o", "platform.scene"]);
    let info: Value = serde_json::from_str(&bench.done(&["info", "--json", "platform.scene"])).unwrap();
    assert_eq!(info["source_frames"], json!([{ "up": "z", "metres_per_unit": 0.001 }]));
    let bounds = ["min", "max"].map(|of| DVec3::from_slice(&numbers(&info["plant"][of])));
    assert!(
        groups.iter().all(|group| {
            group.min.cmpge(bounds[0] - 1e-3).all() && group.max.cmple(bounds[1] + 1e-3).all()
        })
    );
    let Some(service) = Service::of(&bench, "platform.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(SIZE[0], SIZE[1]) else { return };
    opened(&mut browser, &service);
    press(&mut browser, "2");
    press(&mut browser, "j");
    let mut compared = 0;
    for group in &groups {
        // From the south and above: the upper south-eastern corner.
        let corner = DVec3::new(group.max.x, group.min.y, group.max.z);
        stand(&mut browser, [0.0; 3], [0.0, 0.0, -1.0]);
        let typed = format!("{:.4}; {:.4}; {:.4}", corner.x, corner.y, corner.z);
        goes(&mut browser, |browser| type_coordinates(browser, &typed));
        // Within the picture of the box, beside its corner.
        let inwards = DVec3::new(-0.04, 0.0, -0.04);
        let to_scene = |at: DVec3| [at.x, at.z, -at.y];
        let [x, y] = at_point(&mut browser, to_scene(corner + inwards));
        browser.done(json!({ "do": "click", "x": x.round(), "y": y.round() }));
        if state(&mut browser)["selected"] == json!([]) {
            continue;
        }
        if texts(&mut browser, ".details h2", |all| !all.is_empty()) != [group.name.clone()] {
            // Something else is in front of it.
            continue;
        }
        if texts(&mut browser, ".places li", |_| true).is_empty() {
            browser.done(json!({ "do": "button", "name": "Coordinates" }));
        }
        let ranges = texts(&mut browser, ".places li", |all| all.len() == 3);
        for (axis, range) in ranges.iter().enumerate() {
            let shown = metres_in(range);
            let expected = [group.min[axis], group.max[axis]];
            let off = |end: usize| (shown[end] - expected[end]).abs();
            assert!(off(0) < 0.0006 && off(1) < 0.0006, "{group:?}: {shown:?}");
        }
        let picked = texts(&mut browser, &row("picked"), |all| all[0].ends_with(" m (vertex)"));
        let at = DVec3::from_slice(&metres_in(&picked[0]));
        assert!((at - corner).abs().max_element() < 0.0006, "{group:?}: {picked:?}");
        compared += 1;
    }
    println!("{compared} of {} boxes compared", groups.len());
    assert!(compared >= 3, "{compared} of {} show", groups.len());
}
