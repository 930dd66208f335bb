//! Saved and printed pictures, and the colours of the panels, in a real browser.

use std::ops::Range;
use std::path::Path;

use image::RgbImage;
use serde_json::{Value, json};

use super::controls::{ROOM, becomes, boxes, goes, look, number, numbers, opened, press};
use crate::common::page::{Browser, Service, items};
use crate::common::program::Bench;

/// Opens the dialog for pictures.
fn open_dialog(browser: &mut Browser) {
    browser.done(json!({ "do": "button", "name": "Picture" }));
    let shown = json!({ "do": "rects", "selector": "dialog.picture" });
    let is_there = (0..400).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(shown.clone())[0]["width"].as_f64().is_some_and(|width| width > 0.0)
    });
    assert!(is_there, "there is no dialog");
}

fn close_dialog(browser: &mut Browser) {
    browser.done(json!({ "do": "button", "name": "Close" }));
    let shown = json!({ "do": "rects", "selector": "dialog.picture" });
    assert!((0..400).any(|_| browser.done(shown.clone()) == json!([])), "the dialog stays");
}

/// Saves the picture of a model that the dialog describes.
fn save(browser: &mut Browser, model: &str, to: &Path) -> RgbImage {
    let name = browser.done(json!({ "do": "download", "name": "Save the picture", "path": to }));
    assert_eq!(name, format!("{model}.png"));
    image::open(to).unwrap().to_rgb8()
}

/// The share of the pixels within the first `rows` that differ by more than a few tones.
fn differing(one: &RgbImage, other: &RgbImage, rows: u32) -> f64 {
    assert_eq!(one.width(), other.width());
    let is_off = |x, y| {
        let (a, b) = (one.get_pixel(x, y).0, other.get_pixel(x, y).0);
        a.iter().zip(b).any(|(a, b)| a.abs_diff(b) > 12)
    };
    let all = (0..rows).flat_map(|y| (0..one.width()).map(move |x| (x, y)));
    let count = all.filter(|&(x, y)| is_off(x, y)).count();
    count as f64 / f64::from(one.width() * rows)
}

