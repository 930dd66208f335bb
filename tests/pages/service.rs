//! The service of a page: access control, and a real browser with the same pictures as displays.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use trimaran_scene::Scene;

use crate::common::page::{Browser, Difference, Service, TOKEN, difference, items};
use crate::common::program::Bench;

const UPGRADE: &str = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";

#[test]
fn the_scene_is_for_whoever_knows_the_token_and_comes_from_here() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let page = service.ask("/", "");
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("<canvas"), "{page}");
    assert!(page.contains("content-security-policy: default-src 'none'"), "{page}");
    assert!(page.contains("referrer-policy: no-referrer"), "{page}");
    for name in ["plant.example", "pages:7480", "localhost:1"] {
        assert!(service.ask_as(name, "/", "").starts_with("HTTP/1.1 200"), "{name}");
    }
    let unknown = service.ask_as("evil.example", "/", "");
    assert!(unknown.starts_with("HTTP/1.1 403"), "{unknown}");
    assert!(unknown.contains("TRIMARAN_WS_ALLOW_ORIGINS=http://evil.example"), "{unknown}");
    assert!(service.ask("/main.js", "").contains("text/javascript"), "no script");
    assert!(service.ask("/../Cargo.toml", "").starts_with("HTTP/1.1 404"));

    let scene = service.ask(&format!("/scene?token={TOKEN}"), "");
    let body: Value = serde_json::from_str(scene.split_once("\r\n\r\n").unwrap().1).unwrap();
    assert_eq!(body["name"], "plant");
    assert!(body["eyeHeight"].as_f64().unwrap() > 0.0, "{body}");
    for query in ["", "?token=", "?token=0123456789abcdefXYz", "?x=1&token=0123456789abcdefXYZ"] {
        assert!(service.ask(&format!("/scene{query}"), "").starts_with("HTTP/1.1 403"), "{query}");
        assert!(service.ask(&format!("/link{query}"), UPGRADE).starts_with("HTTP/1.1 403"), "{query}");
        assert!(service.ask(&format!("/people{query}"), "").starts_with("HTTP/1.1 403"), "{query}");
    }
    let snap = "snap?drawable=0&eye=0,0,9&at=0,0,0&reach=1";
    for asked in [
        "part?object=0",
        "children?from=0",
        "search?text=a",
        "objects?text=a",
        "box?text=a",
        "rows?text=a",
        "attributes?",
        snap,
        "tile?x=0&z=0",
    ] {
        let (path, query) = asked.split_once('?').unwrap();
        let told = service.ask(&format!("/{path}?token={TOKEN}&{query}"), "");
        assert!(told.starts_with("HTTP/1.1 200"), "{asked}: {told}");
        for stranger in
            [format!("/{asked}"), format!("/{asked}&token={TOKEN}"), format!("/{path}?token=x&{query}")]
        {
            assert!(service.ask(&stranger, "").starts_with("HTTP/1.1 403"), "{stranger}");
        }
    }
    let bad = service.ask(&format!("/part?token={TOKEN}&object=x"), "");
    assert!(bad.starts_with("HTTP/1.1 404"), "{bad}");
    let link = format!("/link?token={TOKEN}");
    let status = |origin: &str| service.status(&link, &format!("{UPGRADE}Origin: {origin}\r\n"));
    let foreign = format!("http://{}:1", service.at.split(':').next().unwrap());
    for foreign in ["http://evil.example", "http://plant.example", "https://plant.example:1", &foreign] {
        assert!(status(foreign).starts_with("HTTP/1.1 403"), "{foreign}");
    }
    for own in [&format!("http://{}", service.at), "https://plant.example", "http://pages:7480"] {
        assert!(status(own).starts_with("HTTP/1.1 101"), "{own}");
    }
    assert!(service.ask(&link, "").starts_with("HTTP/1.1 426"));
}

#[test]
fn a_display_joins_the_service_of_a_page() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    bench.done(&["run", "plant.scene", "--frames", "4", "--audit-every", "0", "--out", "whole"]);
    let culler = format!("ws://{}/link?token={TOKEN}", service.at);
    let display =
        ["role", "display", "--scene", "plant.scene", "--empty-display", "true", "--cullers", &culler];
    bench.done(
        &[&display[..], &["--path", "whole/report.json", "--audit-every", "2", "--out", "there"]].concat(),
    );
    let report = bench.report("there");
    assert_eq!(report["frames"].as_array().unwrap().len(), 4);
    assert_eq!(report["summary"]["cut_mismatch_pixels_total"], 0, "{}", report["summary"]);
}

