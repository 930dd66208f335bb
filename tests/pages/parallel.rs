//! Parallel views and elevations in a real browser.

use glam::DVec3;
use serde_json::{Value, json};
use trimaran_scene::Scene;

use super::controls::{becomes, boxes, goes, look, number, numbers, opened, press, state};
use crate::common::page::{Browser, Difference, Service, difference};
use crate::common::program::Bench;

/// A floor, and two boxes of a metre: box 1 is far from an eye at the front, and box 2 near.
const BOXES: [([f64; 3], [f64; 3]); 3] = [
    ([-10.0, -0.2, -10.0], [10.0, 0.0, 10.0]),
    ([-3.0, 0.0, -9.0], [-2.0, 1.0, -8.0]),
    ([2.0, 0.0, 5.0], [3.0, 1.0, 6.0]),
];
const FAR: usize = 1;
const NEAR: usize = 2;
/// The size of the picture, CSS pixels.
const SIZE: [u32; 2] = [900, 700];

/// The keys of the six sides, with their names and the directions in which they look.
const SIDES: [(&str, &str, [f64; 3]); 6] = [
    ("4", "Front", [0.0, 0.0, -1.0]),
    ("5", "Back", [0.0, 0.0, 1.0]),
    ("6", "Left", [1.0, 0.0, 0.0]),
    ("7", "Right", [-1.0, 0.0, 0.0]),
    ("8", "Top", [0.0, -1.0, 0.0]),
    ("9", "Bottom", [0.0, 1.0, 0.0]),
];

fn is_parallel(now: &Value) -> bool {
    number(&now["tanHalfFov"]) < 1e-3 && now["mode"] == "orbit"
}

fn place(browser: &mut Browser, point: [f64; 3]) -> DVec3 {
    let place = numbers(&browser.done(json!({ "do": "point", "point": point })));
    DVec3::new(place[0], place[1], 0.0)
}

/// The pixels between the upper corners at the front of a box.
fn width_of(browser: &mut Browser, object: usize) -> f64 {
    let (min, max) = BOXES[object];
    place(browser, [min[0], max[1], max[2]]).distance(place(browser, max))
}

/// The same, counted in the picture of a box that is picked there. Then nothing is picked.
fn counted_width_of(browser: &mut Browser, object: usize) -> f64 {
    look(browser);
    let spot = browser.done(json!({ "do": "place", "object": object }));
    browser.done(json!({ "do": "click", "x": spot["x"], "y": spot["y"] }));
    becomes(browser, "a picked box", |now| now["selected"] == json!([object]));
    let extent = browser.done(json!({ "do": "extent" }));
    press(browser, "Escape");
    becomes(browser, "nothing picked", |now| now["selected"] == json!([]));
    number(&extent["across"]) * f64::from(SIZE[0])
}

fn looks_along(now: &Value, expected: [f64; 3]) -> bool {
    DVec3::from_slice(&numbers(&now["forward"])).distance(DVec3::from_array(expected)) < 1e-5
}

/// Checks that the picture shows just what the whole scene shows from there.
fn audit(browser: &mut Browser, scene: &Scene, what: &str) {
    look(browser);
    let look = browser.done(json!({ "do": "look" }));
    let Difference { pixels, drawables, seen } = difference(&look, scene);
    assert!(seen > 0, "{what}");
    assert_eq!(drawables, [], "{what}");
    assert!(pixels < 0.01, "{what}: {pixels}");
}

#[test]
fn by_keyboard_alone_elevations_have_one_scale() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &BOXES, SIZE) else { return };
    let scene = Scene::open(&bench.path("boxes.scene")).unwrap();
    press(&mut browser, "2");
    goes(&mut browser, |browser| press(browser, "4"));
    let before = look(&mut browser);
    let ratio = width_of(&mut browser, NEAR) / width_of(&mut browser, FAR);
    assert!(ratio > 1.2, "in perspective the near box is larger: {ratio}");

    // There, back, and forward again.
    press(&mut browser, "r");
    let flat = becomes(&mut browser, "a parallel view", is_parallel);
    press(&mut browser, "Alt+ArrowLeft");
    let back = becomes(&mut browser, "the way back", |now| !is_parallel(now));
    for what in ["eye", "forward", "tanHalfFov", "mode"] {
        assert_eq!(back[what], before[what], "{what}");
    }
    press(&mut browser, "Alt+ArrowRight");
    let again = becomes(&mut browser, "the way forward", is_parallel);
    assert_eq!(again["eye"], flat["eye"]);

    for (key, name, forward) in SIDES {
        goes(&mut browser, |browser| press(browser, key));
        let now = look(&mut browser);
        assert!(is_parallel(&now) && looks_along(&now, forward), "{name}: {now}");
        audit(&mut browser, &scene, name);
    }
    goes(&mut browser, |browser| press(browser, "4"));
    let [near, far] = [NEAR, FAR].map(|object| width_of(&mut browser, object));
    assert!(near > 30.0 && (near - far).abs() < 0.1, "{near} {far}");
    let [near, far] = [NEAR, FAR].map(|object| counted_width_of(&mut browser, object));
    assert!(near > 30.0 && (near - far).abs() <= 1.0, "{near} {far}");

    // Keys move the picture and change its size. A point of the near box is still as far to the right of the
    // far one, by the scale.
    let before = state(&mut browser);
    press(&mut browser, "+");
    becomes(&mut browser, "a larger picture", |now| now["eye"] != before["eye"]);
    let larger = width_of(&mut browser, NEAR);
    assert!(larger > 1.1 * near && (larger - width_of(&mut browser, FAR)).abs() < 0.1, "{larger}");
    let corner = place(&mut browser, BOXES[NEAR].1);
    let before = state(&mut browser);
    browser.done(json!({ "do": "hold", "key": "KeyD", "milliseconds": 400 }));
    becomes(&mut browser, "a place to the right", |now| now["eye"] != before["eye"]);
    look(&mut browser);
    let moved = place(&mut browser, BOXES[NEAR].1);
    assert!(moved.x < corner.x - 10.0 && (moved.y - corner.y).abs() < 0.01, "{corner} {moved}");
    audit(&mut browser, &scene, "moved");

    // By the controls.
    assert_eq!(browser.done(json!({ "do": "text", "selector": ".navigation > span" })), json!(["parallel"]));
    for name in ["Standard views", "Left"] {
        browser.done(json!({ "do": "tab", "name": name }));
        press(&mut browser, "Enter");
    }
    becomes(&mut browser, "the left side", |now| looks_along(now, [1.0, 0.0, 0.0]));
    let pressed = json!({ "do": "text", "selector": ".standard [aria-pressed=true]" });
    assert_eq!(browser.done(pressed.clone()), json!(["Parallel"]));
    browser.done(json!({ "do": "tab", "name": "Parallel" }));
    press(&mut browser, "Enter");
    becomes(&mut browser, "perspective", |now| !is_parallel(now));
    assert_eq!(browser.done(pressed), json!([]));
}

