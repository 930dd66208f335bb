//! Clearances in a real browser: the distance between two parts, other measures, and clashes.

use serde_json::{Value, json};

use super::controls::{becomes, boxes, look, opened, press, said, state};
use crate::common::cubes::grouped_row;
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// Boxes of 1 m in a row: 25 cm apart, touching, and 2 m apart.
const ROW: [([f64; 3], [f64; 3]); 4] = [
    ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ([1.25, 0.25, 0.0], [2.25, 1.25, 1.0]),
    ([2.25, 0.5, 0.0], [3.25, 1.5, 1.0]),
    ([5.25, 0.0, 0.0], [6.25, 1.0, 1.0]),
];

const DISTANCES: &str = "[aria-label=Distances] ol:not([aria-label]) strong";
const FINDINGS: &str = "[aria-label='Angles and surfaces'] strong";
const STATUS: &str = "[aria-label=Clashes] [role=status]";
const ROWS: &str = "[aria-label=Clashes] li";

/// A browser before the row.
fn before_it(size: [u32; 2]) -> Option<(Bench, Service, Browser)> {
    let bench = Bench::empty();
    let (service, mut browser) = opened(&bench, &ROW, size)?;
    stand(&mut browser);
    Some((bench, service, browser))
}

fn stand(browser: &mut Browser) {
    press(browser, "2");
    browser.done(json!({ "do": "stand", "eye": [3.1, 1.2, 7.5], "forward": [0.0, -0.05, -1.0] }));
    look(browser);
}

fn texts(browser: &mut Browser, selector: &str) -> Vec<String> {
    serde_json::from_value(browser.done(json!({ "do": "text", "selector": selector }))).unwrap()
}

/// Waits until the text of elements is this.
fn say(browser: &mut Browser, selector: &str, expected: &[&str]) {
    let is_it = (0..600).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        texts(browser, selector) == expected
    });
    assert!(is_it, "{selector}: {:?} and not {expected:?}", texts(browser, selector));
}

fn click(browser: &mut Browser, point: [f64; 3]) {
    let place = browser.done(json!({ "do": "point", "point": point }));
    let at = |axis: usize| place[axis].as_f64().unwrap_or_else(|| panic!("{point:?} does not show")).round();
    browser.done(json!({ "do": "click", "x": at(0), "y": at(1) }));
}

/// The middle of the front of a box.
fn front(number: usize) -> [f64; 3] {
    let (min, max) = ROW[number];
    [(min[0] + max[0]) / 2.0, (min[1] + max[1]) / 2.0, max[2]]
}

/// A corner of the front of a box is clicked a little inside of it, where the box still shows.
fn click_corner(browser: &mut Browser, number: usize, corner: [f64; 3]) {
    let middle = front(number);
    click(browser, [0, 1, 2].map(|axis| corner[axis] + 0.04 * (middle[axis] - corner[axis])));
}

fn measure(browser: &mut Browser, what: &str) {
    browser.done(json!({ "do": "choose", "label": "What is measured", "value": what }));
}

#[test]
fn the_clearance_of_two_parts_is_two_clicks_away() {
    let Some((_bench, _service, mut browser)) = before_it([1500, 700]) else { return };
    press(&mut browser, "m");
    measure(&mut browser, "Two parts");
    click(&mut browser, front(0));
    say(&mut browser, "[aria-label=Parts] li", &["box0"]);
    click(&mut browser, front(1));
    say(&mut browser, DISTANCES, &["0.250 m"]);
    assert_eq!(state(&mut browser)["selected"], json!([0, 1]));
    // The next two; the first pair stays in the list.
    click(&mut browser, front(3));
    say(&mut browser, "[aria-label=Parts] li", &["box3"]);
    click(&mut browser, front(2));
    say(&mut browser, DISTANCES, &["0.250 m", "2.000 m"]);
    click(&mut browser, front(1));
    say(&mut browser, "[aria-label=Parts] li", &["box1"]);
    click(&mut browser, front(2));
    say(&mut browser, "[aria-label=Distances] [role=status]", &["They touch or intersect."]);
    say(&mut browser, DISTANCES, &["0.250 m", "2.000 m", "0.000 m"]);
    press(&mut browser, "Control+z");
    say(&mut browser, DISTANCES, &["0.250 m", "2.000 m"]);
}