/// A large picture from a small screen is the one that a large screen shows, with the same levels of detail.
#[test]
fn a_picture_of_any_size_is_as_exact_as_the_screens_own() {
    let bench = Bench::with_plant(400);
    let Some(service) = Service::start(&bench, "127.0.0.1:0") else { return };
    let Some(mut small) = Browser::start(400, 225) else { return };
    let mut large = Browser::start(800, 450).unwrap();
    for browser in [&mut small, &mut large] {
        browser.done(json!({ "do": "open", "url": service.url() }));
        browser.done(json!({ "do": "settle" }));
        press(browser, "2");
    }
    // Until that key an eye falls a little, and one page may have been longer in coming to it.
    let here = look(&mut small);
    let [x, y, z, w]: [f64; 4] = serde_json::from_value(here["orientation"].clone()).unwrap();
    let forward = [-2.0 * (x * z + w * y), 2.0 * (w * x - y * z), 2.0 * (x * x + y * y) - 1.0];
    for browser in [&mut small, &mut large] {
        browser.done(json!({ "do": "stand", "eye": here["eye"], "forward": forward }));
    }
    let pose = look(&mut small);
    assert_eq!(look(&mut large)["eye"], pose["eye"]);
    // A picture of the screen is what the screen shows.
    press(&mut large, "v");
    open_dialog(&mut large);
    large.done(json!({ "do": "label", "name": "Caption" }));
    let screens = save(&mut large, "plant", &bench.path("screen.png"));
    assert_eq!(screens.dimensions(), (800, 450));
    close_dialog(&mut large);
    let shot = bench.path("shot.png");
    press(&mut large, "v");
    large.done(json!({ "do": "refine" }));
    large.done(json!({ "do": "picture", "path": shot }));
    let shot = image::open(&shot).unwrap().to_rgb8();
    // In the middle of the screen no panel is over the model.
    let middle = |image: &RgbImage| image::imageops::crop_imm(image, 375, 125, 200, 200).to_image();
    let off = differing(&middle(&screens), &middle(&shot), 200);
    assert!(off < 2e-3, "{:.3} % of the screen's pixels are others in its picture", 100.0 * off);

    press(&mut small, "v");
    open_dialog(&mut small);
    small.done(json!({ "do": "label", "name": "Caption" }));
    small.done(json!({ "do": "choose", "label": "Size", "value": "other" }));
    for (label, pixels) in [("Width in pixels", "800"), ("Height in pixels", "450")] {
        small.done(json!({ "do": "fill", "label": label, "text": pixels }));
        press(&mut small, "Tab");
    }
    let own = save(&mut small, "plant", &bench.path("own.png"));
    assert_eq!(own.dimensions(), (800, 450));
    let off = differing(&own, &screens, 450);
    println!("{:.4} % of the pixels differ", 100.0 * off);
    assert!(off < 5e-4, "{:.3} % of the pixels are others than on a large screen", 100.0 * off);

    // One of the list, with a caption: below the picture, within the file.
    small.done(json!({ "do": "choose", "label": "Size", "value": "1920 x 1080" }));
    small.done(json!({ "do": "label", "name": "Caption" }));
    let listed = save(&mut small, "plant", &bench.path("listed.png"));
    assert_eq!(listed.dimensions(), (1920, 1080));
    let strip = |y: u32| (0..1920).filter(|&x| listed.get_pixel(x, y).0 == [255; 3]).count();
    assert!(strip(1034) > 1900 && strip(1030) < 500, "{} {}", strip(1034), strip(1030));
    assert!((1036..1078).any(|y| strip(y) < 1750), "the caption has texts");
    // It shows a little more at the sides, and the middle in finer pixels.
    let scale = 1032.0 / 450.0;
    let (width, left) = ((800.0 * scale) as u32, ((1920.0 - 800.0 * scale) / 2.0) as u32);
    let middle = image::imageops::crop_imm(&listed, left, 0, width, 1032).to_image();
    let reduced = image::imageops::resize(&middle, 800, 450, image::imageops::FilterType::Triangle);
    let off = differing(&reduced, &screens, 450);
    assert!(off < 0.1, "{:.1} % of the pixels are others than on a large screen", 100.0 * off);
    close_dialog(&mut small);
    // Nothing has moved, and the page culls for its screen again.
    let after = look(&mut small);
    assert_eq!([&after["eye"], &after["orientation"]], [&pose["eye"], &pose["orientation"]]);
    press(&mut small, "v");
    small.done(json!({ "do": "hold", "key": "KeyW", "milliseconds": 300 }));
    becomes(&mut small, "a walk", |now| now["eye"] != pose["eye"]);
    small.done(json!({ "do": "settle" }));
}

/// How many pixels of a part of a picture are such.
fn count(image: &RgbImage, across: Range<u32>, down: Range<u32>, is_such: impl Fn([u8; 3]) -> bool) -> usize {
    let all = down.flat_map(|y| across.clone().map(move |x| (x, y)));
    all.filter(|&(x, y)| is_such(image.get_pixel(x, y).0)).count()
}

