//! All of a kind in a real browser: queries, commands for all that they find, colours, and kept sets.

use serde_json::{Value, json};

use super::controls::{becomes, goes, look, numbers, press, state};
use crate::common::cubes::cubes;
use crate::common::page::{Browser, Service};
use crate::common::program::Bench;

/// Valves are objects 0 to 149, pipes 150 to 299.
const VALVES: u32 = 150;
const ALL: u32 = 300;
const ROWS: &str = "#found [role=option]";
const SUMMARY: &str = "#found-summary";

/// Where the lower corner of an object is. Each is a box of a metre.
fn corner(object: u32) -> [f64; 3] {
    [f64::from(object % 20) * 2.0 - 20.0, f64::from(object / 20) * 2.0, 0.0]
}

/// Valves in one zone and pipes in another, as glTF with attributes.
fn plant() -> String {
    let mut nodes: Vec<Value> = (0..ALL)
        .map(|object| {
            let (name, kind) = match object {
                0..VALVES => (format!("HV-{}", 1000 + object), "ball valve"),
                _ => (format!("/20-P{object}"), "pipe"),
            };
            let size = format!("{} mm", 50 + 100 * (object % 4));
            let extras = json!({ "Type": kind, "Size": size });
            json!({ "name": name, "mesh": 0, "translation": corner(object), "extras": extras })
        })
        .collect();
    let children = |range: std::ops::Range<u32>| range.collect::<Vec<u32>>();
    nodes
        .push(json!({ "name": "ZONE-1", "children": children(0..VALVES), "extras": { "Status": "in use" } }));
    nodes.push(json!({ "name": "ZONE-2", "children": children(VALVES..ALL) }));
    cubes(&nodes, &[ALL, ALL + 1])
}

fn service(bench: &Bench) -> Option<Service> {
    bench.write("kinds.gltf", plant());
    bench.done(&["import", "kinds.gltf", "-o", "kinds.scene"]);
    Service::of(bench, "kinds.scene", "127.0.0.1:0")
}

/// A browser before the plant, with all of it in sight.
fn before_it(service: &Service, browser: &mut Browser) {
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(browser, "2");
    stand(browser);
}

fn stand(browser: &mut Browser) {
    browser.done(json!({ "do": "stand", "eye": [0.0, 15.0, 45.0], "forward": [0.0, 0.0, -1.0] }));
    look(browser);
}

fn texts(browser: &mut Browser, selector: &str) -> Vec<String> {
    serde_json::from_value(browser.done(json!({ "do": "text", "selector": selector }))).unwrap()
}

