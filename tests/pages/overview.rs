//! The start of the page, and the ways to an overview: a flight, standard views, the cube, the way back, and a
//! page that waits for its model.

use std::{
    fs,
    os::unix::fs::PermissionsExt as _,
    process::{Child, Stdio},
    thread,
    time::Duration,
};

use serde_json::{Value, json};

use super::controls::{ROOM, becomes, boxes, goes, look, number, numbers, opened, press, said};
use crate::common::page::{Browser, Service, skipped};
use crate::common::program::Bench;

fn distance(a: &Value, b: &Value) -> f64 {
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Waits until the eye looks along `forward`, and returns the page's state once its picture is exact.
fn looks_along(browser: &mut Browser, forward: [f64; 3]) -> Value {
    let length = forward.iter().map(|part| part * part).sum::<f64>().sqrt();
    becomes(browser, &format!("a view along {forward:?}"), |now| {
        let cosine: f64 = numbers(&now["forward"]).iter().zip(forward).map(|(a, b)| a * b / length).sum();
        cosine > 0.999
    });
    look(browser)
}

/// The whole model is in the picture, and fills it.
fn shows_all(browser: &mut Browser, what: &str) {
    let extent = browser.done(json!({ "do": "extent" }));
    let [across, down, x, y] = ["across", "down", "x", "y"].map(|side| number(&extent[side]));
    assert!(across.max(down) > 0.6 && across.max(down) < 0.95, "{what}: {extent}");
    assert!((x - 0.5).abs() < 0.15 && (y - 0.5).abs() < 0.15, "{what}: {extent}");
}

const ISO: [f64; 3] = [-1.0, -0.8, -1.0];

#[test]
fn the_page_begins_with_an_overview_and_flies_down() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    // Somebody who wants less motion begins where the flight ends.
    let Some(mut still) = Browser::start(600, 400) else { return };
    still.done(json!({ "do": "open", "url": service.url() }));
    let end = look(&mut still);
    let mut browser = Browser::with_motion(600, 400).unwrap();
    browser.done(json!({ "do": "open", "url": service.url() }));
    becomes(&mut browser, "the end of the flight", |now| {
        now["mode"] == end["mode"] && distance(&now["eye"], &end["eye"]) < 0.05
    });
    let now = look(&mut browser);
    assert!(distance(&now["orientation"], &end["orientation"]) < 1e-6, "{now}");
    let eyes = browser.done(json!({ "do": "eyes" }));
    let eyes = eyes.as_array().unwrap();
    press(&mut browser, "Home");
    let overview = looks_along(&mut browser, ISO);
    shows_all(&mut browser, "the overview");
    assert!(distance(&eyes[0], &overview["eye"]) < 1e-6, "it begins there: {} {}", eyes[0], overview["eye"]);
    let between = |eye: &&Value| distance(eye, &overview["eye"]) > 1.0 && distance(eye, &end["eye"]) > 1.0;
    assert!(eyes.iter().filter(between).count() > 2, "no jump: {eyes:?}");
    // A link to a view is shown at once.
    press(&mut browser, "v");
    browser.done(json!({ "do": "button", "name": "Copy link" }));
    let link = browser.done(json!({ "do": "clipboard" }));
    let mut other = Browser::with_motion(600, 400).unwrap();
    other.done(json!({ "do": "open", "url": link }));
    look(&mut other);
    let eyes = other.done(json!({ "do": "eyes" }));
    let eyes = eyes.as_array().unwrap();
    let is_there = |eye: &Value| distance(eye, &overview["eye"]) < 1e-6;
    assert!(!eyes.is_empty() && eyes.iter().all(is_there), "{eyes:?}");
}