#[test]
fn a_saved_picture_has_its_dimensions_and_a_plan_has_its_north() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [1000, 800]) else { return };
    let stand = |browser: &mut Browser, eye: [f64; 3], forward: [f64; 3]| {
        browser.done(json!({ "do": "stand", "eye": eye, "forward": forward }));
        look(browser);
    };
    press(&mut browser, "2");
    press(&mut browser, "m");
    stand(&mut browser, [0.0, 3.0, 4.0], [0.0, -0.35, -1.0]);
    // Between the upper corners of both boxes.
    let mut ends = Vec::new();
    for corner in [[-2.0_f64, 1.0, -3.0], [2.0, 1.0, -3.0]] {
        let place = numbers(&browser.done(json!({ "do": "point", "point": corner })));
        let inwards = 2.0 * corner[0].signum();
        browser.done(json!({ "do": "click", "x": place[0].round() + inwards, "y": place[1].round() + 2.0 }));
        ends.push([place[0], place[1]]);
    }
    let listed = json!({ "do": "text", "selector": "[aria-label=Distances] strong" });
    let is_measured = (0..600).any(|_| {
        browser.done(json!({ "do": "wait", "milliseconds": 25 }));
        browser.done(listed.clone()) == json!(["4.000 m"])
    });
    assert!(is_measured, "{}", browser.done(listed));
    press(&mut browser, "v");
    open_dialog(&mut browser);
    browser.done(json!({ "do": "label", "name": "Caption" }));
    let with = save(&mut browser, "boxes", &bench.path("with.png"));
    browser.done(json!({ "do": "choose", "label": "Size", "value": "1920 x 1080" }));
    let large = save(&mut browser, "boxes", &bench.path("large.png"));
    browser.done(json!({ "do": "choose", "label": "Size", "value": "the screen's, 1000 x 800" }));
    browser.done(json!({ "do": "label", "name": "Dimensions" }));
    let without = save(&mut browser, "boxes", &bench.path("without.png"));
    assert_eq!((with.dimensions(), without.dimensions()), ((1000, 800), (1000, 800)));
    // The line at its first quarter, and the plate above its middle.
    let at = |share: f64| [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
    let is_ink = |pixel: [u8; 3]| pixel.iter().all(|&tone| tone < 100);
    let thickness = |image: &RgbImage, [x, y]: [f64; 2], reach: u32| {
        let (x, y) = (x.round() as u32, y.round() as u32);
        count(image, x..x + 1, y - reach..y + reach, is_ink)
    };
    let quarter = at(0.25);
    let own = thickness(&with, quarter, 8);
    assert!((1..=3).contains(&own), "{own} pixels of ink at {quarter:?}");
    assert_eq!(thickness(&without, quarter, 8), 0);
    // In a larger picture it is thicker. The middle stays, and a pixel of the screen is 1.35 of it.
    let scaled = [960.0 + 1.35 * (quarter[0] - 500.0), 540.0 + 1.35 * (quarter[1] - 400.0)];
    let finer = thickness(&large, scaled, 12);
    assert!((2..=4).contains(&finer), "{finer} pixels of ink at {scaled:?}");
    let [x, y] = at(0.5).map(|place| place.round() as u32);
    let white = |image: &RgbImage| count(image, x - 20..x + 20, y - 21..y - 6, |pixel| pixel == [255; 3]);
    assert!(white(&with) > 150 && white(&without) < 20, "{} {}", white(&with), white(&without));
    assert!(count(&with, x - 20..x + 20, y - 21..y - 6, is_ink) > 30, "the length is on the plate");
    close_dialog(&mut browser);

    // One end is behind the eye: nothing is drawn.
    stand(&mut browser, [0.0, 3.0, -3.5], [1.0, -0.3, 0.0]);
    open_dialog(&mut browser);
    browser.done(json!({ "do": "label", "name": "Caption" }));
    let behind = save(&mut browser, "boxes", &bench.path("behind.png"));
    browser.done(json!({ "do": "label", "name": "Dimensions" }));
    let plain = save(&mut browser, "boxes", &bench.path("plain.png"));
    assert!(differing(&behind, &plain, 800) < 1e-3);
    close_dialog(&mut browser);

    // A plan has north at its top: the head of the arrow is in the upper half of the caption. From the south
    // one looks along it.
    for (key, has_arrow) in [("8", true), ("4", false)] {
        goes(&mut browser, |browser| press(browser, key));
        open_dialog(&mut browser);
        let saved = save(&mut browser, "boxes", &bench.path("north.png"));
        close_dialog(&mut browser);
        assert_eq!(saved.dimensions(), (1000, 828));
        let dark = |across: Range<u32>, down: Range<u32>| {
            count(&saved, across, down, |pixel| pixel.iter().all(|&tone| tone < 160))
        };
        let (upper, lower, letter) =
            (dark(970..999, 801..813), dark(970..999, 816..827), dark(957..970, 805..823));
        if has_arrow {
            assert!(upper > 30 && (5..upper / 2).contains(&lower) && letter > 5, "{upper} {lower} {letter}");
        } else {
            assert_eq!((upper, lower, letter), (0, 0, 0));
        }
    }

    // The person's own text is in the caption, also of the next picture.
    let letters = |image: &RgbImage| count(image, 0..600, 800..828, |pixel| pixel[0] < 200);
    let plain = letters(&image::open(bench.path("north.png")).unwrap().to_rgb8());
    open_dialog(&mut browser);
    browser.done(json!({ "do": "fill", "label": "Text in the caption", "text": "For the review" }));
    let worded = letters(&save(&mut browser, "boxes", &bench.path("worded.png")));
    assert!(plain > 50 && worded > plain + 100, "{plain} and {worded} pixels of letters");
    close_dialog(&mut browser);
    open_dialog(&mut browser);
    assert_eq!(letters(&save(&mut browser, "boxes", &bench.path("again.png"))), worded);
    close_dialog(&mut browser);
}