/// Waits until the texts of elements are as expected.
fn shows(browser: &mut Browser, selector: &str, is_it: impl Fn(&[String]) -> bool) -> Vec<String> {
    for _ in 0..400 {
        let now = texts(browser, selector);
        if is_it(&now) {
            return now;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
    }
    panic!("{selector}: {:?}", texts(browser, selector))
}

/// Types a query, and waits for its summary.
fn search(browser: &mut Browser, query: &str, summary: &str) {
    press(browser, "Escape");
    press(browser, "/");
    press(browser, "Control+a");
    browser.done(json!({ "do": "type", "text": query }));
    shows(browser, SUMMARY, |all| all == [summary]);
}

fn click(browser: &mut Browser, button: &str) {
    browser.done(json!({ "do": "button", "name": button }));
}

fn range(first: u32, end: u32) -> Value {
    json!((first..end).collect::<Vec<u32>>())
}

/// The colour of the picture at the middle of an object's front.
fn colour(browser: &mut Browser, object: u32) -> Vec<f64> {
    let [x, y, z] = corner(object);
    let place = browser.done(json!({ "do": "point", "point": [x + 0.5, y + 0.5, z + 1.0] }));
    numbers(&browser.done(json!({ "do": "colour", "x": place[0], "y": place[1] })))
}

#[test]
fn all_that_is_found_is_selected_isolated_hidden_and_coloured() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    search(browser, "type = \"ball valve\"", "150 parts, 150 objects");
    click(browser, "Select");
    becomes(browser, "a selection of all", |now| now["selected"] == range(0, VALVES));
    press(browser, "Escape");
    goes(browser, |browser| press(browser, "f"));
    let extent = browser.done(json!({ "do": "extent" }));
    assert!(extent["across"].as_f64().unwrap().max(extent["down"].as_f64().unwrap()) > 0.6, "{extent}");
    stand(browser);
    search(browser, "type = \"ball valve\"", "150 parts, 150 objects");
    click(browser, "Isolate");
    becomes(browser, "only valves", |now| now["isolated"] == range(0, VALVES));
    let drawn = look(browser);
    assert_eq!(drawn["drawn"]["drawables"].as_u64().unwrap(), u64::from(VALVES));
    // Each is a step that can be undone.
    press(browser, "Escape");
    press(browser, "Control+z");
    becomes(browser, "all parts", |now| now["isolated"] == Value::Null);
    search(browser, "zone-1 and size > 150 mm", "74 parts, 74 objects");
    click(browser, "Hide");
    let hidden = becomes(browser, "no large valves", |now| now["hidden"] != json!([]));
    let large: Vec<u32> = (0..VALVES).filter(|object| object % 4 >= 2).collect();
    assert_eq!(hidden["hidden"], json!(large));
    assert_eq!(hidden["selected"], json!([]));
    press(browser, "Escape");
    press(browser, "Control+z");
    becomes(browser, "all parts", |now| now["hidden"] == json!([]));
    // Colours are shading: the same is drawn, and only valves look different.
    look(browser);
    let [valve, pipe] = [3, 203].map(|object| colour(browser, object));
    let before = state(browser);
    search(browser, "ball", "150 parts, 150 objects");
    browser.done(json!({ "do": "label", "name": "Colour indigo" }));
    let after = becomes(browser, "blue valves", |now| now["colouring"]["paints"] != json!([]));
    let expected = json!([{ "label": "ball", "colour": 0x33_2288, "objects": range(0, VALVES) }]);
    assert_eq!((&after["colouring"]["paints"], &after["colouring"]["by"]), (&expected, &json!("")));
    look(browser);
    assert_eq!(colour(browser, 203), pipe);
    let blue = colour(browser, 3);
    assert!(blue[2] > 1.5 * blue[0] && blue[2] > 2.0 * blue[1] && blue != valve, "{blue:?} after {valve:?}");
    assert_eq!(state(browser)["drawn"]["drawables"], before["drawn"]["drawables"]);
    assert_eq!(texts(browser, ".objects span"), ["coloured"]);
    press(browser, "Escape");
    press(browser, "Control+z");
    becomes(browser, "no colours", |now| now["colouring"]["paints"] == json!([]));
    look(browser);
    assert_eq!(colour(browser, 3), valve);
}

#[test]
fn a_list_goes_to_its_end_and_a_table_has_all() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    search(browser, "size:mm", "300 parts, 300 objects");
    shows(browser, ROWS, |all| all.first().is_some_and(|first| first == "HV-1000"));
    browser.done(json!({ "do": "end", "selector": "#found" }));
    let rows = shows(browser, ROWS, |all| all.last().is_some_and(|last| last == "/20-P299"));
    assert!(rows.len() < 60 && !rows.contains(&"…".to_owned()), "only what shows is made: {}", rows.len());
    let csv = browser.done(json!({ "do": "downloaded", "name": "CSV" }));
    let lines: Vec<&str> = csv.as_str().unwrap().lines().collect();
    assert_eq!(lines.len(), 1 + ALL as usize);
    assert_eq!(
        lines[..2],
        ["\u{feff}name,path,level,Size,Type", "HV-1000,kinds.gltf > ZONE-1,primitive,50 mm,ball valve"]
    );
    assert_eq!(lines[300], "/20-P299,kinds.gltf > ZONE-2,primitive,350 mm,pipe");
    // The view goes to the row chosen at the end.
    click(browser, "/20-P299");
    becomes(browser, "a pick", |now| now["selected"] == json!([299]));
    shows(browser, ".details h2", |all| all == ["/20-P299"]);
    press(browser, "/");
    shows(browser, "#found [aria-selected=true]", |all| all == ["/20-P299"]);
}

