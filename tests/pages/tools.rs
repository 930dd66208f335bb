//! A person's other actions in a real browser: measuring, picking, cutting, saving views and searching.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::controls::{goes, state};
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// A service of a scene, and a browser that shows it.
fn opened(bench: &Bench, scene: &str) -> Option<(Service, Browser)> {
    let service = Service::of(bench, scene, "127.0.0.1:0")?;
    let mut browser = Browser::start(900, 700)?;
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    Some((service, browser))
}

fn press(browser: &mut Browser, keys: &[&str]) {
    for key in keys {
        browser.done(json!({ "do": "press", "key": key }));
    }
}

/// The text of elements.
fn texts(browser: &mut Browser, selector: &str) -> Vec<String> {
    serde_json::from_value(browser.tell(json!({ "do": "text", "selector": selector }))["answer"].take())
        .unwrap()
}

/// Waits until the text of elements is as expected.
fn said(browser: &mut Browser, selector: &str, holds: impl Fn(&[String]) -> bool) -> Vec<String> {
    let begun = Instant::now();
    loop {
        let texts = texts(browser, selector);
        if holds(&texts) {
            return texts;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{selector}: {texts:?}");
    }
}

/// Clicks where a point of the world is visible, a little beside it.
fn click_at(browser: &mut Browser, point: [f64; 3], keys: &[&str]) {
    let place = browser.tell(json!({ "do": "point", "point": point }))["answer"].take();
    let at = |axis: usize| place[axis].as_f64().unwrap_or_else(|| panic!("{point:?} does not show")).round();
    browser.tell(json!({ "do": "click", "x": at(0) + 1.0, "y": at(1) - 1.0, "keys": keys }));
}

/// Meridians and parallels of a ball.
const ROUND: u32 = 24;

/// A vertex of a ball of 1 m.
fn on_ball(centre: [f64; 3], ring: u32, column: u32) -> [f64; 3] {
    corner(centre, ROUND, ring, column)
}

/// A vertex of a ball with this many meridians.
fn corner([x, y, z]: [f64; 3], round: u32, ring: u32, column: u32) -> [f64; 3] {
    let part = |number: u32, turn: f64| f64::from(number) / f64::from(round) * turn;
    let (up, round) = (part(ring, PI), part(column, TAU));
    [x + up.sin() * round.cos(), y + up.cos(), z + up.sin() * round.sin()]
}

/// Balls of 1 m with this many meridians, as a file has them.
fn balls(round: u32, centres: &[[f64; 3]]) -> String {
    let mut text = String::new();
    for (number, centre) in (0..).zip(centres) {
        writeln!(text, "o ball-{number}").unwrap();
        for ring in 0..=round {
            for column in 0..round {
                let [x, y, z] = corner(*centre, round, ring, column);
                writeln!(text, "v {x:.6} {y:.6} {z:.6}").unwrap();
            }
        }
        let first = number * (round + 1) * round + 1;
        for ring in 0..round {
            for column in 0..round {
                let at = |ring: u32, column: u32| first + ring * round + column % round;
                let [a, b] = [at(ring, column), at(ring, column + 1)];
                let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
                writeln!(text, "f {a} {b} {c}\nf {b} {d} {c}").unwrap();
            }
        }
    }
    text
}

/// Two balls far from the origin of the world, as a plant in its country's coordinates.
const FAR: [[f64; 3]; 2] = [[432_100.123, 7.25, -6_789_012.345], [432_105.678, 7.25, -6_789_012.024]];

fn length([a, b]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// The lengths in the list of distances.
const DISTANCES: &str = "[aria-label=Distances] strong";

#[test]
fn a_distance_is_of_full_detail_whatever_the_picture_shows() {
    let bench = Bench::empty();
    bench.write("balls.obj", balls(2 * ROUND, &FAR));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((service, mut browser)) = opened(&bench, "balls.scene") else { return };
    press(&mut browser, &["2", "m"]);
    let [[left, y, z], [right, ..]] = FAR;
    let whole = u64::from(2 * 2 * (2 * ROUND).pow(2));
    for (count, metres) in (1..).zip([8.0, 12.0, 16.0]) {
        let eye = [(left + right) / 2.0, y + 2.0, z + metres];
        browser.done(json!({ "do": "stand", "eye": eye, "forward": [0.0, -0.05, -1.0] }));
        browser.done(json!({ "do": "settle" }));
        let drawn = state(&mut browser)["drawn"]["triangles"].as_u64().unwrap();
        println!("{metres} m: {drawn} of {whole} triangles");
        assert!(drawn < whole / 2, "{drawn} of {whole} triangles from {metres} m");
        let ends = [on_ball(FAR[0], 9, 6), on_ball(FAR[1], 9 + count, 7)];
        for end in ends {
            click_at(&mut browser, end, &[]);
        }
        let expected = format!("{:.3} m", length(ends));
        said(&mut browser, DISTANCES, |all| {
            all.len() == count as usize && all[count as usize - 1] == expected
        });
    }

    // Without full detail it states its error: two pixels per end.
    drop(service);
    for column in [6, 7] {
        click_at(&mut browser, on_ball(FAR[usize::from(column == 7)], 9, column), &[]);
    }
    let coarse = said(&mut browser, DISTANCES, |all| all.len() == 4).remove(3);
    let (_, error) = coarse.split_once(" ± ").unwrap_or_else(|| panic!("{coarse}"));
    let error: f64 = error.trim_end_matches(" m").parse().unwrap();
    assert!((0.03..0.2).contains(&error), "{coarse}");
}

#[test]
fn what_is_measured_can_be_taken_back_and_copied_in_any_unit() {
    let bench = Bench::empty();
    let near = [[0.0, 2.0, 0.0], [4.0, 2.0, 0.5]];
    bench.write("balls.obj", balls(ROUND, &near));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "balls.scene") else { return };
    press(&mut browser, &["2", "m"]);
    browser.done(json!({ "do": "stand", "eye": [2.0, 2.5, 12.0], "forward": [0.0, 0.0, -1.0] }));
    browser.done(json!({ "do": "settle" }));
    let ends = [on_ball(near[0], 9, 6), on_ball(near[1], 11, 7)];
    let count = |browser: &mut Browser| texts(browser, DISTANCES).len();

    // A click on the background keeps the first point.
    click_at(&mut browser, ends[0], &[]);
    browser.done(json!({ "do": "click", "x": 450, "y": 60 }));
    click_at(&mut browser, ends[1], &[]);
    let expected = format!("{:.3} m", length(ends));
    said(&mut browser, DISTANCES, |all| all == [expected.clone()]);

    // Escape undoes the first point, and Ctrl+Z as well.
    for key in ["Escape", "Control+z"] {
        click_at(&mut browser, ends[0], &[]);
        press(&mut browser, &[key]);
        click_at(&mut browser, ends[1], &[]);
        assert_eq!(count(&mut browser), 1, "{key}: that was a first point again");
        press(&mut browser, &["Escape"]);
    }
    press(&mut browser, &["Control+z"]);
    said(&mut browser, DISTANCES, <[String]>::is_empty);
    press(&mut browser, &["Control+y"]);
    said(&mut browser, DISTANCES, |all| all == [expected.clone()]);
    browser.done(json!({ "do": "label", "name": "Remove distance 1" }));
    said(&mut browser, DISTANCES, <[String]>::is_empty);
    press(&mut browser, &["Control+z"]);
    said(&mut browser, DISTANCES, |all| all == [expected.clone()]);

    let inches = length(ends) / 0.0254;
    let feet = (inches / 12.0).floor();
    let in_units = [
        ("mm", format!("{:.0} mm", 1000.0 * length(ends))),
        ("ft-in", format!("{feet}' {:.2}\"", inches - 12.0 * feet)),
        ("m", expected),
    ];
    for (unit, text) in in_units {
        browser.done(json!({ "do": "choose", "label": "Unit", "value": unit }));
        said(&mut browser, DISTANCES, |all| all == [text.clone()]);
        browser.done(json!({ "do": "label", "name": "Copy distance 1" }));
        said(&mut browser, "[aria-label='Copy distance 1']", |all| all == ["Copied"]);
        assert_eq!(browser.done(json!({ "do": "clipboard" })), json!(text));
        browser.done(json!({ "do": "pass" }));
        said(&mut browser, "[aria-label='Copy distance 1']", |all| all != ["Copied"]);
    }
    // Measuring is over at the second Escape at the latest.
    press(&mut browser, &["Escape", "Escape"]);
    said(&mut browser, DISTANCES, <[String]>::is_empty);
    click_at(&mut browser, on_ball(near[0], 12, 6), &[]);
    said(&mut browser, ".details h2", |all| all == ["ball-0"]);
}

/// Enter takes the point at the crosshair, which shows while the focus of the keyboard is on the picture.
#[test]
fn points_are_measured_by_the_keyboard_alone() {
    let bench = Bench::empty();
    let near = [[0.0, 2.0, 0.0], [4.0, 2.0, 0.5]];
    bench.write("balls.obj", balls(ROUND, &near));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "balls.scene") else { return };
    let kinds = "Two pointsTwo partsPoint to faceAngleArea or diameterPolygon";
    // Right before a point: it is in the middle of the picture.
    let aim = |browser: &mut Browser, [x, y, z]: [f64; 3]| {
        browser.done(json!({ "do": "stand", "eye": [x, y, z + 5.0], "forward": [0.0, 0.0, -1.0] }));
        browser.done(json!({ "do": "settle" }));
    };
    let crosshair = |browser: &mut Browser| {
        let places = browser.done(json!({ "do": "rects", "selector": ".crosshair" }));
        let part = |name: &str| places[0][name].as_f64().unwrap_or_default();
        [part("x").round(), part("y").round(), part("width")]
    };
    press(&mut browser, &["2", "m"]);
    browser.done(json!({ "do": "tab", "name": kinds }));
    assert_eq!(crosshair(&mut browser), [0.0; 3], "the focus is in the panel");
    press(&mut browser, &["Escape"]);
    let [x, y, width] = crosshair(&mut browser);
    assert!([x, y] == [450.0, 350.0] && width > 20.0, "{x} {y} {width}");

    // The sky has no point, and the first one is still to come.
    browser.done(json!({ "do": "stand", "eye": [0.0, 2.0, 8.0], "forward": [0.0, 0.9, 0.4] }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, &["Enter"]);
    said(&mut browser, "#status", |all| all.iter().any(|text| text.contains("nothing at the crosshair")));
    let ends = [on_ball(near[0], 9, 6), on_ball(near[1], 11, 7)];
    for end in ends {
        aim(&mut browser, end);
        press(&mut browser, &["Enter"]);
    }
    let expected = format!("{:.3} m", length(ends));
    said(&mut browser, DISTANCES, |all| all == [expected.clone()]);

    // A polygon: Enter again at the last corner closes it.
    browser.done(json!({ "do": "tab", "name": kinds }));
    press(&mut browser, &["End", "Escape"]);
    let corners = [ends[0], ends[1], on_ball(near[0], 14, 6)];
    for corner in corners {
        aim(&mut browser, corner);
        press(&mut browser, &["Enter"]);
    }
    press(&mut browser, &["Enter"]);
    let [a, b, c] = corners;
    let around = length([a, b]) + length([b, c]) + length([c, a]);
    let perimeter = format!(", perimeter {around:.3} m");
    let findings = "[aria-label='Angles and surfaces'] strong";
    said(&mut browser, findings, |all| all.len() == 1 && all[0].ends_with(&perimeter));

    // Where the panel is closed there is no crosshair, and Enter takes nothing.
    press(&mut browser, &["Escape"]);
    said(&mut browser, DISTANCES, <[String]>::is_empty);
    assert_eq!(crosshair(&mut browser), [0.0; 3]);
}

#[test]
fn clicks_pick_as_on_a_desktop() {
    let bench = Bench::empty();
    let near = [[0.0, 2.0, 0.0], [4.0, 2.0, 0.0], [8.0, 2.0, 0.0]];
    bench.write("balls.obj", balls(ROUND, &near));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "balls.scene") else { return };
    press(&mut browser, &["2"]);
    let stand = |browser: &mut Browser| {
        // Below the panel of details.
        let eye = [4.0, 5.5, 14.0];
        browser.done(json!({ "do": "stand", "eye": eye, "forward": [0.0, 0.0, -1.0] }));
        browser.done(json!({ "do": "settle" }));
    };
    stand(&mut browser);
    let middle = |ball: usize| on_ball(near[ball], 12, 6);
    let click = |browser: &mut Browser, ball: usize, keys: &[&str], selected: &[u32], panel: &[&str]| {
        click_at(browser, middle(ball), keys);
        assert_eq!(state(browser)["selected"], json!(selected), "{ball} {keys:?}");
        said(browser, ".details h2", |all| all == panel);
    };
    // The first pick with Ctrl has a panel like any other, and F frames it.
    click(&mut browser, 0, &["Control"], &[0], &["ball-0"]);
    said(&mut browser, ".details p", |all| all == ["No attributes in the model."]);
    goes(&mut browser, |browser| press(browser, &["f"]));
    stand(&mut browser);
    // The panel shows the remaining picked object.
    click(&mut browser, 1, &["Control"], &[0, 1], &["ball-1"]);
    click(&mut browser, 0, &["Control"], &[1], &["ball-1"]);
    click(&mut browser, 2, &["Control"], &[1, 2], &["ball-2"]);
    click(&mut browser, 2, &["Control"], &[1], &["ball-1"]);
    // Shift adds and never removes; a plain click picks one.
    click(&mut browser, 2, &["Shift"], &[1, 2], &["ball-2"]);
    click(&mut browser, 2, &["Shift"], &[1, 2], &["ball-2"]);
    assert!(texts(&mut browser, ".details p")[0].contains("2 that are picked"));
    browser.done(json!({ "do": "click", "x": 450, "y": 60, "keys": ["Control"] }));
    assert_eq!(state(&mut browser)["selected"], json!([1, 2]), "a click beside with Ctrl loses nothing");
    // F goes to where all of them are seen.
    goes(&mut browser, |browser| press(browser, &["f"]));
    for ball in [1, 2] {
        let place = browser.done(json!({ "do": "point", "point": near[ball] }));
        let at = |axis: usize| place[axis].as_f64().unwrap();
        assert!((0.0..900.0).contains(&at(0)) && (0.0..700.0).contains(&at(1)), "{ball}: {place}");
    }
    stand(&mut browser);
    click(&mut browser, 0, &[], &[0], &["ball-0"]);
    browser.done(json!({ "do": "click", "x": 450, "y": 60 }));
    assert_eq!(state(&mut browser)["selected"], json!([]));
    said(&mut browser, ".details h2", <[String]>::is_empty);
}