/// A service that culls for pictures of at most 1000x800 pixels.
fn small_pictures(bench: &Bench) -> Option<Service> {
    let mut command = bench.command(&["serve", "plant.scene", "--listen", "127.0.0.1:0"]);
    command.args(["--token", crate::common::page::TOKEN, "--max-picture", "1000x800"]);
    Service::by(command)
}

/// By keys alone: what is not possible is told, and pictures can be given up.
#[test]
fn a_picture_that_is_too_large_is_refused_and_one_that_is_made_can_be_stopped() {
    let bench = Bench::with_plant(100);
    let Some(service) = small_pictures(&bench) else { return };
    let Some(mut browser) = Browser::start(500, 400) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "v");
    browser.done(json!({ "do": "tab", "name": "Picture" }));
    press(&mut browser, "Enter");
    browser.done(json!({ "do": "choose", "label": "Size", "value": "3840 x 2160" }));
    browser.done(json!({ "do": "tab", "name": "Save the picture" }));
    press(&mut browser, " ");
    let alert = |browser: &mut Browser| {
        browser.done(json!({ "do": "text", "selector": "dialog.picture [role=alert]" }))[0].take()
    };
    let told = (0..400).map(|_| alert(&mut browser)).find(|told| told.is_string()).unwrap();
    let told = told.as_str().unwrap();
    assert!(told.contains("3840 x 2064 pixels") && told.contains("64 to 992 pixels wide"), "{told}");
    // The service goes away during a picture.
    browser.done(json!({ "do": "choose", "label": "Size", "value": "the screen's, 500 x 400" }));
    drop(service);
    browser.tell(json!({ "do": "tab", "name": "Save the picture" }));
    browser.tell(json!({ "do": "press", "key": "Enter" }));
    let told = (0..600).find_map(|_| {
        browser.tell(json!({ "do": "wait", "milliseconds": 50 }));
        let told = browser.tell(json!({ "do": "text", "selector": "dialog.picture [role=alert]" }));
        let told = told["answer"][0].as_str()?.to_owned();
        (!told.contains("3840")).then_some(told)
    });
    let told = told.unwrap();
    assert!(told.starts_with("There is no picture:"), "{told}");
    // Escape leaves the dialog, and the keys are for the model again.
    browser.tell(json!({ "do": "press", "key": "Escape" }));
    let shown = json!({ "do": "rects", "selector": "dialog.picture" });
    assert!((0..400).any(|_| browser.tell(shown.clone())["answer"] == json!([])), "the dialog stays");
}

#[test]
fn a_picture_is_printed_alone_on_one_page() {
    let bench = Bench::with_plant(100);
    // Paper has 300 dots an inch where the service culls for so many: here it has fewer, which is faster.
    let Some(service) = small_pictures(&bench) else { return };
    let Some(mut browser) = Browser::start(500, 400) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "v");
    open_dialog(&mut browser);
    // Landscape, in points of a 72nd of an inch.
    let papers = [("A4, landscape", 842.0, 595.0), ("A3, landscape", 1191.0, 842.0)];
    for (times, (paper, width, height)) in (1..).zip(papers) {
        browser.done(json!({ "do": "choose", "label": "Paper", "value": paper }));
        browser.done(json!({ "do": "button", "name": "Print" }));
        let pages = browser.done(json!({ "do": "paper", "times": times }));
        let pages = pages.as_array().unwrap();
        assert_eq!(pages.len(), 1, "{paper}: {pages:?}");
        let side = |axis: usize| number(&pages[0][axis]);
        assert!((side(0) - width).abs() < 2.0 && (side(1) - height).abs() < 2.0, "{paper}: {pages:?}");
    }
    close_dialog(&mut browser);
    let is_alone = |browser: &mut Browser, what: &str| {
        let pages = browser.done(json!({ "do": "paper", "times": 3 }));
        let pages = pages.as_array().unwrap();
        assert_eq!(pages.len(), 1, "{what}: {pages:?}");
        let [width, height] = [0, 1].map(|axis| number(&pages[0][axis]));
        assert!((width - 842.0).abs() < 2.0 && (height - 595.0).abs() < 2.0, "{what}: {pages:?}");
        assert_eq!(browser.done(json!({ "do": "rects", "selector": ".sheet" })), json!([]), "{what}");
    };
    assert_eq!(browser.done(json!({ "do": "rects", "selector": ".sheet" })), json!([]));
    // The browser's key prints the same picture without the dialog.
    press(&mut browser, "Control+p");
    let size = browser.done(json!({ "do": "image", "selector": ".sheet img" }));
    assert!(number(&size[0]) > 900.0, "finer than the screen: {size}");
    is_alone(&mut browser, "by the key");
    // Its menu asks nobody: the picture is that of the screen, without the panels.
    is_alone(&mut browser, "by the menu");
}