#[test]
fn a_wrong_query_is_answered_with_what_and_where() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    for (query, place, why) in [
        ("valve size > big", "big", "compares numbers"),
        ("(valve", "(", "never closed"),
        ("größe=5", "größe", "no part has an attribute"),
        ("valve and", "␣", "a condition is missing"),
    ] {
        press(browser, "Escape");
        press(browser, "/");
        press(browser, "Control+a");
        browser.done(json!({ "do": "type", "text": query }));
        shows(browser, SUMMARY, |all| all.len() == 1 && all[0].contains(why));
        assert_eq!(texts(browser, "#found-summary mark"), [place], "{query}");
        assert_eq!(texts(browser, ".found-actions").len() + texts(browser, ROWS).len(), 0, "{query}");
    }
    search(browser, "valve", "150 parts, 150 objects");
    let nothing = "Nothing is found. Search for a name or an attribute, such as 20-CE50 or type=VALV.";
    search(browser, "nowhere", nothing);
}

/// The service goes while a person searches, and comes back. Meanwhile nothing of the last query is offered.
#[test]
fn a_search_without_a_service_is_answered_once_it_is_back() {
    let bench = Bench::empty();
    let Some(gone) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&gone, browser);
    search(browser, "valve", "150 parts, 150 objects");
    shows(browser, ".found-actions", |all| all.len() == 1);
    let at = gone.at.clone();
    drop(gone);
    // From here on requests fail, which browsers count as faults.
    browser.tell(json!({ "do": "press", "key": "Control+a" }));
    browser.tell(json!({ "do": "type", "text": "zone-2" }));
    let mut told = |selector: &str, expected: Value| {
        for _ in 0..400 {
            if browser.tell(json!({ "do": "text", "selector": selector }))["answer"] == expected {
                return;
            }
            browser.tell(json!({ "do": "wait", "milliseconds": 25 }));
        }
        panic!("{selector}: {}", browser.tell(json!({ "do": "text", "selector": selector })));
    };
    told(SUMMARY, json!(["The service does not answer. The search is repeated until it does."]));
    told(ROWS, json!([]));
    told(".found-actions", json!([]));
    let _again = Service::of(&bench, "kinds.scene", &at).unwrap();
    told(SUMMARY, json!(["1 part, 150 objects"]));
    told(ROWS, json!(["ZONE-2"]));
}

/// The keyboard alone: the list, the commands, and back to the picture.
#[test]
fn all_of_a_kind_by_the_keyboard() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    search(browser, "pipe", "150 parts, 150 objects");
    let chosen = "#found [aria-selected=true]";
    let in_sight = json!({ "do": "visible", "selector": chosen, "within": "#found" });
    for (key, steps, name) in
        [("PageDown", 12, "/20-P270"), ("ArrowUp", 2, "/20-P268"), ("PageUp", 1, "/20-P258")]
    {
        for _ in 0..steps {
            press(browser, key);
        }
        shows(browser, chosen, |all| all == [name]);
        assert_eq!(browser.done(in_sight.clone()), json!([true]), "{name}");
    }
    browser.done(json!({ "do": "tab", "name": "Isolate" }));
    press(browser, "Enter");
    becomes(browser, "only pipes", |now| now["isolated"] == range(VALVES, ALL));
    browser.done(json!({ "do": "tab", "name": "Colour green" }));
    press(browser, " ");
    becomes(browser, "green pipes", |now| now["colouring"]["paints"][0]["colour"] == 0x11_7733);
    press(browser, "Escape");
    assert!(texts(browser, ROWS).is_empty(), "the list is closed");
    // The panel of colours: a legend whose entries select.
    press(browser, "y");
    shows(browser, ".colours li", |all| !all.is_empty());
    browser.done(json!({ "do": "tab", "name": "pipe 150" }));
    press(browser, "Enter");
    becomes(browser, "a selection", |now| now["selected"] == range(VALVES, ALL));
    browser.done(json!({ "do": "tab", "name": "Remove colours" }));
    press(browser, "Enter");
    becomes(browser, "no colours", |now| now["colouring"]["paints"] == json!([]));
}