#[test]
fn any_input_ends_the_flight_where_it_is() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let inputs = [
        json!({ "do": "press", "key": "Shift" }),
        json!({ "do": "click", "x": 300, "y": 150 }),
        json!({ "do": "wheel", "x": 300, "y": 150, "down": -100 }),
    ];
    for input in inputs {
        let Some(mut browser) = Browser::with_motion(600, 400) else { return };
        browser.done(json!({ "do": "open", "url": service.url() }));
        let start = becomes(&mut browser, "a beginning", |now| now["eye"].is_array())["start"].take();
        browser.done(input.clone());
        let held = look(&mut browser);
        assert!(held["mode"] == "orbit" && distance(&held["eye"], &start["eye"]) > 1.0, "{input}: {held}");
        browser.done(json!({ "do": "wait", "milliseconds": 500 }));
        assert_eq!(look(&mut browser)["eye"], held["eye"], "{input}");
    }
}

/// With keys alone, and with the mouse alone.
#[test]
fn standard_views_show_the_model_from_its_sides_and_there_is_a_way_back() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    let views = [
        ("4", "Front", [0.0, 0.0, -1.0]),
        ("5", "Back", [0.0, 0.0, 1.0]),
        ("6", "Left", [1.0, 0.0, 0.0]),
        ("7", "Right", [-1.0, 0.0, 0.0]),
        ("8", "Top", [0.0, -1.0, 0.0]),
        ("9", "Bottom", [0.0, 1.0, 0.0]),
        ("0", "Iso", ISO),
    ];
    press(&mut browser, "2");
    let begun = look(&mut browser);
    let mut places = vec![begun["eye"].clone()];
    for (key, name, forward) in views {
        press(&mut browser, key);
        let now = looks_along(&mut browser, forward);
        assert_eq!(now["mode"], "fly");
        shows_all(&mut browser, name);
        places.push(now["eye"].clone());
    }
    // Back through all of them, to where the eye began, and forward again.
    for (at, place) in places.iter().enumerate().rev().skip(1) {
        press(&mut browser, "Alt+ArrowLeft");
        assert_eq!(&look(&mut browser)["eye"], place, "back to {at}");
    }
    press(&mut browser, "Alt+ArrowLeft");
    assert_eq!(look(&mut browser)["eye"], places[0], "there is nothing before it");
    for (at, place) in places.iter().enumerate().skip(1) {
        press(&mut browser, "Alt+ArrowRight");
        assert_eq!(&look(&mut browser)["eye"], place, "forward to {at}");
    }
    // The cube: from a corner three faces show. It turns with the eye.
    for (face, forward) in [("Top", views[4].2), ("Front", views[0].2), ("Right", views[3].2)] {
        press(&mut browser, "0");
        looks_along(&mut browser, ISO);
        let shown = browser.done(json!({ "do": "text", "selector": ".cube text" }));
        assert_eq!(shown, json!(["Front", "Right", "Top"]));
        browser.done(json!({ "do": "face", "name": face }));
        looks_along(&mut browser, forward);
        let shown = browser.done(json!({ "do": "text", "selector": ".cube text" }));
        assert_eq!(shown, json!([face]), "it faces the eye");
    }
    // Tab leads to the buttons, and Enter and Space press them.
    let use_button = |browser: &mut Browser, name: &str, key: &str| {
        browser.done(json!({ "do": "tab", "name": name }));
        press(browser, key);
    };
    use_button(&mut browser, "Standard views", "Enter");
    use_button(&mut browser, "Left", " ");
    looks_along(&mut browser, views[2].2);
    browser.done(json!({ "do": "label", "name": "Previous place" }));
    looks_along(&mut browser, views[3].2);
    use_button(&mut browser, "Whole model", "Enter");
    looks_along(&mut browser, ISO);
    // Fit all keeps the side.
    browser.done(json!({ "do": "stand", "eye": [50.0, 1.0, 0.5], "forward": [1.0, 0.0, 0.0] }));
    press(&mut browser, "Shift+F");
    looks_along(&mut browser, [0.9, -0.44, 0.0]);
    shows_all(&mut browser, "fit all");
    // Something picked is shown from its sides.
    press(&mut browser, "0");
    looks_along(&mut browser, ISO);
    let place = browser.done(json!({ "do": "point", "point": [-2.5, 1.0, -3.5] }));
    browser.done(json!({ "do": "click", "x": place[0], "y": place[1] }));
    becomes(&mut browser, "a pick", |now| now["selected"] == json!([1]));
    let details = json!({ "do": "text", "selector": ".details h2" });
    assert!((0..400).any(|_| browser.done(details.clone()) == json!(["box1"])));
    press(&mut browser, "8");
    let eye = numbers(&looks_along(&mut browser, views[4].2)["eye"]);
    assert!((eye[0] + 2.5).abs() < 0.2 && (eye[2] + 3.5).abs() < 0.2 && eye[1] < 10.0, "above it: {eye:?}");
}

