//! Walking in a real browser: on floors, against walls, up stairs, and with other events meanwhile.

use serde_json::{Value, json};
use trimaran_scene::Scene;

use super::controls::{said, state};
use crate::common::house::{RISE, STEPS, house};
use crate::common::page::{Browser, Difference, Service, difference};
use crate::common::program::Bench;

/// A service of a scene, and a browser that shows it.
fn opened(bench: &Bench, scene: &str) -> Option<(Service, Browser)> {
    let service = Service::of(bench, scene, "127.0.0.1:0")?;
    let mut browser = Browser::start(300, 300)?;
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    Some((service, browser))
}

/// The eye's position.
fn eye(browser: &mut Browser) -> [f64; 3] {
    let state = state(browser);
    [0, 1, 2].map(|axis| state["eye"][axis].as_f64().unwrap())
}

#[test]
fn a_wall_stops_who_walks_and_stairs_lead_up() {
    let bench = Bench::empty();
    bench.write("house.obj", house());
    bench.done(&["import", "house.obj", "-o", "house.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "house.scene") else { return };
    let north = json!([0, 0, -1]);

    browser.done(json!({ "do": "stand", "eye": [-5.0, 1.7, 0.0], "forward": north }));
    for _ in 0..6 {
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 1000 }));
    }
    let [x, y, z] = eye(&mut browser);
    assert!((-3.9..-3.5).contains(&z), "the wall begins at -4, and half of a body is 0.22 m: {z}");
    assert!((x + 5.0).abs() < 0.01 && (y - 1.7).abs() < 0.05, "{x} {y}");

    browser.done(json!({ "do": "stand", "eye": [5.0, 1.7, 3.5], "forward": north }));
    let mut climbed = Vec::new();
    while climbed.len() < 30 && climbed.last().is_none_or(|[_, _, z]: &[f64; 3]| *z > -4.0) {
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 500 }));
        climbed.push(eye(&mut browser));
    }
    let heights: Vec<f64> = climbed.iter().map(|[_, y, _]| *y).collect();
    let top = 1.7 + RISE * f64::from(STEPS);
    assert!((heights.last().unwrap() - top).abs() < 0.05, "not up at {top}: {climbed:?}");
    assert!(heights.iter().any(|y| (2.0..3.4).contains(y)), "not step by step: {heights:?}");
    // Beside the landing it goes down again.
    browser.done(json!({ "do": "stand", "eye": [2.0, 3.7, -5.0], "forward": north }));
    browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 1500 }));
    let [_, y, _] = eye(&mut browser);
    assert!((y - 1.7).abs() < 0.05, "it falls to the floor: {y}");
}

#[test]
fn a_walk_with_no_floor_below_is_told_once() {
    let bench = Bench::empty();
    bench.write("house.obj", house());
    bench.done(&["import", "house.obj", "-o", "house.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "house.scene") else { return };
    let stand = |browser: &mut Browser, at: [f64; 3]| {
        browser.done(json!({ "do": "stand", "eye": at, "forward": [0, 0, -1] }));
    };
    for _ in 0..2 {
        stand(&mut browser, [40.0, 1.7, 0.0]);
        said(&mut browser, |text| text.starts_with("No floor below"));
        browser.done(json!({ "do": "pass" }));
        said(&mut browser, str::is_empty);
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 500 }));
        stand(&mut browser, [50.0, 3.0, 0.0]);
        browser.done(json!({ "do": "wait", "milliseconds": 500 }));
        assert_eq!(browser.done(json!({ "do": "status" })), "");
        assert!((eye(&mut browser)[1] - 3.0).abs() < 0.01, "nobody falls for ever");
        // On a floor, and then it is said again.
        stand(&mut browser, [-5.0, 2.5, 0.0]);
        let lands = (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            eye(&mut browser)[1] < 1.75
        });
        assert!(lands, "{:?}", eye(&mut browser));
    }
}

/// The page's picture at rest is exact.
fn is_exact_at_rest(browser: &mut Browser, scene: &Scene) -> Value {
    browser.tell(json!({ "do": "settle" }));
    let look = browser.tell(json!({ "do": "look" }))["answer"].take();
    let Difference { drawables, pixels, .. } = difference(&look, scene);
    assert_eq!(drawables, []);
    assert!(pixels < 0.01, "{pixels}");
    look
}

#[test]
fn a_walk_goes_on_while_the_service_is_killed_and_comes_back() {
    let bench = Bench::with_plant(100);
    let Some((service, mut browser)) = opened(&bench, "plant.scene") else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    let at = service.at.clone();
    browser.done(json!({ "do": "down", "key": "ArrowLeft" }));
    browser.done(json!({ "do": "wait", "milliseconds": 500 }));
    drop(service);
    let mut looks = Vec::new();
    for _ in 0..3 {
        browser.tell(json!({ "do": "wait", "milliseconds": 400 }));
        looks.push(browser.tell(json!({ "do": "look" }))["answer"].take());
    }
    for pair in looks.windows(2) {
        assert_ne!(pair[0]["orientation"], pair[1]["orientation"], "the eye turns on");
        assert!(pair[0]["pictures"].as_u64() < pair[1]["pictures"].as_u64(), "pictures go on");
        assert_eq!(pair[0]["frame"], pair[1]["frame"], "nobody culls");
    }
    let _again = Service::start(&bench, &at).unwrap();
    browser.tell(json!({ "do": "wait", "milliseconds": 1500 }));
    browser.tell(json!({ "do": "up", "key": "ArrowLeft" }));
    let back = is_exact_at_rest(&mut browser, &scene);
    assert!(back["frame"].as_u64() > looks[2]["frame"].as_u64(), "it is culled again");
}

#[test]
fn a_hundred_sizes_while_walking_leave_an_exact_picture() {
    let bench = Bench::with_plant(100);
    let Some((_service, mut browser)) = opened(&bench, "plant.scene") else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    browser.done(json!({ "do": "down", "key": "ArrowLeft" }));
    for at in 0..100 {
        let (width, height) = (120 + 37 * at % 400, 100 + 53 * at % 300);
        browser.done(json!({ "do": "resize", "width": width, "height": height }));
    }
    // A picture of the first size shows little of such a picture.
    browser.done(json!({ "do": "resize", "width": 700, "height": 120 }));
    browser.done(json!({ "do": "up", "key": "ArrowLeft" }));
    let look = is_exact_at_rest(&mut browser, &scene);
    assert_eq!([&look["width"], &look["height"]], [&json!(700), &json!(120)]);
}