/// A box shows where the picked one is: all of them have one colour.
#[test]
fn a_click_picks_one_of_several_objects_that_are_drawn_as_one() {
    let bench = Bench::empty();
    let place = |at: u32| [2.1 * f64::from(at % 20), 0.0, 2.1 * f64::from(at / 20)];
    bench.write("balls.obj", balls(ROUND, &(0..400).map(place).collect::<Vec<_>>()));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "balls.scene") else { return };
    press(&mut browser, &["2"]);
    browser.done(json!({ "do": "stand", "eye": [20.0, 500.0, 20.0], "forward": [0.0, -1.0, -0.001] }));
    browser.done(json!({ "do": "settle" }));
    // The first object of each drawable.
    let drawn = browser.done(json!({ "do": "look" }))["objects"].as_array().unwrap().clone();
    assert!(drawn.len() < 200, "{} drawables show 400 balls", drawn.len());
    let mut boxed = 0;
    for picked in [23_u32, 187, 376] {
        let at = browser.done(json!({ "do": "point", "point": place(picked) }));
        browser.done(json!({ "do": "click", "x": at[0], "y": at[1] }));
        let picks = (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            state(&mut browser)["selected"] == json!([picked])
        });
        assert!(picks, "{picked}: {}", state(&mut browser));
        said(&mut browser, ".details h2", |all| *all == [format!("ball-{picked}")]);
        press(&mut browser, &["Escape"]);
        if drawn.contains(&json!(picked)) {
            continue;
        }
        browser.done(json!({ "do": "click", "x": at[0], "y": at[1] }));
        let edges = json!({ "do": "rects", "selector": ".picked line" });
        let has_box = (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            browser.done(edges.clone()).as_array().unwrap().len() == 12
        });
        assert!(has_box, "{picked}");
        press(&mut browser, &["Escape"]);
        boxed += 1;
    }
    assert!(boxed > 0);
}

