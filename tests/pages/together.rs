//! Several people on one service: where they are, calls to the others, and views that are taken over.

use serde_json::{Value, json};

use super::controls::{ROOM, becomes, boxes, look, number, numbers, press, said, state};
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// Two browsers on a service of three boxes, of people who fly.
fn two(bench: &Bench) -> Option<(Service, Browser, Browser)> {
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let service = Service::of(bench, "boxes.scene", "127.0.0.1:0")?;
    let (mut first, mut second) = (Browser::start(900, 600)?, Browser::start(900, 600)?);
    for browser in [&mut first, &mut second] {
        browser.done(json!({ "do": "open", "url": service.url() }));
        browser.done(json!({ "do": "settle" }));
        press(browser, "2");
        // The list of people, once there are any.
        press(browser, "v");
    }
    Some((service, first, second))
}

fn stand(browser: &mut Browser, eye: [f64; 3], forward: [f64; 3]) {
    browser.done(json!({ "do": "stand", "eye": eye, "forward": forward }));
    look(browser);
}

/// The places of elements, once they are as expected.
fn places(browser: &mut Browser, selector: &str, is_it: impl Fn(&[Value]) -> bool) -> Vec<Value> {
    for _ in 0..600 {
        let told = browser.done(json!({ "do": "rects", "selector": selector }));
        let told = told.as_array().unwrap().clone();
        if is_it(&told) {
            return told;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("{selector}: {}", browser.done(json!({ "do": "rects", "selector": selector })))
}

#[test]
fn a_marker_shows_where_somebody_is_and_the_model_hides_it() {
    let bench = Bench::empty();
    let Some((_service, mut first, mut second)) = two(&bench) else { return };
    // Before the left box, in the middle of the picture of an eye farther back.
    stand(&mut first, [-2.5, 0.6, -1.0], [0.0, 0.0, -1.0]);
    stand(&mut second, [-2.5, 0.6, 6.0], [0.0, 0.0, -1.0]);
    let marker = ".people [data-person=\"1\"]";
    let circle = format!("{marker} circle");
    let is_at = |x: f64| move |all: &[Value]| all.len() == 1 && (number(&all[0]["x"]) - x).abs() < 3.0;
    places(&mut second, &circle, is_at(450.0));
    let name = second.done(json!({ "do": "text", "selector": format!("{marker} text") }));
    assert_eq!(name, json!(["Person 1"]));
    // It follows: a metre to the right, at seven metres.
    let expected = second.done(json!({ "do": "point", "point": [-1.5, 0.6, -1.0] }));
    stand(&mut first, [-1.5, 0.6, -1.0], [0.0, 0.0, -1.0]);
    places(&mut second, &circle, is_at(number(&expected[0])));
    // Behind the box nothing shows, and beside it again.
    stand(&mut first, [-2.5, 0.6, -6.0], [0.0, 0.0, -1.0]);
    places(&mut second, &circle, <[Value]>::is_empty);
    stand(&mut first, [-4.0, 0.6, -6.0], [0.0, 0.0, -1.0]);
    places(&mut second, &circle, |all| all.len() == 1);
    // Behind the eye there is none.
    stand(&mut first, [-2.5, 0.6, 9.0], [0.0, 0.0, -1.0]);
    places(&mut second, &circle, <[Value]>::is_empty);
}

#[test]
fn all_are_asked_to_come_and_nobody_is_moved() {
    let bench = Bench::empty();
    let Some((_service, mut first, mut second)) = two(&bench) else { return };
    let there = [3.0, 2.0, 5.0];
    stand(&mut first, there, [0.0, -0.2, -1.0]);
    let before = look(&mut second)["eye"].take();
    first.done(json!({ "do": "button", "name": "Bring all here" }));
    said(&mut second, |text| text.contains("Person 1 asks you to come"));
    assert_eq!(state(&mut second)["eye"], before, "it is up to the person");
    second.done(json!({ "do": "button", "name": "Go there" }));
    becomes(&mut second, "coming", |now| {
        numbers(&now["eye"]).iter().zip(there).all(|(a, b)| (a - b).abs() < 1e-6)
    });
    // There is a way back, and the call is told once.
    press(&mut second, "Alt+ArrowLeft");
    becomes(&mut second, "the place before", |now| now["eye"] == before);
    second.done(json!({ "do": "wait", "milliseconds": 1000 }));
    let status = second.done(json!({ "do": "status" }));
    assert!(!status.as_str().unwrap().contains("asks you"), "{status}");
    assert_eq!(numbers(&state(&mut first)["eye"]), there);
    // A page that is left leaves the others at once: nobody is silent for a minute and a half here.
    let people = json!({ "do": "text", "selector": "li .link" });
    assert_eq!(first.done(people.clone()), json!(["Person 2"]));
    second.tell(json!({ "do": "open", "url": "about:blank" }));
    assert!((0..200).any(|_| {
        first.done(json!({ "do": "wait", "milliseconds": 50 }));
        first.done(people.clone()) == json!([])
    }));
}

#[test]
fn a_part_that_is_pointed_out_is_marked_for_all_with_its_name() {
    let bench = Bench::empty();
    let Some((_service, mut first, mut second)) = two(&bench) else { return };
    stand(&mut first, [2.5, 1.5, 2.0], [0.0, -0.2, -1.0]);
    stand(&mut second, [0.0, 3.0, 8.0], [0.0, -0.2, -1.0]);
    let middle = first.done(json!({ "do": "point", "point": [2.5, 0.5, -3.0] }));
    first.done(json!({ "do": "click", "x": middle[0], "y": middle[1] }));
    becomes(&mut first, "a pick", |now| now["selected"] == json!([2]));
    // By keys: the button waits for the details of the pick.
    let name = json!({ "do": "text", "selector": ".details h2" });
    assert!((0..400).any(|_| first.done(name.clone()) == json!(["box2"])));
    first.done(json!({ "do": "tab", "name": "Point it out" }));
    press(&mut first, "Enter");
    let expected = second.done(json!({ "do": "point", "point": [2.5, 0.5, -3.5] }));
    for browser in [&mut first, &mut second] {
        places(browser, ".pointed", |all| !all.is_empty());
        assert_eq!(browser.done(json!({ "do": "text", "selector": ".pointed text" })), json!(["box2"]));
    }
    let ring = places(&mut second, ".pointed circle:not(.pulse)", |all| !all.is_empty());
    let off = |axis: usize, name: &str| (number(&ring[0][name]) - number(&expected[axis])).abs();
    assert!(off(0, "x") < 2.0 && off(1, "y") < 2.0, "{ring:?} {expected}");
    said(&mut second, |text| text.contains("Person 1 points at box2"));
    second.done(json!({ "do": "button", "name": "Go there" }));
    becomes(&mut second, "going there", |now| number(&now["eye"][0]) > 0.5);
    // The mark goes by itself.
    for browser in [&mut first, &mut second] {
        browser.done(json!({ "do": "pass" }));
        places(browser, ".pointed", <[Value]>::is_empty);
    }
}

#[test]
fn following_is_told_where_the_views_are_closed() {
    let bench = Bench::empty();
    let Some((_service, _first, mut second)) = two(&bench) else { return };
    // A click on the name follows.
    second.done(json!({ "do": "button", "name": "Person 1" }));
    let follow = |pressed: bool| format!("[aria-label=People] [aria-pressed={pressed}]");
    places(&mut second, &follow(true), |all| all.len() == 1);
    places(&mut second, ".following", <[Value]>::is_empty);
    second.done(json!({ "do": "button", "name": "Views" }));
    places(&mut second, ".following", |all| all.len() == 1);
    let told = second.done(json!({ "do": "text", "selector": ".following span" }));
    assert_eq!(told, json!(["Following Person 1"]));
    second.done(json!({ "do": "button", "name": "Stop" }));
    places(&mut second, ".following", <[Value]>::is_empty);
    second.done(json!({ "do": "button", "name": "Views" }));
    places(&mut second, &follow(false), |all| all.len() == 1);
}

#[test]
fn what_a_followed_person_hides_and_cuts_shows_and_can_be_taken_over() {
    let bench = Bench::empty();
    let Some((_service, mut first, mut second)) = two(&bench) else { return };
    stand(&mut first, [0.0, 3.0, 8.0], [0.0, -0.2, -1.0]);
    second.done(json!({ "do": "button", "name": "Follow" }));
    let middle = first.done(json!({ "do": "point", "point": [2.5, 0.5, -3.0] }));
    first.done(json!({ "do": "click", "x": middle[0], "y": middle[1] }));
    becomes(&mut first, "a pick", |now| now["selected"] == json!([2]));
    press(&mut first, "h");
    press(&mut first, "b");
    first.done(json!({ "do": "button", "name": "Plane ahead" }));
    let theirs = look(&mut first);
    assert_eq!(theirs["hidden"], json!([2]));
    // The follower sees neither the box nor what is cut away, and has changed nothing.
    let sees = |browser: &mut Browser| {
        let look = browser.done(json!({ "do": "look" }));
        let mut objects: Vec<u64> = serde_json::from_value(look["objects"].clone()).unwrap();
        objects.sort_unstable();
        objects.dedup();
        objects
    };
    let cut = sees(&mut first);
    assert!(!cut.contains(&2), "{cut:?}");
    let follows = (0..400).any(|_| {
        second.done(json!({ "do": "wait", "milliseconds": 50 }));
        sees(&mut second) == cut
    });
    let status = second.done(json!({ "do": "status" }));
    assert!(follows, "{status}: {:?}, not {cut:?}, at {}", sees(&mut second), state(&mut second));
    let own = state(&mut second);
    assert_eq!([&own["hidden"], &own["sections"]], [&json!([]), &json!([])]);
    second.done(json!({ "do": "settle" }));
    second.done(json!({ "do": "button", "name": "Go on from here" }));
    let taken = look(&mut second);
    assert_eq!([&taken["hidden"], &taken["sections"]], [&theirs["hidden"], &theirs["sections"]]);
    assert_eq!(sees(&mut second), cut);
    // One step of the history, and theirs goes on without it.
    press(&mut second, "Control+z");
    assert_eq!(look(&mut second)["hidden"], json!([]));
    first.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 300 }));
    second.done(json!({ "do": "wait", "milliseconds": 500 }));
    assert_eq!(look(&mut second)["eye"], taken["eye"], "it follows no more");
}
