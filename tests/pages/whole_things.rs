//! Whole things in a real browser: the level of clicks, the row in the tree, and the rest as ghosts.

use serde_json::{Value, json};

use super::controls::{becomes, boxes, look, press, said, state};
use crate::common::cubes::cubes;
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// The objects of the model, in their order: the place of each, and its sides.
const OBJECTS: [(&str, [f64; 3], [f64; 3]); 6] = [
    ("flange", [-5.5, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("pipe", [-4.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("body", [-0.5, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("motor", [2.5, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("tank", [5.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    // From the front it hides the body.
    ("wall", [-1.2, -1.0, 3.0], [2.4, 3.0, 0.1]),
];

/// Two zones as glTF: `ZONE-1 / PUMP-1 / NOZZLE-1 / flange, pipe`, `PUMP-1 / body`, `PUMP-2 / motor`, and
/// `ZONE-2 / tank, wall`.
fn plant() -> String {
    let group = |name: &str, children: &[usize]| json!({ "name": name, "children": children });
    let mut nodes: Vec<Value> = OBJECTS
        .iter()
        .map(|(name, at, sides)| json!({ "name": name, "mesh": 0, "translation": at, "scale": sides }))
        .collect();
    nodes.extend([
        group("NOZZLE-1", &[0, 1]),
        group("PUMP-1", &[6, 2]),
        group("PUMP-2", &[3]),
        group("ZONE-1", &[7, 8]),
        group("ZONE-2", &[4, 5]),
    ]);
    cubes(&nodes, &[9, 10])
}

fn service(bench: &Bench) -> Option<Service> {
    bench.write("plant.gltf", plant());
    bench.done(&["import", "plant.gltf", "-o", "whole.scene"]);
    Service::of(bench, "whole.scene", "127.0.0.1:0")
}

/// A browser before the model. Everything but the body is in sight.
fn before_it(service: &Service, browser: &mut Browser) {
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(browser, "2");
    stand(browser);
}

fn stand(browser: &mut Browser) {
    browser.done(json!({ "do": "stand", "eye": [0.0, 2.5, 14.0], "forward": [0.0, 0.0, -1.0] }));
    look(browser);
}

/// Clicks at the middle of an object's front.
fn click(browser: &mut Browser, object: usize, keys: &[&str]) {
    let (_, [x, y, z], [width, height, depth]) = OBJECTS[object];
    let point = [x + width / 2.0, y + height / 2.0, z + depth];
    let place = browser.done(json!({ "do": "point", "point": point }));
    browser.done(json!({ "do": "click", "x": place[0], "y": place[1], "keys": keys }));
}

fn selects(browser: &mut Browser, what: &str, objects: &[u32]) {
    becomes(browser, what, |now| now["selected"] == json!(objects));
}

/// Waits until the panel has the details of `name`. They come from the service, and with them the path.
fn is_described(browser: &mut Browser, name: &str) {
    let is_it = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(json!({ "do": "text", "selector": ".details h2" })) == json!([name])
    });
    assert!(is_it, "{name}");
}

#[test]
fn a_click_picks_at_the_chosen_level() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    before_it(&service, &mut browser);
    let next_level = |browser: &mut Browser, level: &str| {
        press(browser, "k");
        said(browser, |text| text.contains(level));
    };
    click(&mut browser, 0, &[]);
    selects(&mut browser, "a primitive", &[0]);
    next_level(&mut browser, "Part");
    click(&mut browser, 0, &[]);
    selects(&mut browser, "a part", &[0, 1]);
    next_level(&mut browser, "Equipment");
    click(&mut browser, 0, &[]);
    selects(&mut browser, "equipment", &[0, 1, 2]);
    // Where there is no equipment, the largest group is picked.
    click(&mut browser, 3, &[]);
    selects(&mut browser, "a zone of one pump", &[0, 1, 2, 3]);
    click(&mut browser, 4, &["Control"]);
    selects(&mut browser, "one more", &[0, 1, 2, 3, 4, 5]);
    click(&mut browser, 4, &["Control"]);
    selects(&mut browser, "one less", &[0, 1, 2, 3]);
    // All of it is hidden, and not one cylinder.
    click(&mut browser, 1, &[]);
    selects(&mut browser, "equipment", &[0, 1, 2]);
    press(&mut browser, "h");
    becomes(&mut browser, "hiding", |now| now["hidden"] == json!([0, 1, 2]));
    press(&mut browser, "Control+z");
    next_level(&mut browser, "System");
    // The level is kept.
    browser.done(json!({ "do": "reload" }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "2");
    stand(&mut browser);
    click(&mut browser, 0, &[]);
    selects(&mut browser, "a system", &[0, 1, 2, 3]);
    next_level(&mut browser, "Primitive");
    click(&mut browser, 0, &[]);
    selects(&mut browser, "a primitive", &[0]);
    browser.done(json!({ "do": "choose", "label": "Picks", "value": "Part" }));
    click(&mut browser, 1, &[]);
    selects(&mut browser, "a part", &[0, 1]);
}

/// Alt+click, or the key, goes up one group after the other.
#[test]
fn the_parent_of_a_pick_is_one_click_away() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    before_it(&service, &mut browser);
    let ways: [&[u32]; 5] = [&[0], &[0, 1], &[0, 1, 2], &[0, 1, 2, 3], &[0, 1, 2, 3, 4, 5]];
    for objects in ways {
        click(&mut browser, 0, &["Alt"]);
        selects(&mut browser, "the next larger group", objects);
    }
    click(&mut browser, 0, &["Alt"]);
    said(&mut browser, |text| text.contains("no larger group"));
    // Elsewhere it picks as any click.
    click(&mut browser, 4, &[]);
    selects(&mut browser, "a primitive", &[4]);
    click(&mut browser, 3, &["Alt"]);
    selects(&mut browser, "another one", &[3]);
    press(&mut browser, "Escape");
    click(&mut browser, 0, &[]);
    for objects in ways {
        selects(&mut browser, "by the key", objects);
        press(&mut browser, "u");
    }
    // In a row, faster than the service answers.
    click(&mut browser, 4, &[]);
    click(&mut browser, 0, &[]);
    for _ in 0..3 {
        press(&mut browser, "u");
    }
    selects(&mut browser, "three steps", ways[3]);
}

#[test]
fn the_tree_shows_the_row_of_a_pick() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    before_it(&service, &mut browser);
    let is_on = |browser: &mut Browser, name: &str| {
        let found = (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            browser.done(json!({ "do": "focused" }))["name"] == name
        });
        assert!(found, "{} and not {name}", browser.done(json!({ "do": "focused" })));
        let row = json!({ "do": "visible", "selector": "li:focus > .row", "within": ".tree" });
        assert_eq!(browser.done(row), json!([true]), "{name}");
    };
    click(&mut browser, 0, &[]);
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([0]));
    said(&mut browser, str::is_empty);
    is_described(&mut browser, "flange");
    press(&mut browser, "l");
    is_on(&mut browser, "flange");
    // The tree goes on from there.
    press(&mut browser, "ArrowDown");
    is_on(&mut browser, "pipe");
    press(&mut browser, "Escape");
    press(&mut browser, "u");
    is_described(&mut browser, "NOZZLE-1");
    browser.done(json!({ "do": "tab", "name": "In the tree" }));
    press(&mut browser, "Enter");
    is_on(&mut browser, "NOZZLE-1");
}

/// Rows come by the hundred: the one that is sought may be far down.
#[test]
fn a_row_far_down_in_the_tree_is_found() {
    let bench = Bench::empty();
    let at = |place: u32| [f64::from(place % 40) * 2.0, 0.0, f64::from(place / 40) * 2.0];
    let all: Vec<_> = (0..1200).map(|place| (at(place), at(place).map(|side| side + 1.0))).collect();
    bench.write("boxes.obj", boxes(&all));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "/");
    browser.done(json!({ "do": "type", "text": "box1111" }));
    browser.done(json!({ "do": "button", "name": "box1111$" }));
    selects(&mut browser, "a pick", &[1111]);
    look(&mut browser);
    browser.done(json!({ "do": "button", "name": "In the tree" }));
    let found = (0..600).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
        browser.done(json!({ "do": "focused" }))["name"] == "box1111"
    });
    assert!(found, "{}", browser.done(json!({ "do": "focused" })));
    let row = json!({ "do": "visible", "selector": "li:focus > .row", "within": ".tree" });
    assert_eq!(browser.done(row), json!([true]));
}

#[test]
fn the_rest_are_ghosts_and_clicks_pass_through_them() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    before_it(&service, &mut browser);
    let sign = |browser: &mut Browser, expected: Value| {
        let told = json!({ "do": "text", "selector": ".objects span" });
        assert!((0..200).any(|_| browser.done(told.clone()) == expected), "{}", browser.done(told));
    };
    // The wall is before the body.
    click(&mut browser, 2, &[]);
    selects(&mut browser, "the wall", &[5]);
    click(&mut browser, 0, &[]);
    for objects in [&[0][..], &[0, 1], &[0, 1, 2]] {
        selects(&mut browser, "a step to the pump", objects);
        if objects.len() < 3 {
            press(&mut browser, "u");
        }
    }
    press(&mut browser, "g");
    let ghosts = look(&mut browser);
    assert_eq!(ghosts["seeThrough"], json!([3, 4, 5]));
    sign(&mut browser, json!(["ghosts: all but 3"]));
    let shown = browser.done(json!({ "do": "look" }))["objects"].take();
    assert!(shown.as_array().unwrap().contains(&json!(2)), "a ghost hides nothing: {shown}");
    // Through the wall, to the body behind it; a ghost is picked where nothing solid is behind.
    click(&mut browser, 2, &[]);
    selects(&mut browser, "the body", &[2]);
    click(&mut browser, 4, &[]);
    selects(&mut browser, "the tank, a ghost", &[4]);
    // Another choice takes the place of the one before.
    click(&mut browser, 2, &[]);
    selects(&mut browser, "the body", &[2]);
    press(&mut browser, "g");
    becomes(&mut browser, "one solid object", |now| now["seeThrough"] == json!([0, 1, 3, 4, 5]));
    sign(&mut browser, json!(["ghosts: all but 1"]));
    // A link and a saved view have them.
    press(&mut browser, "v");
    browser.done(json!({ "do": "button", "name": "Keep this view" }));
    browser.done(json!({ "do": "button", "name": "Copy link" }));
    let link = browser.done(json!({ "do": "clipboard" }));
    let mut other = Browser::start(900, 700).unwrap();
    other.done(json!({ "do": "open", "url": link }));
    assert_eq!(look(&mut other)["seeThrough"], json!([0, 1, 3, 4, 5]));
    // Again, and all is solid; undo and redo work.
    press(&mut browser, "v");
    press(&mut browser, "g");
    becomes(&mut browser, "all solid", |now| now["seeThrough"] == json!([]));
    sign(&mut browser, json!([]));
    look(&mut browser);
    click(&mut browser, 2, &[]);
    selects(&mut browser, "the wall again", &[5]);
    press(&mut browser, "Control+z");
    becomes(&mut browser, "ghosts again", |now| now["seeThrough"] == json!([0, 1, 3, 4, 5]));
    press(&mut browser, "Control+z");
    becomes(&mut browser, "those before", |now| now["seeThrough"] == json!([3, 4, 5]));
    press(&mut browser, "Control+y");
    press(&mut browser, "Escape");
    browser.done(json!({ "do": "button", "name": "Ghosts" }));
    becomes(&mut browser, "all solid without a pick", |now| now["seeThrough"] == json!([]));
    press(&mut browser, "v");
    browser.done(json!({ "do": "button", "name": "View 1" }));
    becomes(&mut browser, "a view with ghosts", |now| now["seeThrough"] == json!([0, 1, 3, 4, 5]));
}