#[test]
fn the_wheel_keeps_to_the_point_and_a_link_opens_the_same_view_elsewhere() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &BOXES, SIZE) else { return };
    press(&mut browser, "r");
    becomes(&mut browser, "a parallel view", is_parallel);
    goes(&mut browser, |browser| press(browser, "4"));
    // The upper left corner at the front of the near box.
    let corner = [2.0, 1.0, 6.0];
    let at = place(&mut browser, corner).round() + DVec3::new(2.0, 2.0, 0.0);
    let before = width_of(&mut browser, NEAR);
    for _ in 0..5 {
        goes(&mut browser, |browser| {
            browser.done(json!({ "do": "wheel", "x": at.x, "y": at.y, "down": -100 }));
        });
    }
    let [near, far] = [NEAR, FAR].map(|object| width_of(&mut browser, object));
    assert!((near / before - 0.85_f64.powi(-5)).abs() < 0.02, "{near} after {before}");
    assert!((near - far).abs() < 0.01 * near, "{near} {far}");
    let away = place(&mut browser, corner).distance(at);
    assert!(away < 12.0, "the corner is as far from the pointer as the size makes it: {away}");

    let here = look(&mut browser);
    press(&mut browser, "v");
    browser.done(json!({ "do": "button", "name": "Copy link" }));
    let link = browser.done(json!({ "do": "clipboard" }));
    let Some(mut other) = Browser::start(SIZE[0], SIZE[1]) else { return };
    assert_eq!(other.done(json!({ "do": "open", "url": link })), 200);
    let there = look(&mut other);
    assert!(is_parallel(&there), "{there}");
    for what in ["eye", "forward", "tanHalfFov"] {
        assert_eq!(there[what], here[what], "{what}");
    }
    // A person who walks there sees perspective.
    press(&mut other, "2");
    let flown = becomes(&mut other, "perspective", |now| !is_parallel(now));
    assert_eq!(flown["mode"], "fly");
    let way = DVec3::from_slice(&numbers(&flown["eye"])).distance(DVec3::from_array(corner));
    assert!(way < 30.0, "the eye is near the model again: {way}");
}

#[test]
fn by_touch_one_sees_elevations_on_a_phone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&BOXES));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    look(&mut browser);
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    tap(&mut browser, "Standard views");
    tap(&mut browser, "Parallel");
    becomes(&mut browser, "a parallel view", is_parallel);
    for target in browser.done(json!({ "do": "targets" })).as_array().unwrap() {
        assert!(number(&target["width"]) >= 43.9 && number(&target["height"]) >= 43.9, "{target}");
    }
    for (_, name, forward) in SIDES {
        tap(&mut browser, name);
        becomes(&mut browser, name, |now| is_parallel(now) && looks_along(now, forward));
    }
    tap(&mut browser, "Front");
    becomes(&mut browser, "the front", |now| looks_along(now, [0.0, 0.0, -1.0]));
    look(&mut browser);
    let [near, far] = [NEAR, FAR].map(|object| width_of(&mut browser, object));
    assert!(near > 10.0 && (near - far).abs() < 0.1, "{near} {far}");
    // Two fingers take what is between them along, and make it larger as they part.
    let (min, max) = BOXES[NEAR];
    let corners = [[min[0], max[1], max[2]], max];
    let before = corners.map(|corner| place(&mut browser, corner));
    let middle = (before[0] + before[1]) / 2.0 + DVec3::new(0.0, near / 4.0, 0.0);
    let fingers = json!({ "do": "pinch", "x": middle.x, "y": middle.y, "from": 40, "to": 80, "right": -30 });
    tap(&mut browser, "Standard views");
    browser.done(fingers);
    look(&mut browser);
    for (corner, before) in corners.into_iter().zip(before) {
        let expected = middle + DVec3::new(-30.0, 0.0, 0.0) + 2.0 * (before - middle);
        let now = place(&mut browser, corner);
        assert!(now.distance(expected) < 2.0, "{now} and not {expected}: between the fingers");
    }
    browser.done(json!({ "do": "pinch", "x": middle.x, "y": middle.y, "from": 80, "to": 40, "right": 0 }));
    tap(&mut browser, "Standard views");
    tap(&mut browser, "Parallel");
    becomes(&mut browser, "perspective", |now| !is_parallel(now));
    let [near, far] = [NEAR, FAR].map(|object| width_of(&mut browser, object));
    assert!(near > 1.1 * far, "{near} {far}");
}