/// The lowest contrast of a text in the page.
fn lowest(browser: &mut Browser, what: &str) -> usize {
    let all = browser.done(json!({ "do": "contrasts" }));
    let all = all.as_array().unwrap();
    for text in all {
        assert!(number(&text["ratio"]) >= 4.5, "{what}: {text}");
    }
    all.len()
}

#[test]
fn texts_can_be_read_in_light_and_in_dark_panels_and_the_model_stays_as_it_is() {
    let bench = Bench::empty();
    let Some((_service, mut browser)) = opened(&bench, &ROOM, [900, 700]) else { return };
    let theme = |browser: &mut Browser| browser.done(json!({ "do": "theme" }));
    // The browser tells a page in its next frame.
    let follows = |browser: &mut Browser, scheme: &str| {
        (0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            theme(browser) == scheme
        })
    };
    press(&mut browser, "0");
    look(&mut browser);
    let place = browser.done(json!({ "do": "point", "point": [-2.5, 1.0, -3.5] }));
    let mut pictures: Vec<Value> = Vec::new();
    for scheme in ["light", "dark"] {
        browser.done(json!({ "do": "prefer", "scheme": scheme }));
        assert!(follows(&mut browser, scheme), "as the system prefers: {scheme}");
        // Without a selection some buttons cannot be used.
        let mut texts = lowest(&mut browser, scheme);
        look(&mut browser);
        pictures.push(browser.done(json!({ "do": "pixels" })));
        browser.done(json!({ "do": "click", "x": place[0], "y": place[1] }));
        becomes(&mut browser, "a pick", |now| now["selected"] == json!([1]));
        for panel in ["t", "b", "m", "j", "y", "n", "o", "v", "p"] {
            press(&mut browser, panel);
            browser.done(json!({ "do": "wait", "milliseconds": 300 }));
            if panel == "p" {
                browser.done(json!({ "do": "tab", "name": "Details for support" }));
                press(&mut browser, "Enter");
                browser.done(json!({ "do": "wait", "milliseconds": 300 }));
            }
            texts += lowest(&mut browser, &format!("{scheme}, panel {panel}"));
            press(&mut browser, panel);
        }
        press(&mut browser, "v");
        open_dialog(&mut browser);
        texts += lowest(&mut browser, &format!("{scheme}, pictures"));
        close_dialog(&mut browser);
        browser.done(json!({ "do": "label", "name": "Keys" }));
        let groups = json!({ "do": "text", "selector": ".keys h2" });
        assert!((0..400).any(|_| {
            browser.done(json!({ "do": "wait", "milliseconds": 25 }));
            browser.done(groups.clone()) != json!([])
        }));
        texts += lowest(&mut browser, &format!("{scheme}, keys"));
        browser.done(json!({ "do": "button", "name": "Close" }));
        browser.done(json!({ "do": "label", "name": "Standard views" }));
        browser.done(json!({ "do": "say", "text": "A message." }));
        texts += lowest(&mut browser, &format!("{scheme}, views and a message"));
        browser.done(json!({ "do": "label", "name": "Standard views" }));
        assert!(texts > 300, "{scheme}: {texts} texts");
        press(&mut browser, "v");
        press(&mut browser, "Escape");
        press(&mut browser, "Escape");
        becomes(&mut browser, "no pick", |now| now["selected"] == json!([]));
    }
    assert_eq!(pictures[0], pictures[1], "the model's colours are its own");

    // A choice stays, whatever the system prefers then.
    let choose = |browser: &mut Browser, value: &str| {
        press(browser, "p");
        browser.done(json!({ "do": "choose", "label": "Colours of the panels", "value": value }));
        press(browser, "p");
    };
    choose(&mut browser, "light");
    assert_eq!(theme(&mut browser), "light");
    browser.done(json!({ "do": "reload" }));
    browser.done(json!({ "do": "settle" }));
    assert_eq!(theme(&mut browser), "light", "it is kept");
    choose(&mut browser, "dark");
    browser.done(json!({ "do": "prefer", "scheme": "light" }));
    assert_eq!(theme(&mut browser), "dark");
    choose(&mut browser, "as the system has them");
    assert!(follows(&mut browser, "light"));
}