/// The search picks parts as clicks do.
#[test]
fn the_clearance_of_two_parts_by_the_keyboard_alone() {
    let Some((_bench, _service, mut browser)) = before_it([1000, 700]) else { return };
    press(&mut browser, "m");
    let kinds = "Two pointsTwo partsPoint to faceAngleArea or diameterPolygon";
    browser.done(json!({ "do": "tab", "name": kinds }));
    press(&mut browser, "ArrowDown");
    for name in ["box3", "box0"] {
        press(&mut browser, "/");
        press(&mut browser, "Control+a");
        browser.done(json!({ "do": "type", "text": name }));
        press(&mut browser, "Enter");
        becomes(&mut browser, "a pick", |now| !now["selected"].as_array().unwrap().is_empty());
        let is_it = (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            texts(&mut browser, "[aria-label=Parts] li").last().is_some_and(|last| last == name)
        });
        assert!(is_it, "{name}");
    }
    say(&mut browser, DISTANCES, &["4.250 m"]);
}

#[test]
fn angles_areas_and_perpendiculars_are_of_full_detail() {
    let Some((_bench, _service, mut browser)) = before_it([1500, 700]) else { return };
    press(&mut browser, "m");
    measure(&mut browser, "Angle");
    // The lower edge of the first box, and its diagonal.
    for corner in [[1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]] {
        click_corner(&mut browser, 0, corner);
    }
    say(&mut browser, FINDINGS, &["45.00°"]);
    measure(&mut browser, "Area or diameter");
    click(&mut browser, front(3));
    say(&mut browser, FINDINGS, &["45.00°", "1.0000 m²"]);
    measure(&mut browser, "Point to face");
    // From an upper corner of the third box to the plane of the first one's top.
    browser.done(json!({ "do": "stand", "eye": [3.1, 6.0, 7.5], "forward": [0.0, -0.6, -0.8] }));
    look(&mut browser);
    click_corner(&mut browser, 2, [3.25, 1.5, 1.0]);
    click(&mut browser, [0.5, 1.0, 0.5]);
    say(&mut browser, DISTANCES, &["0.500 m"]);
    browser.done(json!({ "do": "label", "name": "Remove measure 1" }));
    say(&mut browser, FINDINGS, &["1.0000 m²"]);
    // Measures stay where all is shown again, until they are cleared.
    press(&mut browser, "Shift+H");
    say(&mut browser, DISTANCES, &["0.500 m"]);
    browser.done(json!({ "do": "button", "name": "Clear" }));
    say(&mut browser, DISTANCES, &[]);
    say(&mut browser, FINDINGS, &[]);
    press(&mut browser, "Control+z");
    say(&mut browser, DISTANCES, &["0.500 m"]);
    // Escape takes a point back, and then leaves.
    measure(&mut browser, "Angle");
    click_corner(&mut browser, 2, [3.25, 1.5, 1.0]);
    press(&mut browser, "Escape");
    press(&mut browser, "Escape");
    press(&mut browser, "Escape");
    say(&mut browser, DISTANCES, &[]);
}

#[test]
fn a_polygon_is_closed_at_its_first_corner_or_by_a_key_and_its_corners_can_be_taken_back() {
    let Some((_bench, _service, mut browser)) = before_it([1500, 700]) else { return };
    press(&mut browser, "m");
    measure(&mut browser, "Polygon");
    // The front of the first box.
    let corners = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]];
    let clicks = |browser: &mut Browser, corners: &[[f64; 3]]| {
        for corner in corners {
            click_corner(browser, 0, *corner);
        }
    };
    let [square, triangle] = ["1.0000 m², perimeter 4.000 m", "0.5000 m², perimeter 3.414 m"];
    clicks(&mut browser, &corners);
    clicks(&mut browser, &corners[..1]);
    say(&mut browser, FINDINGS, &[square]);
    say(&mut browser, ".polygons text", &["1.0000 m²"]);
    browser.done(json!({ "do": "label", "name": "Copy measure 1" }));
    say(&mut browser, "[aria-label='Copy measure 1']", &["Copied"]);
    assert_eq!(browser.done(json!({ "do": "clipboard" })), json!(square));

    // A wrong corner is taken back, and a key closes.
    for key in ["Backspace", "Escape"] {
        clicks(&mut browser, &corners[..3]);
        click_corner(&mut browser, 3, [5.25, 0.0, 1.0]);
        press(&mut browser, key);
        press(&mut browser, "Enter");
        say(&mut browser, FINDINGS, &[square, triangle]);
        browser.done(json!({ "do": "label", "name": "Remove measure 2" }));
        say(&mut browser, FINDINGS, &[square]);
    }

    // Two corners are too few. A double click on the third one closes.
    clicks(&mut browser, &corners[..2]);
    press(&mut browser, "Enter");
    said(&mut browser, |text| text.contains("A polygon has at least three corners."));
    clicks(&mut browser, &[corners[2], corners[2]]);
    say(&mut browser, FINDINGS, &[square, triangle]);

    // Crossing edges make no area, and the button closes.
    clicks(&mut browser, &[corners[0], corners[2], corners[1], corners[3]]);
    browser.done(json!({ "do": "button", "name": "Close the polygon" }));
    say(&mut browser, FINDINGS, &[square, triangle, "no area: the edges cross, perimeter 4.828 m"]);
    say(&mut browser, ".polygons text", &["1.0000 m²", "0.5000 m²", "no area: the edges cross"]);
}

