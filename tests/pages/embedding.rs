//! The page in a frame of another site's page, which drives it by messages.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    net::TcpListener,
    path::Path,
    thread,
};

use serde_json::{Value, json};

use super::controls::{ROOM, boxes, number, numbers};
use crate::common::page::{Browser, Service, TOKEN};
use crate::common::program::Bench;

/// The files of the example, served at a port of this machine. Returns their origin.
fn site() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let origin = format!("http://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            // All of the request is read: a connection that is closed before would be reset.
            let mut lines = BufReader::new(&stream).lines().map_while(Result::ok);
            let asked = lines.next().unwrap_or_default();
            lines.by_ref().take_while(|line| !line.is_empty()).for_each(drop);
            let path = asked.split(' ').nth(1).unwrap_or_default().split('?').next().unwrap_or_default();
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/embedding");
            let name = path.trim_start_matches('/');
            let kind = match name.rsplit_once('.') {
                Some((_, "js")) => "text/javascript",
                Some((_, "css")) => "text/css",
                _ => "text/html",
            };
            let (status, body) = match fs::read(folder.join(name)) {
                Ok(body) => ("200 OK", body),
                // A browser asks for an icon.
                Err(_) => ("204 No Content", Vec::new()),
            };
            let length = body.len();
            let head = format!(
                "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n\
                 Connection: close\r\n\r\n"
            );
            let _gone = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&body));
        }
    });
    origin
}

/// A service of three boxes that pages of these origins may show.
fn service(bench: &Bench, ancestors: &str) -> Option<Service> {
    bench.write("boxes.obj", boxes(&ROOM));
    bench.done(&["import", "boxes.obj", "-o", "boxes.scene"]);
    let serve = ["serve", "boxes.scene", "--listen", "127.0.0.1:0", "--token", TOKEN];
    Service::by(bench.command(&[&serve[..], &["--frame-ancestors", ancestors]].concat()))
}

fn example(origin: &str, service: &Service) -> String {
    let address: String = form_urlencoded::byte_serialize(service.url().as_bytes()).collect();
    format!("{origin}/index.html?service={address}")
}

fn log(browser: &mut Browser) -> Vec<String> {
    serde_json::from_value(browser.tell(json!({ "do": "text", "selector": "#log li" }))["answer"].take())
        .unwrap()
}