/// The buttons that copy values show where the pointer or the focus is.
#[test]
fn the_value_of_an_attribute_is_copied() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    let copies = |browser: &mut Browser| {
        let targets = browser.done(json!({ "do": "targets" })).as_array().unwrap().clone();
        let names = targets.iter().map(|target| target["name"].as_str().unwrap().to_owned());
        names.filter(|name| name.starts_with("Copy value of ")).collect::<Vec<_>>()
    };
    let copied = |browser: &mut Browser, label: &str, value: &str| {
        shows(browser, &format!("[aria-label='{label}']"), |all| all == ["Copied"]);
        assert_eq!(browser.done(json!({ "do": "clipboard" })), value);
    };
    search(browser, "name=HV-1003", "1 part, 1 object");
    press(browser, "Enter");
    shows(browser, ".details h2", |all| all == ["HV-1003"]);
    assert!(copies(browser).is_empty(), "the table is calm");
    browser.done(json!({ "do": "tab", "name": "Copy value of Size" }));
    assert_eq!(copies(browser), ["Copy value of Size"]);
    press(browser, "Enter");
    copied(browser, "Copy value of Size", "350 mm");
    press(browser, "Escape");
    // With the mouse over its row.
    browser.done(json!({ "do": "label", "name": "Copy value of Type" }));
    assert_eq!(copies(browser), ["Copy value of Type"]);
    copied(browser, "Copy value of Type", "ball valve");

    // A finger has no hover: they show at once, and are large enough.
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    search(browser, "name=HV-1003", "1 part, 1 object");
    press(browser, "Enter");
    shows(browser, ".details h2", |all| all == ["HV-1003"]);
    let all = copies(browser);
    assert!(["Type", "Size"].iter().all(|name| all.contains(&format!("Copy value of {name}"))), "{all:?}");
    browser.done(json!({ "do": "tap", "name": "Copy value of Type", "milliseconds": 60 }));
    copied(browser, "Copy value of Type", "ball valve");
}

#[test]
fn an_attribute_has_colours_with_a_legend_in_links_too() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    press(browser, "y");
    shows(browser, ".colours option", |all| {
        all == ["no attribute", "Size (300)", "Type (300)", "Status (1)"]
    });
    browser.done(json!({ "do": "choose", "label": "Colour by", "value": "Type (300)" }));
    let legend = ".colours [aria-label=Legend] li";
    shows(browser, legend, |all| all == ["ball valve 150", "pipe 150", "all others"]);
    look(browser);
    let [valve, pipe] = [3, 203].map(|object| colour(browser, object));
    assert!(valve[0] > 1.5 * valve[1] && pipe[2] > 1.5 * pipe[0], "rose {valve:?}, indigo {pipe:?}");
    click(browser, "pipe 150");
    becomes(browser, "all pipes", |now| now["selected"] == range(VALVES, ALL));
    press(browser, "Escape");
    press(browser, "Escape");
    // Numbers are a scale.
    browser.done(json!({ "do": "choose", "label": "Colour by", "value": "Size (300)" }));
    let scale = shows(browser, legend, |all| all.len() == 9);
    assert_eq!([&*scale[0], &*scale[7]], ["50 to 87.5 mm 75", "312.5 to 350 mm 75"]);
    look(browser);
    let [least, largest] = [0, 3].map(|object| colour(browser, object));
    assert!(least[2] > least[1] && largest[0] > 1.5 * largest[2], "dark {least:?}, bright {largest:?}");
    // An attribute of a zone is one of all that is in it.
    browser.done(json!({ "do": "choose", "label": "Colour by", "value": "Status (1)" }));
    shows(browser, legend, |all| all == ["in use 150", "all others"]);
    look(browser);
    let grey = colour(browser, 203);
    assert!((grey[0] - grey[2]).abs() < 8.0, "{grey:?}");
    // A link and a kept view have the colours; undo goes back.
    press(browser, "v");
    click(browser, "Copy link");
    let link = browser.done(json!({ "do": "clipboard" }));
    let mut other = Browser::start(900, 700).unwrap();
    other.done(json!({ "do": "open", "url": link }));
    let there = look(&mut other);
    assert_eq!(there["colouring"], state(browser)["colouring"]);
    assert_eq!(colour(&mut other, 203), grey);
    press(browser, "Control+z");
    becomes(browser, "the scale again", |now| now["colouring"]["by"] == "Size");
    press(browser, "Control+z");
    press(browser, "y");
    shows(browser, legend, |all| all == ["ball valve 150", "pipe 150", "all others"]);
    click(browser, "Remove colours");
    shows(browser, legend, <[String]>::is_empty);
}