/// The floor is as wide as the model, and takes no room where it does not show.
#[test]
fn an_overview_is_of_what_is_shown() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    press(&mut browser, "2");
    let pick = |browser: &mut Browser, point: [f64; 3], object: u32| {
        press(browser, "0");
        looks_along(browser, ISO);
        let place = browser.done(json!({ "do": "point", "point": point }));
        browser.done(json!({ "do": "click", "x": place[0], "y": place[1] }));
        becomes(browser, "a pick", |now| now["selected"] == json!([object]));
    };
    let all_of_it = |browser: &mut Browser| {
        // In turn from a corner, from the present side, and from above.
        for key in ["Home", "Shift+F", "8"] {
            goes(browser, |browser| press(browser, key));
            shows_all(browser, key);
        }
    };
    pick(&mut browser, [-2.5, 1.0, -3.5], 1);
    press(&mut browser, "i");
    becomes(&mut browser, "one box", |now| now["isolated"] == json!([1]));
    press(&mut browser, "Escape");
    all_of_it(&mut browser);
    let near = look(&mut browser);
    press(&mut browser, "Shift+H");
    becomes(&mut browser, "all", |now| now["isolated"].is_null());
    all_of_it(&mut browser);
    let far = look(&mut browser);
    assert!(number(&far["eye"][1]) > 2.0 * number(&near["eye"][1]), "{} {}", near["eye"], far["eye"]);
    // Both boxes without the floor.
    pick(&mut browser, [5.0, 0.0, 5.0], 0);
    press(&mut browser, "h");
    becomes(&mut browser, "no floor", |now| now["hidden"] == json!([0]));
    all_of_it(&mut browser);
}

#[test]
fn a_hint_says_how_to_move_at_the_first_start_alone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    let hint = |browser: &mut Browser| browser.done(json!({ "do": "rects", "selector": ".hint" }));
    let shown = (0..3000).map(|_| hint(&mut browser)).find(|now| now != &json!([])).unwrap();
    let shown = &shown[0];
    assert!(number(&shown["y"]) - number(&shown["height"]) / 2.0 > 450.0, "not over the middle: {shown}");
    let gone = (0..600).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
        hint(&mut browser) == json!([])
    });
    assert!(gone, "it goes by itself");
    browser.done(json!({ "do": "reload" }));
    look(&mut browser);
    browser.done(json!({ "do": "wait", "milliseconds": 500 }));
    assert_eq!(hint(&mut browser), json!([]), "it was shown before");
}

#[test]
fn a_finger_turns_the_model_by_the_cube_on_a_phone() {
    let bench = Bench::empty();
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let Some(service) = Service::of(&bench, "boxes.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    let begun = look(&mut browser);
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    tap(&mut browser, "Whole model");
    looks_along(&mut browser, ISO);
    shows_all(&mut browser, "the whole model");
    let face = browser.done(json!({ "do": "rects", "selector": ".cube [data-name=Top]" }))[0].take();
    assert!(number(&face["width"]) > 40.0, "large enough for a finger: {face}");
    browser.done(json!({ "do": "touch", "x": face["x"], "y": face["y"], "milliseconds": 60 }));
    looks_along(&mut browser, [0.0, -1.0, 0.0]);
    tap(&mut browser, "Standard views");
    for target in browser.done(json!({ "do": "targets" })).as_array().unwrap() {
        assert!(number(&target["width"]) >= 43.9 && number(&target["height"]) >= 43.9, "{target}");
        assert_eq!(target["isMet"], true, "something is over {target}");
    }
    tap(&mut browser, "Left");
    looks_along(&mut browser, [1.0, 0.0, 0.0]);
    for _ in 0..3 {
        tap(&mut browser, "Previous place");
    }
    assert_eq!(look(&mut browser)["eye"], begun["eye"]);
}

/// `trimaran view` of a model, held back until it is released: a text browser holds up the program.
struct Held<'b> {
    bench: &'b Bench,
    child: Child,
    url: String,
}

