//! A service of a page, and a real browser that shows it.

use std::collections::BTreeMap;
use std::env;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{View, draw_order, lod_cut};
use trimaran_proto::{Camera, FrameNumber, LodRule, Viewport};
use trimaran_scene::Scene;

use super::program::Bench;

pub(crate) const TOKEN: &str = "0123456789abcdefXYZ";

/// A service of a scene.
pub(crate) struct Service {
    child: Child,
    /// Host and port.
    pub(crate) at: String,
    /// The address that it has printed.
    pub(crate) printed: String,
}

impl Service {
    /// A service of `plant.scene` at `listen`.
    pub(crate) fn start(bench: &Bench, listen: &str) -> Option<Self> {
        Self::of(bench, "plant.scene", listen)
    }

    /// `None` if the program was built without its page and none is required.
    pub(crate) fn of(bench: &Bench, scene: &str, listen: &str) -> Option<Self> {
        Self::with_token(bench, scene, listen, TOKEN)
    }

    /// The same, with another token.
    pub(crate) fn with_token(bench: &Bench, scene: &str, listen: &str, token: &str) -> Option<Self> {
        let mut command = bench.command(&["serve", scene, "--listen", listen, "--token", token]);
        command.env("TRIMARAN_WS_ALLOW_ORIGINS", "https://plant.example,http://pages:7480");
        let service = Self::by(command)?;
        assert_eq!(service.printed, format!("http://{}/?token={token}", service.at));
        Some(service)
    }

    /// The service that a command starts.
    pub(crate) fn by(mut command: Command) -> Option<Self> {
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut service = Self { child, at: String::new(), printed: String::new() };
        let mut line = String::new();
        BufReader::new(service.child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let Some((_, url)) = line.split_once("://") else {
            let mut said = String::new();
            service.child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
            return skipped(&said);
        };
        url.split_once('/').unwrap().0.clone_into(&mut service.at);
        line.trim().clone_into(&mut service.printed);
        Some(service)
    }

    /// Ends it, and returns its output on standard error.
    pub(crate) fn said(mut self) -> String {
        self.child.kill().unwrap();
        let mut said = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        said
    }

    /// Its number among processes.
    pub(crate) fn process(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}/?token={TOKEN}", self.at)
    }

    /// The first line of the answer to a request with these headers.
    pub(crate) fn status(&self, target: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(&self.at).unwrap();
        write!(stream, "GET {target} HTTP/1.1\r\nHost: {}\r\n{headers}\r\n", self.at).unwrap();
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line).unwrap();
        line
    }

    /// The answer to a request with these headers.
    pub(crate) fn ask(&self, target: &str, headers: &str) -> String {
        self.ask_as(&self.at, target, headers)
    }

    /// The same, with another host and port in the request.
    pub(crate) fn ask_as(&self, host: &str, target: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(&self.at).unwrap();
        let request = format!("GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        if let (Ok(Some(ended)), Some(mut from)) = (self.child.try_wait(), self.child.stderr.take()) {
            // A page without a service returns less.
            let mut said = String::new();
            let _bytes = from.read_to_string(&mut said);
            println!("the service at {} ended by itself, {ended}: {said}", self.at);
        }
        let _ended = self.child.kill();
        let _code = self.child.wait();
    }
}