#[test]
fn a_kept_set_is_found_again_also_from_a_file() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::start(900, 700) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    search(browser, "type:valve size>300", "37 parts, 37 objects");
    click(browser, "Keep");
    press(browser, "Escape");
    press(browser, "v");
    let sets = ".views [aria-label=Sets] .link";
    shows(browser, sets, |all| all == ["type:valve size>300"]);
    browser.done(json!({ "do": "label", "name": "Rename type:valve size>300" }));
    browser.done(json!({ "do": "type", "text": "large valves" }));
    press(browser, "Enter");
    shows(browser, sets, |all| all == ["large valves"]);
    let file = browser.done(json!({ "do": "downloaded", "name": "Save as a file" }));
    // The browser keeps it.
    browser.done(json!({ "do": "reload" }));
    browser.done(json!({ "do": "settle" }));
    press(browser, "v");
    shows(browser, sets, |all| all == ["large valves"]);
    click(browser, "large valves");
    shows(browser, SUMMARY, |all| all == ["37 parts, 37 objects"]);
    assert_eq!(browser.done(json!({ "do": "focused" }))["name"], "Search names and attributes");
    // Another person opens the file.
    let mut other = Browser::start(900, 700).unwrap();
    before_it(&service, &mut other);
    press(&mut other, "v");
    let opened =
        json!({ "do": "file", "selector": ".views .file-input", "name": "views.json", "text": file });
    other.done(opened);
    shows(&mut other, sets, |all| all == ["large valves"]);
    click(&mut other, "large valves");
    shows(&mut other, SUMMARY, |all| all == ["37 parts, 37 objects"]);
    click(&mut other, "Select");
    becomes(&mut other, "all of the set", |now| now["selected"].as_array().unwrap().len() == 37);
}

#[test]
fn a_finger_acts_on_all_of_a_kind() {
    let bench = Bench::empty();
    let Some(service) = service(&bench) else { return };
    let Some(mut browser) = Browser::with_touch(390, 844) else { return };
    let browser = &mut browser;
    before_it(&service, browser);
    let tap = |browser: &mut Browser, name: &str| {
        browser.done(json!({ "do": "tap", "name": name, "milliseconds": 60 }));
    };
    tap(browser, "Search names and attributes");
    browser.done(json!({ "do": "type", "text": "valve" }));
    shows(browser, SUMMARY, |all| all == ["150 parts, 150 objects"]);
    tap(browser, "Colour rose");
    becomes(browser, "rose valves", |now| now["colouring"]["paints"][0]["objects"] == range(0, VALVES));
    tap(browser, "Isolate");
    becomes(browser, "only valves", |now| now["isolated"] == range(0, VALVES));
    browser.done(json!({ "do": "end", "selector": "#found" }));
    shows(browser, ROWS, |all| all.last().is_some_and(|last| last == "HV-1149"));
    // A finger meets each command.
    let targets = browser.done(json!({ "do": "targets" }));
    for name in ["Select", "Isolate", "Hide", "CSV", "Keep", "Colour rose", "Colour purple"] {
        let target = targets.as_array().unwrap().iter().find(|one| one["name"] == name).unwrap();
        assert!(target["isMet"] == true && target["height"].as_f64().unwrap() >= 44.0, "{target}");
    }
    tap(browser, "HV-1149");
    becomes(browser, "a pick", |now| now["selected"] == json!([149]));
    tap(browser, "Colours");
    tap(browser, "valve 150");
    becomes(browser, "all valves", |now| now["selected"] == range(0, VALVES));
}