#[test]
fn a_cut_is_told_where_its_panel_is_closed_and_show_all_takes_it_away() {
    let bench = Bench::with_plant(100);
    let Some((_service, mut browser)) = opened(&bench, "plant.scene") else { return };
    press(&mut browser, &["b"]);
    browser.done(json!({ "do": "button", "name": "Plane ahead" }));
    press(&mut browser, &["b"]);
    let sign = ".objects span";
    said(&mut browser, sign, |all| all == ["cut by 1 section"]);
    press(&mut browser, &["Shift+H"]);
    assert_eq!(state(&mut browser)["sections"], json!([]));
    said(&mut browser, sign, <[String]>::is_empty);
    press(&mut browser, &["Control+z"]);
    assert_eq!(state(&mut browser)["sections"].as_array().unwrap().len(), 1);
    said(&mut browser, sign, |all| all == ["cut by 1 section"]);
    browser.done(json!({ "do": "button", "name": "Show all" }));
    assert_eq!(state(&mut browser)["sections"], json!([]));
}

#[test]
fn views_and_links_know_their_scene() {
    let bench = Bench::with_plant(100);
    bench.write("balls.obj", balls(ROUND, &[[0.0; 3], [3.0, 0.0, 0.0]]));
    bench.done(&["import", "balls.obj", "-o", "balls.scene"]);
    let Some((service, mut browser)) = opened(&bench, "plant.scene") else { return };
    assert_eq!(browser.done(json!({ "do": "title" })), "plant - Trimaran");
    press(&mut browser, &["v", "3"]);
    let names = ".views li .link";
    let keep = json!({ "do": "button", "name": "Keep this view" });
    browser.done(keep.clone());
    browser.done(keep.clone());
    browser.done(json!({ "do": "label", "name": "Remove View 1" }));
    browser.done(keep);
    said(&mut browser, names, |all| all.iter().map(|name| name.trim()).eq(["View 2", "View 3"]));
    browser.done(json!({ "do": "label", "name": "Rename View 3" }));
    browser.done(json!({ "do": "type", "text": "View 2" }));
    press(&mut browser, &["Enter"]);
    said(&mut browser, names, |all| all.iter().map(|name| name.trim()).eq(["View 2", "View 2 (2)"]));
    browser.done(json!({ "do": "label", "name": "Rename View 2" }));
    browser.done(json!({ "do": "type", "text": "pump" }));
    press(&mut browser, &["Enter"]);
    said(&mut browser, names, |all| all.iter().map(|name| name.trim()).eq(["pump", "View 2 (2)"]));
    assert_eq!(browser.done(json!({ "do": "download", "name": "Save as a file" })), "plant-views.json");

    // A view saved in Orbit comes back in Orbit, with its distances.
    let kept = state(&mut browser);
    browser.done(json!({ "do": "button", "name": "Copy link" }));
    let link = browser.done(json!({ "do": "clipboard" }));
    let link = link.as_str().unwrap();
    press(&mut browser, &["2"]);
    // A busy machine may draw no picture while the key is held.
    let walks = (0..20).any(|_| {
        browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 400 }));
        state(&mut browser)["eye"] != kept["eye"]
    });
    assert!(walks, "the eye stays at {}", kept["eye"]);
    browser.done(json!({ "do": "button", "name": "pump" }));
    let back = state(&mut browser);
    assert_eq!([&back["eye"], &back["mode"]], [&kept["eye"], &json!("orbit")]);

    // The link, entered into the tab that shows the model already.
    press(&mut browser, &["2"]);
    browser.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 400 }));
    browser.done(json!({ "do": "open", "url": link }));
    let begun = Instant::now();
    while state(&mut browser)["eye"] != kept["eye"] {
        assert!(begun.elapsed() < Duration::from_secs(60), "the link is not followed");
    }
    assert_eq!(state(&mut browser)["mode"], "orbit");

    // In another scene neither link nor file is accepted, and the message names their scene.
    let Some(other) = Service::of(&bench, "balls.scene", "127.0.0.1:0") else { return };
    let foreign = link.replace(&service.at, &other.at);
    browser.done(json!({ "do": "open", "url": foreign }));
    browser.done(json!({ "do": "settle" }));
    assert_eq!(browser.done(json!({ "do": "title" })), "balls - Trimaran");
    let both = |all: &[String]| all.iter().any(|text| text.contains("“plant”") && text.contains("“balls”"));
    said(&mut browser, "#status", both);
    let here = state(&mut browser)["eye"].take();
    assert_ne!(here, kept["eye"]);
    press(&mut browser, &["v"]);
    let view = link.split_once("#v=").unwrap().1;
    let open =
        |text: &str| json!({ "do": "file", "selector": ".file-input", "name": "kept.json", "text": text });
    browser.done(open(&json!([{ "name": "pump", "view": view }]).to_string()));
    said(&mut browser, "#status", |all| {
        both(all) && all[0].contains("kept.json") && all[0].contains("“pump”")
    });
    for (wrong, why) in [
        ("{}", "no list of views"),
        ("{", "not JSON"),
        ("[{\"name\":\"a\",\"view\":\"AAAA\"}]", "“a” is damaged"),
    ] {
        browser.done(open(wrong));
        said(&mut browser, "#status", |all| all.iter().any(|text| text.contains(why)));
    }
    assert!(texts(&mut browser, names).is_empty());
    browser.done(json!({ "do": "open", "url": format!("{}#v=AAAA", other.url()) }));
    said(&mut browser, "#status", |all| all.iter().any(|text| text.contains("another version")));
}

