//! The controls of the page in a real browser: the keyboard, the mouse, a finger, and the page's messages.

use serde_json::{Value, json};

use crate::common::page::{Browser, Service, TOKEN};
use crate::common::program::Bench;

/// Boxes as a model: the corners of each.
pub(super) fn boxes(all: &[([f64; 3], [f64; 3])]) -> String {
    use std::fmt::Write as _;
    let mut obj = String::new();
    for (number, (min, max)) in all.iter().enumerate() {
        let _infallible = writeln!(obj, "o box{number}");
        for corner in 0..8 {
            let side = |axis: usize| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] };
            let _infallible = writeln!(obj, "v {} {} {}", side(0), side(1), side(2));
        }
        for [a, b, c, d] in
            [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]]
        {
            let at = |corner: usize| 8 * number + corner;
            let _infallible = writeln!(obj, "f {} {} {} {}", at(a), at(b), at(c), at(d));
        }
    }
    obj
}

/// A service of some boxes, and a browser that shows them.
pub(super) fn opened(
    bench: &Bench,
    all: &[([f64; 3], [f64; 3])],
    size: [u32; 2],
) -> Option<(Service, Browser)> {
    bench.write("boxes.obj", boxes(all));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let service = Service::of(bench, "boxes.scene", "127.0.0.1:0")?;
    let mut browser = Browser::start(size[0], size[1])?;
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    Some((service, browser))
}

/// The page's state, once its picture is exact.
pub(super) fn look(browser: &mut Browser) -> Value {
    browser.done(json!({ "do": "settle" }));
    state(browser)
}

pub(super) fn state(browser: &mut Browser) -> Value {
    browser.done(json!({ "do": "state" }))
}