#[test]
fn clashes_are_found_shown_and_saved() {
    let Some((_bench, _service, mut browser)) = before_it([1000, 700]) else { return };
    press(&mut browser, "o");
    // Everything against everything, at 5 mm.
    browser.done(json!({ "do": "button", "name": "Run" }));
    say(&mut browser, STATUS, &["Clashes: 1, of them hard: 1."]);
    say(&mut browser, ROWS, &["hard box1 · box2"]);
    // One against all others, at 30 cm.
    click(&mut browser, front(1));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([1]));
    browser.done(json!({ "do": "label", "name": "Between: take what is picked" }));
    browser.done(json!({ "do": "label", "name": "Tolerance, mm" }));
    press(&mut browser, "Control+a");
    browser.done(json!({ "do": "type", "text": "300" }));
    press(&mut browser, "Enter");
    say(&mut browser, STATUS, &["Clashes: 2, of them hard: 1."]);
    say(&mut browser, ROWS, &["hard box1 · box2", "0.250 m box1 · box0"]);
    assert_eq!(browser.done(json!({ "do": "download", "name": "CSV" })), "boxes-clashes.csv");
    // A click goes there: both are solid, all others ghosts, and the gap is measured.
    let before = state(&mut browser)["eye"].take();
    browser.done(json!({ "do": "button", "name": "0.250 m" }));
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([2, 3]) && now["eye"] != before);
    let middle = browser.done(json!({ "do": "point", "point": [1.125, 0.6, 0.5] }));
    let at = |axis: usize| middle[axis].as_f64().unwrap();
    assert!((100.0..900.0).contains(&at(0)) && (50.0..650.0).contains(&at(1)), "{middle}");
    press(&mut browser, "Control+z");
    becomes(&mut browser, "the view before", |now| now["seeThrough"] == json!([]));
    // The next ones, with all others hidden.
    browser.done(json!({ "do": "choose", "label": "All others", "value": "hidden" }));
    browser.done(json!({ "do": "button", "name": "Previous" }));
    becomes(&mut browser, "the first clash", |now| now["selected"] == json!([1, 2]));
    look(&mut browser);
    let shown = browser.done(json!({ "do": "look" }))["objects"].take();
    let others = shown.as_array().unwrap().iter().filter(|object| ![json!(1), json!(2)].contains(object));
    assert!(others.count() == 0 && !shown.as_array().unwrap().is_empty(), "{shown}");
    // Another panel, and back: the list is still there.
    press(&mut browser, "p");
    press(&mut browser, "o");
    say(&mut browser, ROWS, &["hard box1 · box2", "0.250 m box1 · box0"]);
    // The second set; and a tolerance that is none.
    browser.done(json!({ "do": "label", "name": "And: take what is picked" }));
    browser.done(json!({ "do": "label", "name": "Between: take all objects" }));
    browser.done(json!({ "do": "button", "name": "Run" }));
    say(&mut browser, STATUS, &["Clashes: 2, of them hard: 1."]);
    browser.done(json!({ "do": "label", "name": "Tolerance, mm" }));
    press(&mut browser, "Control+a");
    browser.done(json!({ "do": "type", "text": "near" }));
    press(&mut browser, "Enter");
    say(&mut browser, STATUS, &["Enter the tolerance in millimetres, such as 5 or 0.5."]);
}