/// Waits until the log of the example has a line that begins so, after the first `skip` lines. Returns it.
fn told(browser: &mut Browser, skip: usize, begin: &str) -> String {
    for _ in 0..1200 {
        if let Some(line) = log(browser).into_iter().skip(skip).find(|line| line.starts_with(begin)) {
            return line;
        }
        browser.tell(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("nothing says {begin:?}: {:?}", log(browser))
}

/// Presses a button of the example for a part, and waits for the answer.
fn ask(browser: &mut Browser, button: &str, part: &str) -> String {
    let before = log(browser).len();
    browser.done(json!({ "do": "fill", "label": "Part", "text": part }));
    browser.done(json!({ "do": "button", "name": button }));
    for _ in 0..1200 {
        let answers = log(browser).into_iter().skip(before);
        if let Some(line) =
            answers.into_iter().find(|line| line.starts_with("done") || line.starts_with("error"))
        {
            return line;
        }
        browser.done(json!({ "do": "wait", "milliseconds": 50 }));
    }
    panic!("no answer to {button}: {:?}", log(browser))
}

fn framed(browser: &mut Browser) -> Value {
    browser.done(json!({ "do": "framed" }))
}

#[test]
fn a_page_of_an_allowed_origin_drives_the_model_and_hears_picks() {
    let bench = Bench::empty();
    let origin = site();
    let Some(service) = service(&bench, &format!("https://other.example,{origin}")) else { return };
    let policy = service.ask("/", "");
    assert!(
        policy.contains(&format!("frame-ancestors 'self' https://other.example {origin}\r\n")),
        "{policy}"
    );
    let Some(mut browser) = Browser::start(1000, 800) else { return };
    browser.done(json!({ "do": "open", "url": example(&origin, &service) }));
    assert_eq!(told(&mut browser, 0, "ready"), "ready: boxes, 3 objects");

    // Select, by name; what is not there is an error, and the next request is heard all the same.
    assert!(ask(&mut browser, "Select", "box1").starts_with("done"));
    assert_eq!(told(&mut browser, 0, "selected"), "selected: box1");
    assert_eq!(framed(&mut browser)["selected"], json!([1]));
    let fault = ask(&mut browser, "Select", "box9");
    assert!(fault.starts_with("error") && fault.contains("no part is called “box9”"), "{fault}");
    assert_eq!(framed(&mut browser)["selected"], json!([1]), "nothing has changed");

    // Go there, and back.
    let start = framed(&mut browser)["eye"].take();
    assert!(ask(&mut browser, "Go to", "box2").starts_with("done"));
    let first = told(&mut browser, 0, "view: ");
    let there = framed(&mut browser)["eye"].take();
    assert_ne!(there, start);
    assert!(number(&there[0]) > 0.0, "before the right box: {there}");
    assert!(ask(&mut browser, "Isolate", "box2").starts_with("done"));
    assert!(ask(&mut browser, "Hide", "box2").starts_with("done"));
    assert_eq!(framed(&mut browser)["hidden"], json!([2]));
    assert!(ask(&mut browser, "Show all", "").starts_with("done"));
    assert_eq!(framed(&mut browser)["hidden"], json!([]));

    // A person picks in the frame: the page around hears it.
    let skip = log(&mut browser).len();
    let frame = browser.done(json!({ "do": "rects", "selector": "#model" }))[0].take();
    let [x, y, width, height] = ["x", "y", "width", "height"].map(|side| number(&frame[side]));
    // The box may not be drawn again at once: until then a click meets the background.
    let heard = (0..40).any(|_| {
        browser.done(json!({ "do": "click", "x": x, "y": y }));
        browser.done(json!({ "do": "wait", "milliseconds": 700 }));
        log(&mut browser).iter().skip(skip).any(|line| line == "selected: box2")
    });
    assert!(heard, "{:?}", log(&mut browser));

    // The person moves: the page around is told where to, and can bring the eye back.
    let skip = log(&mut browser).len();
    browser.done(json!({ "do": "press", "key": "2" }));
    browser.done(json!({ "do": "hold", "key": "KeyS", "milliseconds": 300 }));
    told(&mut browser, skip, "view: ");
    assert_ne!(framed(&mut browser)["eye"], there);
    assert!(ask(&mut browser, "Back to the first view", "").starts_with("done"));
    let back = numbers(&framed(&mut browser)["eye"]);
    let expected = first.split(' ').skip(1).map(|metres| metres.parse::<f64>().unwrap());
    assert!(back.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.006), "{back:?} is not {first}");

    // A picture of another size than the frame.
    assert!(ask(&mut browser, "Picture", "").starts_with("done"));
    let image = json!({ "do": "image", "selector": "#log img" });
    assert_eq!(browser.done(image), json!([1280, 720]));
    assert!(width < 1280.0 && height < 720.0);
}

#[test]
fn a_page_of_another_origin_gets_nothing() {
    let bench = Bench::empty();
    let (allowed, foreign) = (site(), site());
    let Some(service) = service(&bench, &allowed) else { return };
    let Some(mut browser) = Browser::start(700, 600) else { return };
    // The browser does not even show it.
    browser.tell(json!({ "do": "open", "url": example(&foreign, &service) }));
    for button in ["Select", "Show all", "Picture"] {
        browser.tell(json!({ "do": "button", "name": button }));
    }
    browser.tell(json!({ "do": "wait", "milliseconds": 2000 }));
    assert_eq!(log(&mut browser), Vec::<String>::new());
    let faults = browser.tell(json!({ "do": "title" }))["faults"].to_string();
    assert!(faults.contains("frame-ancestors"), "{faults}");
    // A window that the foreign page opens shows the model to the person, and hears nothing of that page.
    browser.tell(json!({ "do": "open", "url": format!("{foreign}/index.html?service=about:blank") }));
    let answer = browser.tell(json!({ "do": "popup", "url": service.url() }))["answer"].take();
    assert_eq!(answer, json!({ "heard": [], "selected": [], "drawn": true }), "{answer}");
    // The same service, from the allowed origin.
    browser.tell(json!({ "do": "open", "url": example(&allowed, &service) }));
    told(&mut browser, 0, "ready");
    let without = Service::of(&bench, "boxes.scene", "127.0.0.1:0").unwrap();
    assert!(without.ask("/", "").contains("frame-ancestors 'self'\r\n"));
    browser.tell(json!({ "do": "open", "url": example(&allowed, &without) }));
    browser.tell(json!({ "do": "wait", "milliseconds": 2000 }));
    assert_eq!(log(&mut browser), Vec::<String>::new(), "nobody is allowed unless named");
    let bad = bench.trimaran(&["serve", "boxes.scene", "--frame-ancestors", "*"]);
    assert_eq!(bad.status.code(), Some(2));
}