/// Waits until the page's state satisfies `is_it`.
pub(super) fn becomes(browser: &mut Browser, what: &str, is_it: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..600 {
        let now = state(browser);
        if is_it(&now) {
            return now;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("{what} does not come about: {}", state(browser))
}

/// Does something that moves the eye once the service has said which sides are open, and looks from there.
pub(super) fn goes(browser: &mut Browser, act: impl FnOnce(&mut Browser)) -> Value {
    let before = state(browser);
    act(browser);
    becomes(browser, "going there", |now| now["eye"] != before["eye"]);
    look(browser)
}

pub(super) fn press(browser: &mut Browser, key: &str) {
    browser.done(json!({ "do": "press", "key": key }));
}

/// The page's message, once it satisfies `is_it`.
pub(super) fn said(browser: &mut Browser, is_it: impl Fn(&str) -> bool) -> String {
    for _ in 0..1200 {
        let status = browser.tell(json!({ "do": "status" }))["answer"].take();
        let status = status.as_str().unwrap_or_default();
        if is_it(status) {
            return status.to_owned();
        }
        browser.tell(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("the page never says it: {}", browser.tell(json!({ "do": "status" })))
}

pub(super) fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

pub(super) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

pub(super) const ROOM: [([f64; 3], [f64; 3]); 3] = [
    ([-10.0, -0.2, -10.0], [10.0, 0.0, 10.0]),
    ([-3.0, 0.0, -4.0], [-2.0, 1.0, -3.0]),
    ([2.0, 0.0, -4.0], [3.0, 1.0, -3.0]),
];

/// Only with the keyboard: keys that a control uses are its own, all others walk on, and the focus is never
/// lost.
#[test]
fn keys_go_to_the_control_that_uses_them_and_walk_otherwise() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [500, 400]) else { return };
    let focused = |browser: &mut Browser| browser.done(json!({ "do": "focused" }));
    // Space and Enter press a button that Tab leads to.
    for key in [" ", "Enter"] {
        press(&mut browser, "2");
        assert_eq!(state(&mut browser)["mode"], "fly");
        browser.done(json!({ "do": "tab", "name": "Walk" }));
        assert_eq!(focused(&mut browser)["shows"], true, "what has the keyboard can be seen");
        press(&mut browser, key);
        assert_eq!(state(&mut browser)["mode"], "walk", "{key:?}");
    }
    press(&mut browser, "2");
    // A key of walking walks on from a button, a slider and a list.
    let walks = |browser: &mut Browser, from: &str| {
        let before = state(browser);
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 200 }));
        becomes(browser, from, |now| now["eye"] != before["eye"]);
    };
    walks(&mut browser, "a way from a button");
    let slider = "Vertical field of view in degrees";
    browser.done(json!({ "do": "tab", "name": slider }));
    let before = state(&mut browser);
    press(&mut browser, "ArrowRight");
    let after = becomes(&mut browser, "a wider view", |now| now["tanHalfFov"] != before["tanHalfFov"]);
    assert!(number(&after["tanHalfFov"]) > number(&before["tanHalfFov"]), "an arrow moves the slider");
    assert_eq!((&after["eye"], &after["orientation"]), (&before["eye"], &before["orientation"]));
    walks(&mut browser, "a way from a slider");
    assert_eq!(focused(&mut browser)["name"], slider, "it keeps the keyboard");
    press(&mut browser, "p");
    browser.done(json!({ "do": "tab", "name": "Details for support" }));
    press(&mut browser, "Enter");
    let list = "the device's queriesa count of pixelsa hierarchical Z-buffer";
    browser.done(json!({ "do": "tab", "name": list }));
    let before = state(&mut browser);
    press(&mut browser, "ArrowUp");
    let after = state(&mut browser);
    assert_eq!((&after["eye"], &after["orientation"]), (&before["eye"], &before["orientation"]));
    walks(&mut browser, "a way from a list");
    // Nothing happens behind a dialog, and the focus returns afterwards.
    browser.done(json!({ "do": "tab", "name": "Keys" }));
    press(&mut browser, "Enter");
    let before = state(&mut browser);
    for key in ["3", "h", "t"] {
        press(&mut browser, key);
    }
    browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 300 }));
    let behind = state(&mut browser);
    assert_eq!((&behind["eye"], &behind["mode"]), (&before["eye"], &before["mode"]));
    press(&mut browser, "Escape");
    assert_eq!(focused(&mut browser)["name"], "Keys");
    walks(&mut browser, "a way behind the dialog");
    // A panel that closes returns the focus, and Escape leads to the picture.
    browser.done(json!({ "do": "tab", "name": "Close Status" }));
    press(&mut browser, " ");
    assert_eq!(focused(&mut browser)["name"], "Status");
    press(&mut browser, "Escape");
    assert_eq!(focused(&mut browser)["tag"], "canvas");
    // A key opens the list of keys and closes it. It scrolls, and its button stays in sight.
    let is_open = |browser: &mut Browser| {
        let shown = browser.done(json!({ "do": "rects", "selector": ".keys[open]" }));
        !shown.as_array().unwrap().is_empty()
    };
    press(&mut browser, "?");
    assert!(is_open(&mut browser));
    // The list is loaded when it is first shown, and has its groups.
    let groups = json!({ "do": "text", "selector": ".keys h2" });
    let expected = json!(["Move", "Look", "Pick and hide", "Measure and cut", "Panels"]);
    let is_listed = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(groups.clone()) == expected
    });
    assert!(is_listed, "{}", browser.done(groups));
    let close = json!({ "do": "visible", "selector": ".keys form button", "within": ".keys" });
    assert_eq!(browser.done(close), json!([true]));
    press(&mut browser, "?");
    assert!(!is_open(&mut browser));
    assert_eq!(focused(&mut browser)["tag"], "canvas");
}

/// Waits until the focused element has this name, or is of this kind.
fn focus_is_on(browser: &mut Browser, wanted: &str) {
    let is_there = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        let now = browser.done(json!({ "do": "focused" }));
        now["name"] == wanted || now["tag"] == wanted
    });
    assert!(is_there, "{} and not {wanted}", browser.done(json!({ "do": "focused" })));
}

