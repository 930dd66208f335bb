//! A virtual screen, and windows of the program on it.

use std::{
    env, fs,
    io::{BufRead, BufReader, Read},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
    time::Duration,
};

use tempfile::TempDir;

use super::program::Bench;

/// Its sides in pixels.
pub(crate) const SCREEN: [usize; 2] = [1400, 1000];

/// The polling interval of waits, and how often they poll.
const PAUSE: Duration = Duration::from_millis(50);
const LOOKS: u32 = 1200;

/// The result of `look` once it gives one.
pub(crate) fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    for _ in 0..LOOKS {
        if let Some(found) = look() {
            return found;
        }
        thread::sleep(PAUSE);
    }
    panic!("waited in vain for {what}");
}

/// An X server that draws into a file.
pub(crate) struct Screen {
    server: Child,
    display: String,
    folder: TempDir,
}

impl Screen {
    /// `None`, with a message, if there is no server and none is required.
    pub(crate) fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let [width, height] = SCREEN;
        let mut command = Command::new("Xvfb");
        // A server that resets when its last client leaves drops clients that connect meanwhile.
        command.args([
            "-noreset",
            "-displayfd",
            "1",
            "-nolisten",
            "tcp",
            "-screen",
            "0",
            &format!("{width}x{height}x24"),
        ]);
        command.arg("-fbdir").arg(folder.path());
        let server = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let (Ok(mut server), Ok(_)) = (server, Command::new("xdotool").arg("version").output()) else {
            return skipped("it takes Xvfb and xdotool");
        };
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self { server, display: format!(":{}", number.trim()), folder })
    }

    /// Opens a scene of `bench`.
    pub(crate) fn open(&self, bench: &Bench, scene: &str, flags: &[&str]) -> Window<'_> {
        self.open_scaled(bench, scene, flags, 1.0)
    }

    /// The same on a screen with pixels this many times smaller than usual.
    pub(crate) fn open_scaled(&self, bench: &Bench, scene: &str, flags: &[&str], scale: f64) -> Window<'_> {
        self.open_named(bench, scene.trim_end_matches(".scene"), scene, flags, scale)
    }

    /// Opens a scene or a service's address by name.
    pub(crate) fn open_named(
        &self,
        bench: &Bench,
        name: &str,
        scene: &str,
        flags: &[&str],
        scale: f64,
    ) -> Window<'_> {
        let mut command = watched(bench, scene, flags);
        self.beside(&mut command);
        command.env("WINIT_X11_SCALE_FACTOR", scale.to_string());
        let program = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut window = Window { screen: self, program, id: String::new() };
        window.id = wait_for("a window", || {
            if let Some(code) = window.program.try_wait().unwrap() {
                panic!("{code}: {}", window.said());
            }
            let found = self.xdotool(&["search", "--onlyvisible", "--name", &format!("^{name}: ")])?;
            found.lines().next().map(str::to_owned)
        });
        window.xdotool(&["windowfocus"]);
        window
    }

    /// A command of a program on this screen.
    pub(crate) fn beside<'c>(&self, command: &'c mut Command) -> &'c mut Command {
        command.env("DISPLAY", &self.display).env_remove("WAYLAND_DISPLAY")
    }

    /// The output of `xdotool`, if it succeeds.
    fn xdotool(&self, args: &[&str]) -> Option<String> {
        let output = Command::new("xdotool").args(args).env("DISPLAY", &self.display).output().unwrap();
        output.status.success().then(|| String::from_utf8(output.stdout).unwrap())
    }

    /// The picture on the screen now.
    pub(crate) fn picture(&self) -> Dump {
        let bytes = fs::read(self.folder.path().join("Xvfb_screen0")).unwrap();
        // The file is an X window dump: sizes in words of 4 bytes, most significant first.
        let word =
            |place: usize| u32::from_be_bytes(bytes[4 * place..4 * place + 4].try_into().unwrap()) as usize;
        assert_eq!([word(4), word(5)], SCREEN);
        let (first, row) = (word(0) + 12 * word(19), word(12));
        Dump { bytes, first, row }
    }
}

/// A screen's picture.
pub(crate) struct Dump {
    bytes: Vec<u8>,
    /// The place of the first pixel, and the bytes in a row.
    first: usize,
    row: usize,
}