/// A closed cylinder of twelve sides about y, as a model: its vertices follow `before` others.
fn cylinder(before: usize, [x, z]: [f64; 2], radius: f64, heights: [f64; 2]) -> String {
    let mut lines = vec!["o pipe".to_owned()];
    for height in heights {
        for side in 0..12_u8 {
            let (sine, cosine) = (f64::from(side) * std::f64::consts::TAU / 12.0).sin_cos();
            lines.push(format!("v {} {height} {}", x + radius * cosine, z - radius * sine));
        }
    }
    let at = |ring: usize, side: usize| before + 12 * ring + side % 12 + 1;
    for side in 0..12 {
        let [a, b, c, d] = [at(0, side), at(0, side + 1), at(1, side + 1), at(1, side)];
        lines.push(format!("f {a} {b} {c} {d}"));
    }
    let names = |ring: usize| (0..12).map(|side| at(ring, side).to_string()).collect::<Vec<_>>();
    let (top, mut bottom) = (names(1), names(0));
    bottom.reverse();
    lines.push(format!("f {}", top.join(" ")));
    lines.push(format!("f {}", bottom.join(" ")));
    lines.join("\n") + "\n"
}

#[test]
fn at_rest_a_pipe_of_twelve_sides_looks_round_and_a_box_stays_flat() {
    let bench = Bench::empty();
    let model = boxes(&[([2.0, -2.0, -5.0], [3.0, 2.0, -4.0])]) + &cylinder(8, [0.0, -5.0], 1.0, [-2.0, 2.0]);
    bench.write("round.obj", model);
    bench.done(&["import", "round.obj", "-o", "round.scene"]);
    let Some(service) = Service::of(&bench, "round.scene", "127.0.0.1:0") else { return };
    let Some(mut browser) = Browser::start(900, 600) else { return };
    browser.done(json!({ "do": "open", "url": service.url() }));
    browser.done(json!({ "do": "settle" }));
    press(&mut browser, "3");
    browser.done(json!({ "do": "stand", "eye": [0.0, 0.0, 0.0], "forward": [0.0, 0.0, -1.0] }));
    look(&mut browser);
    let before = items(&browser.done(json!({ "do": "look" })));
    browser.done(json!({ "do": "refine" }));
    let path = bench.path("round.png");
    browser.done(json!({ "do": "picture", "path": path }));
    let picture = image::open(&path).unwrap().to_rgb8();
    let after = items(&browser.done(json!({ "do": "look" })));
    assert!(before == after, "light alone differs");
    let mut column = |point: [f64; 3]| {
        let place = numbers(&browser.done(json!({ "do": "point", "point": point })));
        [place[0] as u32, place[1] as u32]
    };
    // A line at the outline is farther off than this.
    let ([left, row], [right, _]) = (column([-0.6, 0.4, -4.2]), column([0.6, 0.4, -4.2]));
    let tones: Vec<u8> = (left..=right).map(|x| picture.get_pixel(x, row)[1]).collect();
    assert!(tones.len() > 100, "{left} to {right}");
    let steps = tones.windows(2).map(|pair| pair[0].abs_diff(pair[1])).max().unwrap();
    assert!(steps <= 5, "facets show: {tones:?}");
    let range = tones.iter().max().unwrap() - tones.iter().min().unwrap();
    assert!(range > 15, "it is round: {tones:?}");
    let ([left, top], [right, bottom]) = (column([2.3, 0.3, -4.0]), column([2.7, -0.3, -4.0]));
    let face = (left..=right).flat_map(|x| (top..=bottom).map(move |y| [x, y]));
    let face: Vec<u8> = face.map(|[x, y]| picture.get_pixel(x, y)[1]).collect();
    let range = face.iter().max().unwrap() - face.iter().min().unwrap();
    assert!(face.len() > 500 && range <= 2, "a face of {} pixels has {range} tones", face.len());
}