/// The focus goes to the first control of a panel that a key opens, and to the picture when it closes.
#[test]
fn a_key_leads_into_the_panel_that_it_opens_and_a_click_does_not() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    press(&mut browser, "2");
    let kinds = "Two pointsTwo partsPoint to faceAngleArea or diameterPolygon";
    for (key, first) in [("m", kinds), ("b", "Plane ahead"), ("v", "Keep this view"), ("t", "boxes.obj")] {
        press(&mut browser, key);
        focus_is_on(&mut browser, first);
        press(&mut browser, key);
        focus_is_on(&mut browser, "canvas");
    }
    // From one panel to another.
    press(&mut browser, "b");
    focus_is_on(&mut browser, "Plane ahead");
    press(&mut browser, "m");
    focus_is_on(&mut browser, kinds);
    // Escape leads to the picture, and the next one closes what is measured.
    let panels = json!({ "do": "text", "selector": ".frame h2" });
    press(&mut browser, "Escape");
    focus_is_on(&mut browser, "canvas");
    assert_eq!(browser.done(panels.clone()), json!(["Measure"]));
    press(&mut browser, "Escape");
    assert!((0..400).any(|_| browser.done(panels.clone()) == json!([])));
    focus_is_on(&mut browser, "canvas");
    // A field for text would take the key: it is passed over, and the key closes the panel.
    press(&mut browser, "o");
    browser.done(json!({ "do": "wait", "milliseconds": 500 }));
    assert_ne!(browser.done(json!({ "do": "focused" }))["tag"], "input");
    press(&mut browser, "o");
    assert!((0..400).any(|_| browser.done(panels.clone()) == json!([])));
    // A click keeps the focus on its button.
    browser.done(json!({ "do": "button", "name": "Cut" }));
    browser.done(json!({ "do": "tab", "name": "Cut" }));
    let plane = json!({ "do": "text", "selector": ".sections button" });
    let is_there = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(plane.clone()) == json!(["Plane ahead", "Box around"])
    });
    assert!(is_there, "{}", browser.done(plane));
    assert_eq!(browser.done(json!({ "do": "focused" }))["name"], "Cut");
}

/// Picks the right box of the room.
fn pick_box(browser: &mut Browser) {
    press(browser, "2");
    browser.done(json!({ "do": "stand", "eye": [2.5, 1.5, 2.0], "forward": [0.0, -0.2, -1.0] }));
    look(browser);
    let middle = browser.done(json!({ "do": "point", "point": [2.5, 0.5, -3.0] }));
    browser.done(json!({ "do": "click", "x": middle[0], "y": middle[1] }));
    becomes(browser, "a pick", |now| now["selected"] == json!([2]));
}

/// A thin pipe before the background, and a wall behind one half of it.
const PIPE: [([f64; 3], [f64; 3]); 2] =
    [([-1.0, 0.98, 0.0], [1.0, 1.02, 0.04]), ([0.05, 0.0, -1.0], [1.0, 2.0, -0.9])];

/// The place so many pixels above the pipe's upper edge at `x`.
fn above_the_pipe(browser: &mut Browser, x: f64, pixels: f64) -> [f64; 2] {
    let place = browser.done(json!({ "do": "point", "point": [x, 1.02, 0.04] }));
    [number(&place[0]), number(&place[1]) - pixels]
}