impl Dump {
    /// A pixel, from the upper left: red, green and blue.
    pub(crate) fn at(&self, x: u32, y: u32) -> [u8; 3] {
        let place = self.first + y as usize * self.row + 4 * x as usize;
        [self.bytes[place + 2], self.bytes[place + 1], self.bytes[place]]
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ended = self.server.kill();
        let _code = self.server.wait();
    }
}

/// A headless Wayland compositor.
pub(crate) struct Compositor {
    server: Child,
    folder: TempDir,
}

impl Compositor {
    /// `None`, with a message, if there is none and none is required.
    pub(crate) fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("weston");
        command.args(["--backend=headless-backend.so", "--socket=nobody", "--idle-time=0", "--no-config"]);
        command.env("XDG_RUNTIME_DIR", folder.path()).stdout(Stdio::null()).stderr(Stdio::null());
        let Ok(server) = command.spawn() else { return skipped("it takes weston") };
        let compositor = Self { server, folder };
        wait_for("the compositor", || compositor.folder.path().join("nobody").exists().then_some(()));
        Some(compositor)
    }

    /// Opens a scene of `bench`, and waits for the program's end: returns its status and output.
    pub(crate) fn run(&self, bench: &Bench, scene: &str, flags: &[&str]) -> (ExitStatus, String) {
        let mut command = watched(bench, scene, flags);
        command.env_remove("DISPLAY").env("WAYLAND_DISPLAY", "nobody");
        let output = command.env("XDG_RUNTIME_DIR", self.folder.path()).output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status, String::from_utf8(said).unwrap())
    }
}

impl Drop for Compositor {
    fn drop(&mut self) {
        let _ended = self.server.kill();
        let _code = self.server.wait();
    }
}

/// The program with a window of a scene, under the validation layer.
fn watched(bench: &Bench, scene: &str, flags: &[&str]) -> Command {
    let mut command = bench.command(&[&["view", "--window", scene][..], flags].concat());
    command.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    command.env("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT");
    command
}

/// Returns nothing, with a message; panics if a screen is required.
fn skipped<T>(why: &str) -> Option<T> {
    assert!(env::var_os("TRIMARAN_REQUIRE_SCREEN").is_none(), "{why}");
    println!("skipped: {why}");
    None
}

/// A window of the program, at the upper left of the screen.
pub(crate) struct Window<'s> {
    screen: &'s Screen,
    program: Child,
    id: String,
}

impl Window<'_> {
    /// Runs a command of `xdotool` on it, with the arguments after the window.
    pub(crate) fn xdotool(&self, command: &[&str]) -> String {
        let args = [&command[..1], &[&self.id], &command[1..]].concat();
        self.screen.xdotool(&args).unwrap_or_else(|| panic!("{args:?}"))
    }

    /// Presses keys or moves the pointer, as if by hand.
    pub(crate) fn by_hand(&self, command: &[&str]) {
        self.screen.xdotool(command).unwrap_or_else(|| panic!("{command:?}"));
    }

    pub(crate) fn title(&self) -> String {
        self.xdotool(&["getwindowname"]).trim().to_owned()
    }

    /// The eye's position in the title.
    pub(crate) fn eye(&self) -> [f64; 3] {
        let title = self.title();
        let (_, place) = title.split_once("eye at ").unwrap_or_else(|| panic!("{title}"));
        let mut numbers = place.split([' ', ',']).map(|number| number.parse::<f64>().unwrap());
        [(); 3].map(|()| numbers.next().unwrap())
    }

    /// Waits until the eye rests. Returns its position.
    pub(crate) fn rests(&self) -> [f64; 3] {
        wait_for("rest", || {
            let before = self.title();
            thread::sleep(4 * PAUSE);
            (before == self.title() && !before.contains("pictures")).then(|| self.eye())
        })
    }

    pub(crate) fn id(&self) -> u32 {
        self.program.id()
    }

    /// Waits until the program has ended. Returns its status and output.
    pub(crate) fn end(mut self) -> (ExitStatus, String) {
        let status = wait_for("the program's end", || self.program.try_wait().unwrap());
        (status, self.said())
    }

    /// All the program's output until its end.
    fn said(&mut self) -> String {
        let mut said = String::new();
        self.program.stdout.take().unwrap().read_to_string(&mut said).unwrap();
        self.program.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        said
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        let _ended = self.program.kill();
        let _code = self.program.wait();
    }
}