#[test]
fn a_finger_picks_whole_things_on_a_phone() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    before_it(&service, &mut browser);
    browser.done(json!({ "do": "stand", "eye": [0.0, 0.5, 26.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    let touch = |browser: &mut Browser, object: u32| {
        let place = browser.done(json!({ "do": "place", "object": object }));
        browser.done(json!({ "do": "touch", "x": place["x"], "y": place["y"], "milliseconds": 60 }));
    };
    browser.done(json!({ "do": "choose", "label": "Picks", "value": "Part" }));
    touch(&mut browser, 0);
    selects(&mut browser, "a part", &[0, 1]);
    tap(&mut browser, "Parent");
    selects(&mut browser, "the pump", &[0, 1, 2]);
    // The panel may move the buttons.
    is_described(&mut browser, "PUMP-1");
    tap(&mut browser, "Ghosts");
    becomes(&mut browser, "ghosts", |now| now["seeThrough"] == json!([3, 4, 5]));
    tap(&mut browser, "In the tree");
    let found = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(json!({ "do": "focused" }))["name"] == "PUMP-1"
    });
    assert!(found, "{}", browser.done(json!({ "do": "focused" })));
    tap(&mut browser, "Close Model");
    tap(&mut browser, "Ghosts");
    becomes(&mut browser, "all solid", |now| now["seeThrough"] == json!([]));
    assert_eq!(state(&mut browser)["selected"], json!([0, 1, 2]));
}