#[test]
fn a_click_just_beside_an_object_picks_it_where_nothing_is_behind() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &PIPE, [1000, 600]) else { return };
    press(&mut browser, "2");
    browser.done(json!({ "do": "stand", "eye": [0.0, 1.0, 2.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    for (x, pixels, picked) in [(-0.2, 3.0, json!([0])), (0.15, 3.0, json!([1])), (-0.2, 14.0, json!([]))] {
        let [x, y] = above_the_pipe(&mut browser, x, pixels);
        browser.done(json!({ "do": "click", "x": x, "y": y }));
        becomes(&mut browser, "a pick beside the pipe", |now| now["selected"] == picked);
    }
}

#[test]
fn a_finger_need_not_meet_a_thin_pipe() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&PIPE));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "2");
    browser.done(json!({ "do": "stand", "eye": [0.0, 1.0, 2.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    for (pixels, picked) in [(6.0, json!([0])), (14.0, json!([]))] {
        let [x, y] = above_the_pipe(&mut browser, -0.2, pixels);
        browser.done(json!({ "do": "touch", "x": x, "y": y, "milliseconds": 60 }));
        becomes(&mut browser, "a pick beside the pipe", |now| now["selected"] == picked);
    }
}

#[test]
fn escape_and_a_click_elsewhere_close_the_standard_views() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [1000, 600]) else { return };
    pick_box(&mut browser);
    let is_open = |browser: &mut Browser| {
        let shown = browser.done(json!({ "do": "rects", "selector": ".standard" }));
        !shown.as_array().unwrap().is_empty()
    };
    browser.done(json!({ "do": "label", "name": "Standard views" }));
    assert!(is_open(&mut browser));
    press(&mut browser, "Escape");
    assert!(!is_open(&mut browser));
    assert_eq!(state(&mut browser)["selected"], json!([2]), "the next Escape is for the pick");
    press(&mut browser, "Escape");
    becomes(&mut browser, "no pick", |now| now["selected"] == json!([]));
    browser.done(json!({ "do": "label", "name": "Standard views" }));
    assert!(is_open(&mut browser));
    browser.done(json!({ "do": "click", "x": 500, "y": 200 }));
    assert!(!is_open(&mut browser));
}

/// The next click is to meet the same button, whatever the status says.
#[test]
fn commands_for_objects_keep_their_places() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [1000, 600]) else { return };
    pick_box(&mut browser);
    let places =
        |browser: &mut Browser| browser.done(json!({ "do": "rects", "selector": ".objects button" }));
    let before = places(&mut browser);
    assert_eq!(before.as_array().unwrap().len(), 11);
    for (key, told) in [("x", "1 see-through"), ("i", "only 1 shown, 1 see-through")] {
        press(&mut browser, key);
        becomes(&mut browser, told, |now| now["seeThrough"] == json!([2]));
        assert_eq!(browser.done(json!({ "do": "text", "selector": ".objects span" })), json!([told]));
        assert_eq!(places(&mut browser), before, "{told}");
    }
    // With nothing picked, they are still there.
    press(&mut browser, "h");
    becomes(&mut browser, "no pick", |now| now["selected"] == json!([]));
    assert_eq!(places(&mut browser), before);
}

/// The tree has one stop of Tab; arrows go through it, and open and close.
#[test]
fn arrows_go_through_the_tree_and_not_through_the_model() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [500, 400]) else { return };
    let focused = |browser: &mut Browser| browser.done(json!({ "do": "focused" }))["name"].take();
    let is_on = |browser: &mut Browser, name: &str| {
        let found = (0..200).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 50 }));
            focused(browser) == name
        });
        assert!(found, "{} and not {name} has the keyboard", focused(browser));
    };
    press(&mut browser, "2");
    press(&mut browser, "t");
    // Rows come from the service. A click waits for the first one.
    browser.done(json!({ "do": "button", "name": "boxes|box0" }));
    let before = state(&mut browser);
    let first = focused(&mut browser);
    for _ in 0..2 {
        press(&mut browser, "ArrowRight");
        browser.done(json!({ "do": "wait", "milliseconds": 500 }));
    }
    press(&mut browser, "End");
    is_on(&mut browser, "box2");
    press(&mut browser, "ArrowUp");
    is_on(&mut browser, "box1");
    press(&mut browser, "ArrowDown");
    is_on(&mut browser, "box2");
    press(&mut browser, "Home");
    is_on(&mut browser, first.as_str().unwrap());
    let after = state(&mut browser);
    assert_eq!((&after["eye"], &after["orientation"]), (&before["eye"], &before["orientation"]));
    // Enter picks a row, Space hides its objects.
    press(&mut browser, "End");
    press(&mut browser, "Enter");
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([2]));
    press(&mut browser, " ");
    becomes(&mut browser, "hiding", |now| now["hidden"] == json!([2]));
    press(&mut browser, " ");
    becomes(&mut browser, "showing", |now| now["hidden"] == json!([]));
    // Tab leads out of it, and to the same row again.
    press(&mut browser, "Tab");
    assert_ne!(focused(&mut browser), "box2");
    press(&mut browser, "Shift+Tab");
    is_on(&mut browser, "box2");
    press(&mut browser, "Escape");
    assert_eq!(browser.done(json!({ "do": "focused" }))["tag"], "canvas");
    assert_eq!(state(&mut browser)["selected"], json!([2]), "what is picked stays");
}