/// Returns nothing, with a message; panics if a browser is required.
pub(crate) fn skipped<T>(why: &str) -> Option<T> {
    assert!(env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{why}");
    println!("skipped: {why}");
    None
}

/// A page in Chromium.
pub(crate) struct Browser {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Browser {
    /// `None` if there is none, and none is required.
    pub(crate) fn start(width: u32, height: u32) -> Option<Self> {
        Self::with(&[&width.to_string(), &height.to_string()])
    }

    /// The same, as a phone without a mouse.
    pub(crate) fn with_touch(width: u32, height: u32) -> Option<Self> {
        Self::with(&[&width.to_string(), &height.to_string(), "touch"])
    }

    /// The same, for a person who has not asked for less motion: a page begins with a flight.
    pub(crate) fn with_motion(width: u32, height: u32) -> Option<Self> {
        Self::with(&[&width.to_string(), &height.to_string(), "motion"])
    }

    /// The same, with these flags of Chromium.
    pub(crate) fn with_flags(flags: &[&str]) -> Option<Self> {
        Self::with(&[&["300", "300"][..], flags].concat())
    }

    /// The page's renderer alone, which draws a case a line.
    pub(crate) fn with_hard_cases() -> Option<Self> {
        Self::by("hardCases.mjs", &[])
    }

    fn with(arguments: &[&str]) -> Option<Self> {
        Self::by("driver.mjs", arguments)
    }

    fn by(driver: &str, arguments: &[&str]) -> Option<Self> {
        let driver = Path::new(env!("CARGO_MANIFEST_DIR")).join("roles/page/target/tests").join(driver);
        let chromium = env::var("TRIMARAN_CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_owned());
        if !driver.exists() || !Path::new(&chromium).exists() {
            return skipped("it takes Chromium, and the driver that ./x page makes");
        }
        let mut command = Command::new("node");
        command
            .arg(driver)
            .args(arguments)
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("roles/page"));
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        Some(Self { child, input, output: BufReader::new(output) })
    }

    pub(crate) fn tell(&mut self, command: Value) -> Value {
        writeln!(self.input, "{command}").unwrap();
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{command}: {e}: {line}"));
        assert!(told.get("error").is_none(), "{command}: {told}");
        told
    }

    /// The same, and checks that nothing went wrong in the page.
    pub(crate) fn done(&mut self, command: Value) -> Value {
        let mut told = self.tell(command);
        assert_eq!(told["faults"], json!([]), "{told}");
        told["answer"].take()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ended = self.child.kill();
        let _code = self.child.wait();
    }
}

/// The difference between the page's picture and the whole cut of its requested view.
pub(crate) struct Difference {
    /// The share of pixels that show another drawable.
    pub(crate) pixels: f64,
    /// Drawables with more than a few pixels in only one of the pictures, with their pixels in the page's and
    /// in the reference.
    pub(crate) drawables: Vec<(u32, [usize; 2])>,
    pub(crate) seen: usize,
}

/// More pixels than two rasterizers differ by at the edges of a small object, or of one seen edge-on.
const A_FEW: usize = 24;

/// The drawable at each pixel of a look, `u32::MAX` for none; rows from below.
pub(crate) fn items(look: &Value) -> Vec<u32> {
    let runs: Vec<u32> = serde_json::from_value(look["runs"].clone()).unwrap();
    let (pairs, _) = runs.as_chunks();
    pairs.iter().flat_map(|[item, pixels]| std::iter::repeat_n(*item, *pixels as usize)).collect()
}

pub(crate) fn difference(look: &Value, scene: &Scene) -> Difference {
    let number = |value: &Value| value.as_f64().unwrap();
    let numbers = |value: &Value| value.as_array().unwrap().iter().map(number).collect::<Vec<_>>();
    let (eye, turn) = (numbers(&look["eye"]), numbers(&look["orientation"]));
    let side = |name: &str| u32::try_from(look[name].as_u64().unwrap()).unwrap();
    let viewport = Viewport::new(side("width"), side("height")).unwrap();
    let (eye, turn) = (eye.try_into().unwrap(), turn.try_into().unwrap());
    let seen_at = |wider: f64, viewport| {
        let (tan, near) = (number(&look["tanHalfFov"]) * wider, number(&look["near"]) as f32);
        View::new(Camera::new(eye, turn, tan as f32, near, FrameNumber(0)).unwrap(), viewport)
    };
    let view = seen_at(1.0, viewport);
    // The culled view is wider by half, with pixels of the same size.
    let [width, height] = [viewport.width(), viewport.height()].map(|side| (3 * side).div_ceil(2));
    let wider = f64::from(height) / f64::from(viewport.height());
    let asked = seen_at(wider, Viewport::new(width, height).unwrap());
    let mut cut = lod_cut(scene, &asked, LodRule::new(2.0).unwrap());
    draw_order(scene, &view, &mut cut);
    let exact = rasterize(scene, &view, cut, Placement::Single);
    let (width, height) = (viewport.width() as usize, viewport.height() as usize);
    let items = items(look);
    let (mut differing, mut counts) = (0, BTreeMap::<u32, [usize; 2]>::new());
    for y in 0..height {
        for x in 0..width {
            // The page's rows come from below.
            let shown = Some(items[(height - 1 - y) * width + x]).filter(|id| *id != u32::MAX);
            let expected = exact.ids()[y * width + x].map(|triangle| triangle.drawable.0);
            differing += usize::from(shown != expected);
            for (at, id) in [shown, expected].into_iter().enumerate() {
                if let Some(id) = id {
                    counts.entry(id).or_default()[at] += 1;
                }
            }
        }
    }
    let lone = counts.iter().filter(|(_, [a, b])| a.min(b) == &0 && a.max(b) > &A_FEW);
    Difference {
        pixels: differing as f64 / (width * height) as f64,
        drawables: lone.map(|(id, pixels)| (*id, *pixels)).collect(),
        seen: counts.len(),
    }
}