/// At rest the page shows exactly the visible drawables of the whole cut: at the start, behind a walk, in a
/// window of another size, and after the graphics device has lost its context.
#[test]
fn a_browser_shows_what_is_visible_and_nothing_else() {
    let bench = Bench::with_plant(400);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(500, 400) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    assert_eq!(browser.done(json!({ "do": "open", "url": service.url() })), 200);
    let mut eyes = BTreeSet::new();
    // Before the page is loaded it gets no key events.
    browser.done(json!({ "do": "settle" }));
    browser.done(json!({ "do": "press", "key": "2" }));
    for way in [
        json!({ "do": "status" }),
        json!({ "do": "hold", "key": "KeyW", "milliseconds": 600 }),
        json!({ "do": "drag", "right": 150, "down": 40 }),
        json!({ "do": "hold", "key": "KeyE", "milliseconds": 300 }),
        json!({ "do": "resize", "width": 613, "height": 377 }),
        json!({ "do": "lose" }),
    ] {
        browser.done(way.clone());
        browser.done(json!({ "do": "settle" }));
        let look = browser.done(json!({ "do": "look" }));
        let Difference { pixels, drawables, seen } = difference(&look, &scene);
        println!("{way}: {seen} drawables, {:.3} % of pixels differ", 100.0 * pixels);
        assert!(seen > 5, "{way}: {seen} drawables are seen");
        assert_eq!(drawables, [], "{way}");
        assert!(pixels < 0.01, "{way}: {pixels}");
        eyes.insert(look["eye"].to_string());
    }
    assert_eq!(eyes.len(), 3, "two of the ways move the eye: {eyes:?}");
}

/// Walks, looks at objects, cuts and undoes it, all by keys and the mouse.
#[test]
fn a_person_walks_and_looks_into_the_model() {
    let bench = Bench::with_plant(400);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(500, 400) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let look = |browser: &mut Browser| {
        browser.done(json!({ "do": "settle" }));
        browser.done(json!({ "do": "look" }))
    };
    let press = |browser: &mut Browser, key: &str| browser.done(json!({ "do": "press", "key": key }));
    let start = look(&mut browser);
    assert_eq!(start["mode"], "walk");
    // However far it walks, the body stays in the house and on a floor.
    for key in ["KeyW", "KeyA", "KeyS"] {
        browser.done(json!({ "do": "hold", "key": key, "milliseconds": 1200 }));
    }
    let walked = look(&mut browser);
    assert_ne!(walked["eye"], start["eye"]);
    let height = walked["eye"][1].as_f64().unwrap();
    assert!((height - start["eye"][1].as_f64().unwrap()).abs() < 1.5, "{height}");

    let pick = |browser: &mut Browser| {
        for (x, y) in [(250, 200), (250, 150), (100, 200), (400, 200), (250, 330), (250, 60)] {
            browser.done(json!({ "do": "click", "x": x, "y": y }));
            let seen = look(browser);
            if let [object] = &seen["selected"].as_array().unwrap()[..] {
                return u32::try_from(object.as_u64().unwrap()).unwrap();
            }
        }
        panic!("nothing can be picked");
    };
    let object = pick(&mut browser);
    press(&mut browser, "h");
    let hidden = look(&mut browser);
    assert_eq!((&hidden["hidden"], &hidden["selected"]), (&json!([object]), &json!([])));
    let shows = |look: &Value| look["objects"].as_array().unwrap().contains(&json!(object));
    assert!(!shows(&hidden) && hidden["objects"].as_array().unwrap().len() > 5, "it alone is gone");
    press(&mut browser, "Control+z");
    let back = look(&mut browser);
    assert!(back["hidden"] == json!([]) && shows(&back));

    // By its name, wherever it is.
    let name = scene.object_name(object).unwrap();
    press(&mut browser, "/");
    browser.done(json!({ "do": "type", "text": name }));
    browser.done(json!({ "do": "button", "name": name.replace(['(', ')', '.', '+'], ".") }));
    press(&mut browser, "i");
    let alone = look(&mut browser);
    let shown: BTreeSet<u64> =
        alone["objects"].as_array().unwrap().iter().map(|object| object.as_u64().unwrap()).collect();
    assert!(shown.len() == 1 && alone["mode"] == "orbit", "{shown:?}");
    assert!(items(&alone).iter().any(|item| *item != u32::MAX), "it is seen");

    // A plane ahead cuts something off, and undo restores it.
    press(&mut browser, "Shift+H");
    let whole = look(&mut browser);
    press(&mut browser, "b");
    browser.done(json!({ "do": "button", "name": "Plane ahead" }));
    let cut = look(&mut browser);
    assert_eq!((cut["sections"].as_array().unwrap().len(), &cut["eye"]), (1, &whole["eye"]));
    assert!(cut["runs"] != whole["runs"], "something is cut off");
    // The plane faces the eye: its handle moves away with an upward drag. A whole drag is one step.
    browser.done(json!({ "do": "handle", "right": 0, "down": -60 }));
    let dragged = look(&mut browser);
    assert_ne!(dragged["sections"], cut["sections"]);
    press(&mut browser, "Control+z");
    assert_eq!(look(&mut browser)["sections"], cut["sections"]);
    press(&mut browser, "Control+z");
    assert!(look(&mut browser)["runs"] == whole["runs"], "it is back");
}