#[test]
fn a_search_shows_all_that_it_finds_and_what_is_chosen() {
    let bench = Bench::empty();
    let mut text = String::new();
    for number in 0..250 {
        let x = 2 * number;
        let first = 3 * number + 1;
        writeln!(text, "o /20-CE{number:03}_A\nv {x} 0 0\nv {} 0 0\nv {x} 1 0", x + 1).unwrap();
        writeln!(text, "f {first} {} {}", first + 1, first + 2).unwrap();
    }
    bench.write("tags.obj", text);
    bench.done(&["import", "tags.obj", "-o", "tags.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "tags.scene") else { return };
    let rows = "#found [role=option]";
    let chosen = "#found [aria-selected=true]";

    // Separators are ignored.
    press(&mut browser, &["/"]);
    browser.done(json!({ "do": "type", "text": "20 ce050" }));
    said(&mut browser, rows, |all| all == ["/20-CE050_A"]);

    // All of 250 can be reached; the selected row stays in sight. The text is filled in at once: after single
    // letters, a late answer would select the first row again.
    browser.done(json!({ "do": "fill", "label": "Search names and attributes", "text": "20ce" }));
    said(&mut browser, rows, |all| all.first().is_some_and(|first| first == "/20-CE000_A"));
    let in_sight = json!({ "do": "visible", "selector": chosen, "within": "#found" });
    for step in 1..=60 {
        press(&mut browser, &["ArrowDown"]);
        if step % 20 == 0 {
            assert_eq!(texts(&mut browser, chosen), [format!("/20-CE{step:03}_A")]);
            assert_eq!(browser.done(in_sight.clone()), json!([true]), "{step} steps down");
        }
    }
    browser.done(json!({ "do": "end", "selector": "#found" }));
    said(&mut browser, rows, |all| all.last().is_some_and(|last| last == "/20-CE249_A"));
    press(&mut browser, &["ArrowDown", "ArrowUp"]);
    said(&mut browser, chosen, |all| all == ["/20-CE060_A"]);

    // It closes on a selection, and resumes from there.
    press(&mut browser, &["Enter"]);
    said(&mut browser, ".details h2", |all| all == ["/20-CE060_A"]);
    assert!(texts(&mut browser, rows).is_empty(), "the list is closed");
    press(&mut browser, &["/"]);
    said(&mut browser, chosen, |all| all == ["/20-CE060_A"]);
    assert_eq!(browser.done(in_sight), json!([true]));
    browser.done(json!({ "do": "click", "x": 600, "y": 500 }));
    said(&mut browser, rows, <[String]>::is_empty);

    // Enter need not wait for the list.
    press(&mut browser, &["/"]);
    browser.done(json!({ "do": "type", "text": "ce-249" }));
    press(&mut browser, &["Enter"]);
    said(&mut browser, ".details h2", |all| all == ["/20-CE249_A"]);
    browser.done(json!({ "do": "wait", "milliseconds": 500 }));
    assert!(texts(&mut browser, rows).is_empty(), "an answer that comes late opens no list");
}

/// Names that differ at their ends alone are told apart, however long they are.
#[test]
fn a_long_name_in_the_search_shows_its_end() {
    let bench = Bench::empty();
    let name = |number: u32| format!("/AREA-20-EAST.PIPE-RACK-LEVEL-2.LINE-20-2051PL.BRANCH-{number}");
    let mut text = String::new();
    for number in 0..2_u32 {
        let (x, first) = (2 * number, 3 * number + 1);
        writeln!(text, "o {}\nv {x} 0 0\nv {} 0 0\nv {x} 1 0", name(number), x + 1).unwrap();
        writeln!(text, "f {first} {} {}", first + 1, first + 2).unwrap();
    }
    bench.write("tags.obj", text);
    bench.done(&["import", "tags.obj", "-o", "tags.scene"]);
    let Some((_service, mut browser)) = opened(&bench, "tags.scene") else { return };
    press(&mut browser, &["/"]);
    browser.done(json!({ "do": "type", "text": "branch" }));
    said(&mut browser, "#found [role=option]", |all| all == [name(0), name(1)]);
    let ends = "#found [role=option] span:last-child";
    assert_eq!(texts(&mut browser, ends), ["1PL.BRANCH-0", "1PL.BRANCH-1"]);
    let mut rects = |selector: &str| browser.done(json!({ "do": "rects", "selector": selector }));
    let (rows, ends) = (rects("#found [role=option]"), rects(ends));
    let right = |place: &Value| place["x"].as_f64().unwrap() + place["width"].as_f64().unwrap() / 2.0;
    for row in 0..2 {
        assert!(right(&ends[row]) <= right(&rows[row]), "{} is beyond {}", ends[row], rows[row]);
    }
}