#[test]
fn closing_the_clashes_gives_back_the_view_of_before() {
    let Some((_bench, _service, mut browser)) = before_it([1000, 700]) else { return };
    click(&mut browser, front(3));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([3]));
    press(&mut browser, "h");
    becomes(&mut browser, "a hidden box", |now| now["hidden"] == json!([3]));
    press(&mut browser, "o");
    browser.done(json!({ "do": "button", "name": "Run" }));
    say(&mut browser, STATUS, &["Clashes: 1, of them hard: 1."]);
    browser.done(json!({ "do": "button", "name": "Next" }));
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([0, 3]));
    // A note is about the clash: another panel leaves it as it is.
    press(&mut browser, "m");
    say(&mut browser, DISTANCES, &["0.000 m"]);
    assert_eq!(state(&mut browser)["seeThrough"], json!([0, 3]));
    press(&mut browser, "o");
    say(&mut browser, ROWS, &["hard box1 · box2"]);
    browser.done(json!({ "do": "label", "name": "Close Clashes" }));
    let is_before = |now: &Value| now["seeThrough"] == json!([]) && now["hidden"] == json!([3]);
    becomes(&mut browser, "the view before", is_before);
    press(&mut browser, "m");
    say(&mut browser, DISTANCES, &[]);
    // Show all ends a clash as well, with its distance.
    press(&mut browser, "Control+z");
    becomes(&mut browser, "the clash again", |now| now["seeThrough"] == json!([0, 3]));
    say(&mut browser, DISTANCES, &["0.000 m"]);
    press(&mut browser, "Shift+H");
    becomes(&mut browser, "all", |now| now["seeThrough"] == json!([]) && now["hidden"] == json!([]));
    say(&mut browser, DISTANCES, &[]);
}

#[test]
fn clashes_within_groups_are_ignored_and_others_listed_by_groups() {
    let bench = Bench::empty();
    bench.write("groups.gltf", grouped_row());
    bench.done(&["import", "groups.gltf", "--origin", "100,200,30", "-o", "groups.scene"]);
    let Some(service) = Service::of(&bench, "groups.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(1000, 700) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "o");
    browser.done(json!({ "do": "choose", "label": "Ignore", "value": "in the same part" }));
    browser.done(json!({ "do": "button", "name": "Run" }));
    let told = "Clashes: 2, of them hard: 2. Ignored in the same part: 1.";
    say(&mut browser, STATUS, &[told]);
    say(&mut browser, ROWS, &["hard box1 · box2", "hard box2 · box3"]);
    browser.done(json!({ "do": "choose", "label": "Group by", "value": "system" }));
    say(&mut browser, ROWS, &["2 clashes S · S"]);
    browser.done(json!({ "do": "choose", "label": "Group by", "value": "equipment" }));
    say(&mut browser, ROWS, &["1 clash A · A", "1 clash A · B"]);
    // A click opens the second pair. The row of its clash is in that of the pair.
    browser.done(json!({ "do": "button", "name": "1 clash A · B" }));
    say(&mut browser, "[aria-label=Clashes] li li", &["hard box2 · box3"]);
    browser.done(json!({ "do": "button", "name": "hard box2 · box3" }));
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([0, 1]));
    // They touch at x = 3.
    let place = texts(&mut browser, "[aria-label=Clashes] .place");
    assert!(place.len() == 1 && place[0].starts_with("E 103.000 m, N "), "{place:?}");
    browser.done(json!({ "do": "choose", "label": "Ignore", "value": "in the same system" }));
    browser.done(json!({ "do": "button", "name": "Run" }));
    say(&mut browser, STATUS, &["No clashes. Ignored in the same system: 3."]);
}

#[test]
fn clashes_by_the_keyboard_alone() {
    let Some((_bench, _service, mut browser)) = before_it([1000, 700]) else { return };
    press(&mut browser, "o");
    browser.done(json!({ "do": "tab", "name": "Run" }));
    press(&mut browser, "Enter");
    say(&mut browser, STATUS, &["Clashes: 1, of them hard: 1."]);
    browser.done(json!({ "do": "tab", "name": "Next" }));
    press(&mut browser, " ");
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([0, 3]));
    press(&mut browser, "Escape");
    becomes(&mut browser, "the view before", |now| now["seeThrough"] == json!([]));
    press(&mut browser, "o");
    say(&mut browser, ROWS, &[]);
}

#[test]
fn clashes_with_a_finger_on_a_phone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&ROW));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    tap(&mut browser, "Clashes");
    tap(&mut browser, "Run");
    say(&mut browser, STATUS, &["Clashes: 1, of them hard: 1."]);
    tap(&mut browser, "Next");
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([0, 3]));
    tap(&mut browser, "Close Clashes");
    becomes(&mut browser, "the view before", |now| now["seeThrough"] == json!([]));
    let seen: Value = look(&mut browser)["selected"].take();
    assert_eq!(seen, json!([1, 2]));
}