#[test]
fn a_page_bears_any_input() {
    bears_any_input(1, Duration::ZERO);
}

/// Like a page left open all day: it takes no more memory at the end than near the beginning.
#[test]
#[ignore = "takes ten minutes"]
fn a_page_bears_ten_minutes_of_any_input() {
    bears_any_input(2, Duration::from_secs(600));
}

/// With any input of keys, mouse and window nothing fails, and at rest the picture is right: in at least this
/// many rounds, and for this long.
fn bears_any_input(rounds: usize, time: Duration) {
    let bench = Bench::with_plant(200);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let mut random = Random(7);
    let begun = Instant::now();
    let mut memory = Vec::new();
    while memory.len() < rounds || begun.elapsed() < time {
        memory.push(round_of_any_input(&mut browser, &mut random, &scene));
    }
    println!("bytes of scripts, bytes of geometry, elements of the document: {memory:?}");
    // The open panel is random: the maximum of the first half counts.
    let early = &memory[..memory.len().div_ceil(2)];
    let most = |kind: usize| early.iter().map(|round| round[kind]).max().unwrap();
    let [scripts, geometry, elements] = memory[memory.len() - 1];
    assert!(scripts < most(0) * 5 / 4 + (4 << 20), "scripts take more and more: {memory:?}");
    assert!(geometry < most(1) * 2 + (1 << 20), "geometry takes more and more: {memory:?}");
    assert!(elements < most(2) + 500, "the document grows: {memory:?}");
}

/// Returns the remaining bytes of scripts and of geometry, and elements of the document.
fn round_of_any_input(browser: &mut Browser, random: &mut Random, scene: &Scene) -> [u64; 3] {
    let keys = ["KeyW", "KeyA", "KeyS", "KeyD", "KeyE", "KeyQ", "Space", "ArrowLeft", "PageDown", "Shift"];
    let presses =
        ["1", "2", "3", "h", "i", "x", "f", "Shift+H", "Control+z", "Control+y", "m", "p", "v", "b", "t"];
    for _ in 0..150 {
        let side = |random: &mut Random| 100 + random.below(400);
        browser.done(match random.below(5) {
            0 => json!({ "do": "hold", "key": keys[random.below(10)], "milliseconds": random.below(60) }),
            1 => json!({ "do": "press", "key": presses[random.below(15)] }),
            2 => json!({ "do": "click", "x": random.below(100), "y": random.below(100) }),
            3 => json!({ "do": "drag", "right": random.below(200), "down": random.below(50) }),
            _ => json!({ "do": "resize", "width": side(random), "height": side(random) }),
        });
    }
    for key in ["Escape", "Shift+H", "2"] {
        browser.done(json!({ "do": "press", "key": key }));
    }
    browser.done(json!({ "do": "home" }));
    browser.done(json!({ "do": "settle" }));
    let look = browser.done(json!({ "do": "look" }));
    assert_eq!((&look["hidden"], &look["isolated"]), (&json!([]), &Value::Null));
    assert_eq!(look["sections"], json!([]));
    let Difference { drawables, .. } = difference(&look, scene);
    assert_eq!(drawables, [], "{}, {}", look["eye"], look["frame"]);
    let memory = browser.done(json!({ "do": "memory" }));
    ["scripts", "geometry", "elements"].map(|kind| memory[kind].as_u64().unwrap())
}