impl<'b> Held<'b> {
    /// `None` if the program was built without its page, and none is required.
    fn view(bench: &'b Bench, model: &str) -> Option<Self> {
        let script = "#!/bin/sh\necho \"$@\" > opened.part && mv opened.part opened\n\
                      while [ ! -e go ]; do sleep 0.05; done\n";
        bench.write("w3m", script);
        fs::set_permissions(bench.path("w3m"), fs::Permissions::from_mode(0o755)).unwrap();
        bench.write("tank.obj", model);
        let mut command = bench.command(&["view", "tank.obj"]);
        command.env("BROWSER", bench.path("w3m")).env("XDG_CACHE_HOME", bench.path("cache"));
        command.env("HOME", bench.path(""));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let opened = loop {
            if let Ok(opened) = fs::read_to_string(bench.path("opened")) {
                break opened;
            }
            if child.try_wait().unwrap().is_some() {
                return skipped("the program was built without its page");
            }
            thread::sleep(Duration::from_millis(20));
        };
        let page = fs::read_to_string(opened.trim().strip_prefix("file://").unwrap()).unwrap();
        let url = page.split_once("href=\"").unwrap().1.split_once('"').unwrap().0.to_owned();
        Some(Self { bench, child, url })
    }

    fn release(&self) {
        self.bench.write("go", "");
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.release();
        let _ended = self.child.kill();
        let _code = self.child.wait();
    }
}

const TANK: &str = "o tank\nv 0 0 0\nv 9 0 0\nv 0 0 9\nv 0 5 0\nf 1 2 4\nf 1 4 3\nf 1 3 2\nf 2 3 4\n";

#[test]
fn a_page_waits_for_its_model_and_goes_on_by_itself() {
    let bench = Bench::empty();
    let Some(held) = Held::view(&bench, TANK) else { return };
    let Some(mut browser) = Browser::start(600, 400) else { return };
    browser.tell(json!({ "do": "open", "url": held.url }));
    said(&mut browser, |text| text.contains("is being prepared") && text.contains("reading"));
    held.release();
    browser.tell(json!({ "do": "settle" }));
    assert_eq!(browser.tell(json!({ "do": "title" }))["answer"], "tank - Trimaran");
    let state = browser.tell(json!({ "do": "state" }))["answer"].take();
    assert!(state["drawn"]["drawables"].as_u64() > Some(0), "{state}");
    // The same token opens it as before.
    browser.tell(json!({ "do": "open", "url": held.url }));
    browser.tell(json!({ "do": "settle" }));
}

#[test]
fn a_page_says_why_its_model_cannot_be_shown() {
    let bench = Bench::empty();
    let Some(mut held) = Held::view(&bench, "o tank\nv 0 0 0\n") else { return };
    let Some(mut browser) = Browser::start(600, 400) else { return };
    browser.tell(json!({ "do": "open", "url": held.url.replace("token=", "token=x") }));
    said(&mut browser, |text| text.contains("not valid any more"));
    browser.tell(json!({ "do": "open", "url": held.url }));
    said(&mut browser, |text| text.contains("is being prepared"));
    held.release();
    let text = said(&mut browser, |text| text.contains("cannot be shown"));
    assert!(text.contains("tank.obj"), "{text}");
    let place = browser.tell(json!({ "do": "rects", "selector": "#status" }))["answer"][0].take();
    assert!((0.0..400.0).contains(&number(&place["y"])), "it can be seen: {place}");
    assert_eq!(held.child.wait().unwrap().code(), Some(2));
}