/// A message goes by itself, or when it is closed; and none contains the token.
#[test]
fn messages_go_away_and_show_no_secret() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(600, 400) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    browser.done(json!({ "do": "say", "text": format!("http://x/link?token={TOKEN}&a and token={TOKEN}") }));
    let text = said(&mut browser, |text| !text.is_empty());
    assert_eq!(text, "http://x/link and token=…");
    browser.done(json!({ "do": "pass" }));
    said(&mut browser, str::is_empty);
    browser.done(json!({ "do": "say", "text": "What is closed is gone." }));
    said(&mut browser, |text| text.contains("closed"));
    browser.done(json!({ "do": "tab", "name": "Close message" }));
    press(&mut browser, " ");
    assert_eq!(browser.done(json!({ "do": "status" })), "");
    assert_eq!(browser.done(json!({ "do": "focused" }))["tag"], "canvas");

    // The service is away: the message has no query of its address, and can be closed.
    let at = service.at.clone();
    drop(service);
    let text = said(&mut browser, |text| text.contains("does not answer"));
    assert!(!text.contains(TOKEN), "{text}");
    browser.tell(json!({ "do": "tab", "name": "Close message" }));
    browser.tell(json!({ "do": "press", "key": "Enter" }));
    browser.tell(json!({ "do": "wait", "milliseconds": 1500 }));
    assert_eq!(browser.tell(json!({ "do": "status" }))["answer"], "");

    // It comes again, and no longer accepts the token.
    let _other = Service::with_token(&bench, "plant.scene", &at, "0123456789abcdefOTHER").unwrap();
    let text = said(&mut browser, |text| text.contains("not valid any more"));
    assert!(text.contains("open the address that was printed") && !text.contains(TOKEN), "{text}");
}

/// The service comes again with another scene: the page shows that one, with a message.
#[test]
fn a_page_goes_over_to_the_scene_that_the_service_has() {
    let bench = Bench::with_plant(100);
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(400, 300) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    assert_eq!(browser.done(json!({ "do": "title" })), "plant - Trimaran");
    let at = service.at.clone();
    drop(service);
    said(&mut browser, |text| text.contains("does not answer"));
    let _other = Service::of(&bench, "boxes.scene", &at).unwrap();
    said(&mut browser, |text| text.contains("another model") && text.contains("boxes"));
    browser.tell(json!({ "do": "settle" }));
    assert_eq!(browser.tell(json!({ "do": "title" }))["answer"], "boxes - Trimaran");
    let state = browser.tell(json!({ "do": "state" }))["answer"].take();
    assert!(state["drawn"]["drawables"].as_u64().unwrap() > 0, "{}", state["drawn"]);
}