/// Reproducible random numbers (Park and Miller 1988).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0 * 48_271 % 0x7fff_ffff;
        self.0 as usize % end
    }
}

/// A page that loses its service keeps its geometry, and reconnects to the service.
#[test]
fn a_page_outlives_its_service() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let before = browser.done(json!({ "do": "look" }));
    let at = service.at.clone();
    drop(service);
    browser.tell(json!({ "do": "drag", "right": 20, "down": 0 }));
    let alone = browser.tell(json!({ "do": "look" }))["answer"].take();
    assert!(alone["drawn"]["drawables"].as_u64().unwrap() > 0, "{}", alone["drawn"]);
    assert_ne!(alone["orientation"], before["orientation"]);
    let _again = Service::start(&bench, &at).unwrap();
    browser.tell(json!({ "do": "settle" }));
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    let Difference { drawables, .. } = difference(&browser.tell(json!({ "do": "look" }))["answer"], &scene);
    assert_eq!(drawables, []);
}

#[test]
fn a_page_walks_on_over_another_network() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    // By a click: its key would give the arrows to the first list in the panel.
    browser.done(json!({ "do": "button", "name": "Status" }));
    // Plain words come first. The figures for support are there once they are opened.
    let plain = (0..600).find_map(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        let figures = browser.done(json!({ "do": "figures" }));
        (figures["Picture"] == "complete and exact").then_some(figures)
    });
    let plain = plain.unwrap_or_else(|| panic!("the status never says that the picture is exact"));
    assert!(plain["Link"].as_str().unwrap().contains("an answer takes"), "{plain}");
    assert!(plain["Scene"].as_str().unwrap().starts_with("plant, "), "{plain}");
    assert_eq!(plain["Service"], service.at, "{plain}");
    assert!(plain.get("wrong pixels").is_none(), "{plain}");
    browser.done(json!({ "do": "tab", "name": "Details for support" }));
    browser.done(json!({ "do": "press", "key": "Enter" }));
    let mut eyes = vec![browser.done(json!({ "do": "look" }))["eye"].take()];
    for (network, round_trip) in [("wan-80ms", 80.0), ("wifi", 0.0), ("none", 0.0)] {
        let choice = json!({ "do": "choose", "label": "Simulated network to the culler", "value": network });
        browser.done(choice);
        let key = if eyes.len() == 2 { "KeyS" } else { "KeyW" };
        browser.done(json!({ "do": "hold", "key": key, "milliseconds": 500 }));
        browser.done(json!({ "do": "settle" }));
        let look = browser.done(json!({ "do": "look" }));
        assert!(look["latency"].as_f64().unwrap() >= round_trip, "{network}: {}", look["latency"]);
        let Difference { drawables, .. } = difference(&look, &scene);
        assert_eq!(drawables, [], "{network}");
        assert_ne!(look["eye"], *eyes.last().unwrap(), "{network}");
        eyes.push(look["eye"].clone());
    }
    // Pictures of a walk are audited: their drawables, and how many are visible.
    let figures = (0..60).find_map(|_| {
        let figures = browser.done(json!({ "do": "figures" }));
        if figures["wrong pixels"] == "none: it is exact" && figures["visible"] != "" {
            return Some(figures);
        }
        browser.done(json!({ "do": "hold", "key": "ArrowLeft", "milliseconds": 500 }));
        browser.done(json!({ "do": "settle" }));
        None
    });
    let figures = figures.unwrap_or_else(|| panic!("no picture of the walk is audited"));
    let counts =
        figures["visible"].as_str().and_then(|text| text.strip_suffix(" drawables")?.split_once(" of "));
    let (visible, drawn) = counts.unwrap_or_else(|| panic!("{figures}"));
    let [visible, drawn] = [visible, drawn].map(|count| count.replace(',', "").parse::<u32>().unwrap());
    assert!(0 < visible && visible <= drawn, "{figures}");
    assert!(figures["ids received"].as_str().unwrap().contains("by 4 bytes each"), "{figures}");
}

