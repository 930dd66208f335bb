//! `trimaran view`: from the files of a model to a page, and to the same page at once when they are unchanged.

use std::{
    env, fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use serde_json::{Value, json};

use crate::common::program::{Bench, signal};

/// The polling interval for a browser's end, and how often it is polled.
const PAUSE: Duration = Duration::from_millis(50);
const LOOKS: u32 = 600;

/// A tetrahedron of this height.
fn model(height: u32) -> String {
    format!("o tank\nv 0 0 0\nv 9 0 0\nv 0 0 9\nv 0 {height} 0\nf 1 2 4\nf 1 4 3\nf 1 3 2\nf 2 3 4\n")
}

/// A program that shows a page.
struct View {
    child: Child,
    /// Its output before the page's address.
    said: Vec<String>,
    /// Host and port, and the rest.
    url: (String, String),
}

impl View {
    /// `None`, with a message, if the program was built without its page and none is required.
    fn start(mut command: Command) -> Option<Self> {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut said = Vec::new();
        for line in BufReader::new(child.stdout.take().unwrap()).lines() {
            let line = line.unwrap();
            if let Some(url) = line.strip_prefix("http://") {
                let (at, path) = url.split_once('/').unwrap();
                return Some(Self { child, said, url: (at.to_owned(), path.to_owned()) });
            }
            said.push(line);
        }
        let mut why = String::new();
        child.stderr.take().unwrap().read_to_string(&mut why).unwrap();
        let _code = child.wait();
        assert!(env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{why}");
        println!("skipped: {why}");
        None
    }

    fn ask(&self, target: &str) -> String {
        let (at, path) = &self.url;
        let query = path.strip_prefix('?').unwrap();
        let mut stream = TcpStream::connect(at).unwrap();
        write!(stream, "GET /{target}?{query} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let _ended = self.child.kill();
        let _code = self.child.wait();
    }
}

fn view(bench: &Bench, args: &[&str]) -> Command {
    let mut command = bench.command(&[&["view"], args].concat());
    command.env("XDG_CACHE_HOME", bench.path("cache"));
    command
}

fn cached(bench: &Bench) -> Vec<String> {
    let names = fs::read_dir(bench.path("cache/trimaran")).unwrap();
    let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name.ends_with(".scene"));
    names.sort();
    names
}

#[test]
fn a_model_is_cooked_when_it_has_changed_and_else_is_there_at_once() {
    let bench = Bench::empty();
    bench.write("tank.obj", model(5));
    let Some(first) = View::start(view(&bench, &["tank.obj", "--no-browser"])) else { return };
    assert!(first.said[0].starts_with("read 1 file: 1 object, 4 triangles"), "{:?}", first.said);
    assert!(first.ask("scene").contains(r#""objects":1"#));
    assert!(first.ask("children").contains(r#""name":"tank.obj""#));
    assert!(first.url.0.starts_with("127.0.0.1:"), "others do not reach it: {:?}", first.url);
    let before = cached(&bench);
    assert_eq!(before.len(), 1);
    let scene = || fs::read(bench.path("cache/trimaran").join(&before[0])).unwrap();
    let first_scene = scene();

    let again = View::start(view(&bench, &["tank.obj", "--no-browser"])).unwrap();
    assert_eq!((again.said.len(), cached(&bench)), (0, before.clone()));

    bench.write("tank.obj", model(50));
    let changed = View::start(view(&bench, &["tank.obj", "--no-browser"])).unwrap();
    assert!(!changed.said.is_empty());
    assert_eq!(cached(&bench), before, "it takes the place of the one before");
    assert!(scene() != first_scene);
}

/// Each file that the import has read, or has looked for.
#[test]
fn a_model_is_cooked_again_when_a_file_beside_it_changes_or_comes() {
    let bench = Bench::empty();
    bench.write("tank.obj", format!("mtllib colours.of.mine\nusemtl red\n{}", model(5)));
    let starts = || View::start(view(&bench, &["tank.obj", "--no-browser"]));
    let Some(first) = starts() else { return };
    assert!(first.said.iter().any(|line| line.contains("colours.of.mine")), "{:?}", first.said);
    assert_eq!(starts().unwrap().said.len(), 0, "nothing has changed");
    bench.write("colours.of.mine", "newmtl red\nKd 1 0 0\n");
    let coloured = starts().unwrap();
    assert!(!coloured.said.is_empty() && !coloured.said.iter().any(|line| line.contains("colours.of.mine")));
    bench.write("colours.of.mine", "newmtl red\nKd 1 0.5 0\n");
    assert!(!starts().unwrap().said.is_empty(), "another colour");
}

#[test]
fn a_damaged_scene_of_the_cache_is_cooked_again() {
    let bench = Bench::empty();
    bench.write("tank.obj", model(5));
    let starts = || View::start(view(&bench, &["tank.obj", "--no-browser"]));
    if starts().is_none() {
        return;
    }
    let scene = bench.path("cache/trimaran").join(&cached(&bench)[0]);
    let whole = fs::read(&scene).unwrap();
    for damaged in [&whole[..whole.len() / 2], &b""[..], b"not a scene at all"] {
        fs::write(&scene, damaged).unwrap();
        let again = starts().unwrap();
        assert!(again.ask("scene").contains(r#""objects":1"#));
        assert_eq!(fs::read(&scene).unwrap(), whole);
    }
    assert_eq!((mode(&bench.path("cache/trimaran")), mode(&scene)), (0o700, 0o600));
}

#[test]
fn a_model_is_shown_though_nothing_can_be_kept_of_it() {
    let bench = Bench::empty();
    bench.write("tank.obj", model(5));
    bench.write("file", "");
    let mut command = view(&bench, &["tank.obj", "--no-browser"]);
    command.env("XDG_CACHE_HOME", bench.path("file/cache")).env("TMPDIR", bench.path(""));
    let Some(shown) = View::start(command) else { return };
    assert!(shown.ask("scene").contains(r#""objects":1"#));
    drop(shown);
}

/// Links and the browser's stored data stay valid the next time, and for this model alone.
#[test]
fn a_model_keeps_its_address() {
    let bench = Bench::empty();
    bench.write("tank.obj", model(5));
    bench.write("other.obj", model(7));
    let Some(first) = View::start(view(&bench, &["tank.obj", "--no-browser"])) else { return };
    let url = first.url.clone();
    // While it is shown, the same model has another port, and another model has one of its own.
    let beside = View::start(view(&bench, &["tank.obj", "--no-browser"])).unwrap();
    let other = View::start(view(&bench, &["other.obj", "--no-browser"])).unwrap();
    assert!(beside.url.0 != url.0 && beside.url.1 == url.1, "{:?}", beside.url);
    assert!(other.url.0 != url.0 && other.url.1 != url.1, "{:?}", other.url);
    drop((first, beside));
    bench.write("tank.obj", model(50));
    let again = View::start(view(&bench, &["./tank.obj", "--no-browser"])).unwrap();
    assert_eq!(again.url, url);
    let folder = bench.path("cache/trimaran");
    assert_eq!(mode(&folder), 0o700);
    let names = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let tokens: Vec<_> =
        names.filter(|path| path.extension().is_some_and(|ending| ending == "token")).collect();
    assert!(tokens.len() == 2 && tokens.iter().all(|token| mode(token) == 0o600), "{tokens:?}");
}

fn mode(path: &Path) -> u32 {
    std::os::unix::fs::PermissionsExt::mode(&fs::metadata(path).unwrap().permissions()) & 0o777
}

/// Any user of the machine sees a browser's arguments: the token must not be among them.
#[test]
fn the_page_is_opened_in_the_browser_of_the_user_by_a_file_that_nobody_else_reads() {
    let bench = Bench::with_plant(60);
    bench.write("browser", "#!/bin/sh\necho \"$@\" > opened.part && mv opened.part opened\n");
    fs::set_permissions(bench.path("browser"), std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let mut command = view(&bench, &["plant.scene"]);
    command.env("BROWSER", bench.path("browser")).env("HOME", bench.path(""));
    let Some(view) = View::start(command) else { return };
    let opened = loop {
        if let Ok(opened) = fs::read_to_string(bench.path("opened")) {
            break opened;
        }
        thread::yield_now();
    };
    let file = Path::new(opened.trim().strip_prefix("file://").unwrap());
    let token = view.url.1.strip_prefix("?token=").unwrap();
    assert!(!opened.contains(token), "{opened}");
    let page = fs::read_to_string(file).unwrap();
    assert!(page.contains(&format!("href=\"http://{}/{}\"", view.url.0, view.url.1)), "{page}");
    assert_eq!((mode(file), mode(file.parent().unwrap())), (0o600, 0o700));
    assert!(cached(&bench).is_empty(), "a scene is shown where it is");
    let folder = file.parent().unwrap().to_owned();
    signal("INT", &view.child.id().to_string());
    while folder.exists() {
        thread::sleep(PAUSE);
    }
}

/// A browser repeats a walk by itself, and the program reports it.
#[test]
fn a_page_walks_along_a_path_and_reports() {
    let bench = Bench::with_plant(60);
    let chromium = env::var("TRIMARAN_CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_owned());
    if !Path::new(&chromium).exists() {
        assert!(env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "there is no {chromium}");
        println!("skipped: there is no {chromium}");
        return;
    }
    let script = format!(
        "#!/bin/sh\n{chromium} --headless=new --no-sandbox --use-angle=swiftshader \
         --enable-unsafe-swiftshader --user-data-dir={} --window-size=300,300 \"$1\" &\n\
         echo $! > browser.pid; wait; touch browser.ended\n",
        bench.path("profile").display()
    );
    bench.write("browser", script);
    fs::set_permissions(bench.path("browser"), std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let frame = |z: u32| json!({ "eye": [0, 2, z], "forward": [0, 0, -1], "up": [0, 1, 0] });
    let path = json!({ "vfov_deg": 60, "frames": (0..30).map(frame).collect::<Vec<_>>() });
    bench.write("path.json", path.to_string());
    let args = ["plant.scene", "--drive", "path.json", "--network", "wan-80ms", "--json"];
    let mut command = view(&bench, &args);
    let output = command.env("BROWSER", bench.path("browser")).output().unwrap();
    let has_ended = (0..LOOKS).any(|_| {
        thread::sleep(PAUSE);
        bench.path("browser.ended").exists()
    });
    if !has_ended && let Ok(pid) = fs::read_to_string(bench.path("browser.pid")) {
        signal("KILL", pid.trim());
    }
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if said.contains("./x page") && env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none() {
        println!("skipped: {said}");
        return;
    }
    assert!(output.status.success(), "{said}");
    assert!(has_ended, "a page that has walked closes itself");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |name: &str| report[name].as_f64().unwrap();
    assert!(number("pictures") >= 2.0 && number("walkS") >= 1.0, "{report}");
    assert!(number("firstPictureS") <= number("exactPictureS"), "{report}");
    assert!(number("receivedBytes") > 1000.0 && number("geometryBytes") > 0.0, "{report}");
    assert!(number("pictureMs") <= number("pictureP95Ms"), "{report}");
    let moments = report["moments"].as_array().unwrap();
    assert_eq!(moments.len(), 2, "at the beginning and at the end: {report}");
    let rising = |name: &str| {
        let [first, last] = [0, 1].map(|at: usize| moments[at][name].as_f64().unwrap());
        assert!(0.0 <= first && first <= last && last > 0.0, "{name}: {report}");
    };
    ["seconds", "cameraBytes", "idBytes", "pieceBytes"].into_iter().for_each(rising);
    assert!(moments[1]["heldBytes"].as_f64() <= Some(number("geometryBytes")), "{report}");
    assert!(moments[1]["scriptBytes"].as_f64() > Some(1e5), "{report}");
    assert!(number("setAgeMs") >= 80.0 && number("restMs") >= 80.0, "it crosses the network: {report}");
    let tasks = &report["longTasks"];
    let longest = tasks["longestMs"].as_f64().unwrap();
    assert!(if tasks["count"] == 0 { longest == 0.0 } else { longest >= 50.0 }, "{report}");
    assert!(0.0 < number("pickMs") && number("pickMs") <= number("longestPickMs"), "{report}");
    let wrong = |name: &str| report["wrong"][name].as_f64().unwrap();
    assert!(wrong("pictures") >= 2.0 && wrong("right") <= wrong("pictures"), "{report}");
    assert!(wrong("medianPercent") <= wrong("p95Percent"), "{report}");
    assert!(wrong("meanPercent") <= wrong("mostPercent") && wrong("mostPercent") <= 100.0, "{report}");

    let unknown = ["plant.scene", "--drive", "path.json", "--network", "wan"];
    let said = String::from_utf8(view(&bench, &unknown).output().unwrap().stderr).unwrap();
    assert!(said.contains("--network") && said.contains("wan-80ms"), "{said}");

    bench.write("wrong.json", r#"{"vfov_deg":60,"frames":[]}"#);
    let output = view(&bench, &["plant.scene", "--drive", "wrong.json"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("wrong.json"), "{said}");
}

#[test]
fn what_cannot_be_viewed_is_named() {
    let bench = Bench::empty();
    bench.write("tank.obj", model(5));
    for (args, expected) in [
        (&["no.rvm"][..], "cannot read no.rvm"),
        (&["no.scene"], "no.scene"),
        (&["tank.obj", "plant.scene"], "plant.scene is a cooked scene: it is viewed alone"),
        (&["tank.obj", "--max-triangles", "1"], "tank"),
    ] {
        let output = view(&bench, &[args, &["--no-browser"]].concat()).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains(expected), "{args:?}: {said}");
    }
    assert!(!bench.path("cache/trimaran").exists() || cached(&bench).is_empty());
}