/// Dragged beside everything in Orbit, the model turns and stays in the picture. The wheel approaches the
/// point under the pointer and not past it, also beside a gap.
#[test]
fn orbit_never_loses_the_object_and_the_wheel_keeps_to_the_point() {
    let bench = Bench::empty();
    // A bolt before a far wall. No panel is over the middle of the picture.
    let all = [([-0.02, 1.0, -0.02], [0.02, 1.04, 0.02]), ([-40.0, -2.0, -60.0], [40.0, 4.0, -59.0])];
    let Some((_service, mut browser)) = opened(&bench, &all, [1000, 600]) else { return };
    press(&mut browser, "3");
    browser.done(json!({ "do": "stand", "eye": [0.0, 1.02, 1.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    browser.done(json!({ "do": "click", "x": 500, "y": 300 }));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([0]));
    for (right, down) in [(150, 0), (-200, 60), (250, -90)] {
        let before = look(&mut browser);
        browser.done(json!({ "do": "pull", "x": 320, "y": 450, "right": right, "down": down }));
        let after = look(&mut browser);
        assert_ne!(after["eye"], before["eye"], "the eye goes round");
        let extent = browser.done(json!({ "do": "extent" }));
        let [x, y] = ["x", "y"].map(|side| number(&extent[side]));
        let is_middle = (0.4..0.6).contains(&x) && (0.4..0.6).contains(&y);
        assert!(number(&extent["pixels"]) > 20.0 && is_middle, "{extent}");
    }
    // To the bolt, with the pointer a little beside it, where the wall is 60 m behind.
    browser.done(json!({ "do": "stand", "eye": [0.0, 1.02, 8.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    let way = |browser: &mut Browser| {
        let eye = numbers(&state(browser)["eye"]);
        (eye[0].powi(2) + (eye[1] - 1.02).powi(2) + eye[2].powi(2)).sqrt()
    };
    let mut before = 8.0;
    for turn in 0..30 {
        browser.done(json!({ "do": "wheel", "x": 503, "y": 302, "down": -100 }));
        let now = way(&mut browser);
        assert!(now <= before + 1e-9, "{turn}: {now} m from the bolt, before {before}");
        before = now;
    }
    look(&mut browser);
    assert!(before < 0.2, "the eye is {before} m from the bolt");
    let extent = browser.done(json!({ "do": "extent" }));
    assert!(number(&extent["pixels"]) > 1000.0, "the bolt is seen: {extent}");
    // And away again, without a jump.
    for _ in 0..30 {
        browser.done(json!({ "do": "wheel", "x": 503, "y": 302, "down": 100 }));
        let now = way(&mut browser);
        assert!(now < 1.3 * before + 1.0, "{now} m from the bolt, before {before}");
        before = now;
    }
    assert!((3.0..20.0).contains(&before), "{before}");
}

/// A framed part fills the picture, also with distant outliers, and is not hidden if a side is open.
#[test]
fn f_fills_the_picture_and_shows_what_it_goes_to() {
    let bench = Bench::empty();
    // A crowd of a hundred boxes, one five kilometres away, and one in a shed so close around it that
    // an eye has no room there. It is open to the east.
    let mut all: Vec<_> = (0..100)
        .map(|place| {
            let (x, z) = (f64::from(place % 10) * 3.0, f64::from(place / 10) * 3.0);
            ([x, 0.0, z], [x + 1.0, 1.0 + f64::from(place % 3), z + 1.0])
        })
        .collect();
    all.push(([5000.0, 0.0, 0.0], [5001.0, 1.0, 1.0]));
    all.push(([13.0, 0.2, -20.0], [15.0, 2.2, -18.0]));
    for wall in [
        ([12.6, 0.0, -20.4], [12.8, 2.6, -17.6]),
        ([12.6, 0.0, -20.4], [15.2, 2.6, -20.2]),
        ([12.6, 0.0, -17.8], [15.2, 2.6, -17.6]),
        ([12.6, 2.6, -20.4], [15.2, 2.8, -17.6]),
    ] {
        all.push(wall);
    }
    let Some((_service, mut browser)) = opened(&bench, &all, [640, 400]) else { return };
    let go_to = |browser: &mut Browser, name: &str| {
        goes(browser, |browser| {
            press(browser, "/");
            browser.done(json!({ "do": "type", "text": name }));
            browser.done(json!({ "do": "button", "name": format!("{name}$") }));
        })
    };
    for name in ["box7", "box100", "box101"] {
        go_to(&mut browser, name);
        let extent = browser.done(json!({ "do": "extent" }));
        let [across, down] = ["across", "down"].map(|side| number(&extent[side]));
        assert!(across.max(down) > 0.7, "{name} fills the picture: {extent}");
        assert!(
            (number(&extent["x"]) - 0.5).abs() < 0.1 && (number(&extent["y"]) - 0.5).abs() < 0.1,
            "{extent}"
        );
    }
    // From behind a wall that hides it, too.
    browser.done(json!({ "do": "stand", "eye": [-20.0, 2.0, -19.0], "forward": [1.0, 0.0, 0.0] }));
    let gone = goes(&mut browser, |browser| press(browser, "f"));
    let extent = browser.done(json!({ "do": "extent" }));
    assert!(number(&extent["across"]).max(number(&extent["down"])) > 0.7, "from the open side: {extent}");
    assert!(number(&gone["eye"][0]) > 15.0, "that is the east: {}", gone["eye"]);
    // The whole model, without the one that is far away.
    press(&mut browser, "Escape");
    press(&mut browser, "Home");
    look(&mut browser);
    let extent = browser.done(json!({ "do": "extent" }));
    assert!(number(&extent["across"]).max(number(&extent["down"])) > 0.7, "{extent}");
}

/// A part inside something else is reported as hidden, and can be made visible in one step with undo.
#[test]
fn what_hides_a_part_can_be_seen_through() {
    let bench = Bench::empty();
    // Close around it: an eye that frames it is outside.
    let wall = |axis: usize, at: f64| {
        let (mut min, mut max) = ([-0.8; 3], [0.8; 3]);
        [min[axis], max[axis]] = [at - 0.05, at + 0.05];
        (min, max)
    };
    let mut all = vec![([-0.5; 3], [0.5; 3])];
    all.extend(
        [(0, -0.8), (0, 0.8), (1, -0.8), (1, 0.8), (2, -0.8), (2, 0.8)].map(|(axis, at)| wall(axis, at)),
    );
    let Some((_service, mut browser)) = opened(&bench, &all, [400, 400]) else { return };
    press(&mut browser, "/");
    browser.done(json!({ "do": "type", "text": "box0" }));
    browser.done(json!({ "do": "button", "name": "box0$" }));
    said(&mut browser, |text| text.contains("in front of it"));
    browser.done(json!({ "do": "button", "name": "See through them" }));
    becomes(&mut browser, "seeing through", |now| now["seeThrough"] != json!([]));
    look(&mut browser);
    press(&mut browser, "Escape");
    becomes(&mut browser, "no pick", |now| now["selected"] == json!([]));
    browser.done(json!({ "do": "click", "x": 200, "y": 200 }));
    let now = becomes(&mut browser, "a pick", |now| now["selected"] != json!([]));
    assert_eq!(now["selected"], json!([0]));
    browser.done(json!({ "do": "wait", "milliseconds": 1000 }));
    press(&mut browser, "Control+z");
    becomes(&mut browser, "undoing", |now| now["seeThrough"] == json!([]));
    // A part hidden by a person is reported as such.
    press(&mut browser, "/");
    browser.done(json!({ "do": "type", "text": "box0" }));
    browser.done(json!({ "do": "button", "name": "box0$" }));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([0]));
    press(&mut browser, "h");
    becomes(&mut browser, "hiding", |now| now["hidden"] == json!([0]));
    press(&mut browser, "/");
    browser.done(json!({ "do": "type", "text": "box0" }));
    browser.done(json!({ "do": "button", "name": "box0$" }));
    said(&mut browser, |text| text.contains("It is hidden."));
    // An answer about the view before it was hidden does not replace this one.
    look(&mut browser);
    said(&mut browser, |text| text.contains("It is hidden."));
    browser.done(json!({ "do": "button", "name": "Show it" }));
    becomes(&mut browser, "showing it", |now| now["hidden"] == json!([]));
}

/// On a phone: all controls are large enough and uncovered, and there is a finger action for each key.
#[test]
fn a_finger_can_do_all_of_it_on_a_phone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let targets =
        |browser: &mut Browser| browser.done(json!({ "do": "targets" })).as_array().unwrap().clone();
    let hold = |browser: &mut Browser, name: &str, milliseconds: u32| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": milliseconds }));
    };
    let tap = |browser: &mut Browser, name: &str| hold(browser, name, 60);
    let check = |browser: &mut Browser, what: &str| {
        for target in targets(browser) {
            let [width, height] = ["width", "height"].map(|side| number(&target[side]));
            assert!(width >= 43.9 && height >= 43.9, "{what}: {target}");
            let is_field = target["tag"] == "input" || target["tag"] == "select";
            assert!(!is_field || number(&target["letters"]) >= 16.0, "{what}: {target}");
            assert_eq!(target["isMet"], true, "{what}: something is over {target}");
            assert_eq!(target["isInReach"], true, "{what}: the screen cuts {target}");
        }
    };
    check(&mut browser, "at first");
    // The help is in sight without scrolling.
    let help = browser.done(json!({ "do": "rects", "selector": "#open-keys" }))[0].take();
    assert!(number(&help["x"]) + number(&help["width"]) / 2.0 <= 390.0, "{help}");
    // Something is picked, and another one beside it.
    browser.done(json!({ "do": "stand", "eye": [0.0, 4.0, 4.0], "forward": [0.0, -0.45, -0.9] }));
    press(&mut browser, "2");
    look(&mut browser);
    let names = ["Model", "Cut", "Measure", "Views", "Status"];
    for name in names {
        tap(&mut browser, name);
        browser.done(json!({ "do": "wait", "milliseconds": 300 }));
        check(&mut browser, name);
        if name == "Status" {
            tap(&mut browser, "Details for support");
            browser.done(json!({ "do": "wait", "milliseconds": 300 }));
            check(&mut browser, "the details for support");
        }
        if name == "Model" {
            tap(&mut browser, "What is in boxes.obj");
            tap(&mut browser, "Show box1");
            becomes(&mut browser, "hiding", |now| now["hidden"] == json!([1]));
            tap(&mut browser, "Show box1");
            tap(&mut browser, "box1");
            becomes(&mut browser, "a pick", |now| now["selected"] == json!([1]));
            check(&mut browser, "the tree, and something is picked");
        }
        tap(&mut browser, &format!("Close {name}"));
        let is_open = |browser: &mut Browser| {
            targets(browser).iter().any(|target| target["name"] == format!("Close {name}"))
        };
        assert!((0..600).any(|_| !is_open(&mut browser)), "{name} is closed");
        check(&mut browser, &format!("{name} is closed"));
    }
    let place = browser.done(json!({ "do": "place", "object": 2 }));
    browser.done(json!({ "do": "touch", "x": place["x"], "y": place["y"], "milliseconds": 60 }));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([2]));
    tap(&mut browser, "Pick more");
    let place = browser.done(json!({ "do": "place", "object": 1 }));
    browser.done(json!({ "do": "touch", "x": place["x"], "y": place["y"], "milliseconds": 60 }));
    becomes(&mut browser, "one more", |now| now["selected"] == json!([1, 2]));
    // Up, down, and a jump.
    let height = |browser: &mut Browser| number(&state(browser)["eye"][1]);
    let before = height(&mut browser);
    // With few pictures a second the page moves in few steps.
    let mut until = |name: &str, there: &dyn Fn(f64) -> bool| {
        let reached = (0..20).any(|_| {
            hold(&mut browser, name, 500);
            there(height(&mut browser))
        });
        assert!(reached, "{name}: {before}");
        height(&mut browser)
    };
    let risen = until("Rise", &|now| now > before + 0.05);
    until("Sink", &|now| now < risen - 0.05);
    tap(&mut browser, "Walk");
    becomes(&mut browser, "walking", |now| now["mode"] == "walk");
    assert!(targets(&mut browser).iter().any(|target| target["name"] == "Jump"));
    check(&mut browser, "walking");
    // With its own bars a browser leaves less of the screen.
    browser.done(json!({ "do": "resize", "width": 390, "height": 664 }));
    look(&mut browser);
    check(&mut browser, "a lower screen");
    tap(&mut browser, "Standard views");
    check(&mut browser, "the standard views on a lower screen");
    for name in ["Whole model", "Keys", "Top", "Parallel"] {
        assert!(targets(&mut browser).iter().any(|target| target["name"] == name), "{name}");
    }
}

/// The script and the style come compressed, and not at all if the browser has them.
#[test]
fn files_of_the_page_come_compressed_and_once() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let first = browser.done(json!({ "do": "files" }));
    browser.done(json!({ "do": "reload" }));
    browser.done(json!({ "do": "settle" }));
    let second = browser.done(json!({ "do": "files" }));
    for file in ["/main.js", "/main.css"] {
        let [encoded, decoded] =
            ["encodedBodySize", "decodedBodySize"].map(|size| number(&first[file][size]));
        assert!(encoded > 0.0 && encoded < 0.5 * decoded, "{file}: {encoded} of {decoded} bytes");
        let again = number(&second[file]["transferSize"]);
        assert!(again < 600.0, "{file} comes again: {again} bytes");
        let plain = service.ask(file, "");
        assert!(!plain.contains("content-encoding") && plain.contains("etag: W/"), "{file}");
        assert!(plain.len() as f64 >= decoded, "{file} comes as it is to who does not read codings");
        let gzip = service.status(file, "Accept-Encoding: gzip\r\n");
        assert!(gzip.starts_with("HTTP/1.1 200"), "{gzip}");
        let (_, rest) = plain.split_once("etag: ").unwrap();
        let tag = rest.lines().next().unwrap();
        let unchanged = service.ask(file, &format!("If-None-Match: {tag}\r\n"));
        assert!(unchanged.starts_with("HTTP/1.1 304") && unchanged.ends_with("\r\n\r\n"), "{unchanged}");
    }
}