/// Two people on one service, one of them with a much wider picture; that one follows the other for a while.
#[test]
fn a_person_follows_another_one() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut first) = Browser::start(300, 300) else { return };
    let mut second = Browser::start(700, 200).unwrap();
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    first.done(json!({ "do": "open", "url": service.url() }));
    first.done(json!({ "do": "settle" }));
    second.done(json!({ "do": "open", "url": service.url() }));
    second.done(json!({ "do": "settle" }));
    let pose = |browser: &mut Browser| {
        let look = browser.done(json!({ "do": "look" }));
        let numbers = |name: &str| look[name].as_array().unwrap().clone();
        let numbers = [numbers("eye"), numbers("orientation")].concat();
        numbers.iter().map(|number| number.as_f64().unwrap()).collect::<Vec<_>>()
    };
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    second.done(json!({ "do": "press", "key": "v" }));
    // The first button waits until it is there.
    second.done(json!({ "do": "button", "name": "Follow" }));
    first.done(json!({ "do": "press", "key": "2" }));
    first.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 700 }));
    first.done(json!({ "do": "drag", "right": 60, "down": 10 }));
    let there = pose(&mut first);
    let is_there = (0..1000).any(|_| far(&pose(&mut second), &there) < 1e-9);
    assert!(is_there, "{:?} is not {there:?}", pose(&mut second));
    second.done(json!({ "do": "settle" }));
    let look = second.done(json!({ "do": "look" }));
    assert_eq!(
        [look["width"].as_u64(), look["height"].as_u64()],
        [Some(450), Some(128)],
        "the leader's pixels"
    );
    let Difference { drawables, .. } = difference(&look, &scene);
    assert_eq!(drawables, [], "at rest it is exact");
    // Using the controls ends following.
    second.done(json!({ "do": "hold", "key": "KeyS", "milliseconds": 300 }));
    let alone = pose(&mut second);
    assert!(far(&alone, &there) > 0.01, "{alone:?}");
    first.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 500 }));
    assert_eq!(pose(&mut second), alone);
}

#[test]
fn a_page_with_a_wrong_token_says_so() {
    let bench = Bench::with_plant(100);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    browser.tell(json!({ "do": "open", "url": service.url().replace(TOKEN, "0123456789abcdef") }));
    let status = loop {
        let status = browser.tell(json!({ "do": "status" }))["answer"].take();
        if status != "" {
            break status;
        }
    };
    assert!(status.as_str().unwrap().contains("token"), "{status}");
}

#[test]
fn a_page_goes_on_with_several_cullers_and_with_two_that_take_turns() {
    let bench = Bench::with_plant(300);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(300, 300) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    let scene = Scene::open(&bench.path("plant.scene")).unwrap();
    // By a click: its key would give the arrows to the first list in the panel.
    browser.done(json!({ "do": "button", "name": "Status" }));
    browser.done(json!({ "do": "tab", "name": "Details for support" }));
    browser.done(json!({ "do": "press", "key": "Enter" }));
    let mut before = browser.done(json!({ "do": "look" }));
    let eye = before["eye"].clone();
    let [x, y, z, w]: [f64; 4] = serde_json::from_value(before["orientation"].clone()).unwrap();
    let forward = [-2.0 * (x * z + w * y), 2.0 * (w * x - y * z), 2.0 * (x * x + y * y) - 1.0];
    let in_turn = "two that take turns, as in the paper";
    for (chosen, count) in [("two, each for itself", 2), (in_turn, 2), ("four", 4), ("one", 1)] {
        browser.done(json!({ "do": "choose", "label": "Cullers", "value": chosen }));
        let expected = json!({ "count": count, "isInTurn": chosen == in_turn });
        for look in 0.. {
            browser.done(json!({ "do": "hold", "key": "ArrowLeft", "milliseconds": 300 }));
            let now = browser.done(json!({ "do": "look" }))["cullers"].take();
            if now == expected {
                break;
            }
            assert!(look < 100, "{chosen}: {now}");
        }
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 700 }));
        browser.done(json!({ "do": "settle" }));
        let turned = browser.done(json!({ "do": "look" }));
        assert_ne!(turned["orientation"], before["orientation"], "{chosen}");
        // A walk ends anywhere. The picture is compared from where it began, once all is there again.
        browser.done(json!({ "do": "stand", "eye": eye, "forward": forward }));
        browser.done(json!({ "do": "settle" }));
        let look = browser.done(json!({ "do": "look" }));
        assert_eq!(look["cullers"], expected, "{chosen}");
        assert!(look["frame"].as_u64() > before["frame"].as_u64(), "{chosen}");
        let Difference { drawables, pixels, .. } = difference(&look, &scene);
        assert_eq!(drawables, [], "{chosen}");
        assert!(pixels < 0.01, "{chosen}: {pixels}");
        before = look;
    }
}
