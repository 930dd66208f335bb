//! A display and two cullers, each a process with a configuration of its own.

use std::{fs, path::PathBuf, thread, time::Duration};

use serde_json::Value;

use super::program::{Bench, Process, printed};

/// The cullers.
pub(crate) const CULLERS: [&str; 2] = ["culler-1", "culler-2"];
/// More frames than there is time for, and large ones: a walk is interrupted once it has shown enough. Ten
/// times as many take seconds to find a path for.
pub(crate) const ENDLESS: usize = 10_000;
/// One frame in this many is checked.
const AUDIT_EVERY: usize = 200;

/// The machine of a role.
#[derive(Clone)]
pub(crate) struct Place {
    /// Its address for others.
    pub(crate) address: String,
    /// Its network namespace, if it has one of its own.
    pub(crate) namespace: Option<String>,
}

/// A folder with a scene, keys and a configuration for each role.
pub(crate) struct Deployment {
    bench: Bench,
    /// The machines of the cullers and the display.
    places: [Place; 3],
}

impl Deployment {
    /// All on this machine; the cullers listen at these ports.
    pub(crate) fn here(transport: &str, ports: [u16; 2]) -> Self {
        let place = Place { address: "127.0.0.1".to_owned(), namespace: None };
        Self::at(transport, ports, [place.clone(), place.clone(), place])
    }

    /// The cullers listen, each at its port, and the display connects.
    pub(crate) fn at(transport: &str, ports: [u16; 2], places: [Place; 3]) -> Self {
        let at = |culler: usize| format!("'{transport}://{}:{}'", places[culler].address, ports[culler]);
        let cullers = [0, 1].map(|culler| format!("listen = {}", at(culler)));
        let display = format!("cullers = [{}, {}]", at(0), at(1));
        Self::of(&display, &cullers, places.clone())
    }

    /// All on this machine: the display listens at this port, and the cullers connect.
    pub(crate) fn with_listening_display(transport: &str, port: u16) -> Self {
        let place = Place { address: "127.0.0.1".to_owned(), namespace: None };
        let display = format!("{transport}://127.0.0.1:{port}");
        let cullers = [(); 2].map(|()| format!("displays = '{display}'"));
        Self::of(&format!("listen = '{display}'"), &cullers, [place.clone(), place.clone(), place])
    }

    fn of(display: &str, cullers: &[String; 2], places: [Place; 3]) -> Self {
        let bench = Bench::with_plant(300);
        for name in CULLERS.into_iter().chain(["display"]) {
            bench.done(&["keys", "new", name, "--out", "."]);
        }
        bench.write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\n{display}\nout = 'walk'\nkeys = 'display.key'\n\
                 peers.cullers = ['culler-1.pub', 'culler-2.pub']\n\
                 [session]\nframes = {ENDLESS}\nwidth = 512\nheight = 512\naudit_every = {AUDIT_EVERY}\n"
            ),
        );
        for (name, finds) in CULLERS.iter().zip(cullers) {
            let known = format!("keys = '{name}.key'\npeers.displays = ['display.pub']\n");
            bench.write(&format!("{name}.toml"), format!("scene = 'plant.scene'\n{finds}\n{known}"));
        }
        Self { bench, places }
    }

    pub(crate) fn start(&self, name: &str, more: &[&str]) -> Process {
        self.start_by(env!("CARGO_BIN_EXE_trimaran"), name, more)
    }

    /// As [`start`](Self::start), by another program.
    pub(crate) fn start_by(&self, program: &str, name: &str, more: &[&str]) -> Process {
        let culler = CULLERS.iter().position(|culler| *culler == name);
        let kind = if culler.is_some() { "culler" } else { "display" };
        let mut command = match &self.places[culler.unwrap_or(2)].namespace {
            Some(namespace) => self.bench.command_of("ip", &["netns", "exec", namespace, program]),
            None => self.bench.command_of(program, &[]),
        };
        command.args(["role", kind, "--config", &format!("{name}.toml")]);
        // A role that vanishes without a close is missed soon.
        command.env("TRIMARAN_LOG", "info").env("TRIMARAN_LINK_IDLE_TIMEOUT_S", "3");
        Process::start(command.args(more))
    }

    /// Starts both cullers.
    pub(crate) fn start_cullers(&self, more: &[&str]) -> [Process; 2] {
        CULLERS.map(|culler| self.start(culler, more))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.bench.path(name)
    }

    /// The report in the folder `out`.
    pub(crate) fn report(&self, out: &str) -> Value {
        self.bench.report(out)
    }

    /// How many frames of a walk in progress are on disk.
    pub(crate) fn shown(&self) -> usize {
        self.shown_in("walk")
    }

    /// The same of the walk in the folder `out`.
    pub(crate) fn shown_in(&self, out: &str) -> usize {
        let journal = self.bench.path(out).join("unfinished/walk.jsonl");
        let journal = fs::read_to_string(journal).unwrap_or_default();
        journal.matches("\n{\"frame\":").count()
    }

    /// Waits until the walk has advanced by this many frames.
    pub(crate) fn shows(&self, more: usize) {
        let before = self.shown();
        while self.shown() < before + more {
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Interrupts a walking display and checks its exit code. Returns its report, which has every frame once
    /// and in order, and the display's output. An interrupted display skips checks that take long.
    pub(crate) fn interrupted(&self, display: Process) -> (Value, String) {
        display.interrupt();
        let said = display.ends(3);
        let report = self.report_in_order();
        assert_eq!(report["summary"]["ended"]["how"], "interrupted", "{said}");
        (report, said)
    }

    /// The report of a walk that is over, with all its checks: every frame is there once and in order, and
    /// those that were checked are exact.
    pub(crate) fn whole_report(&self) -> Value {
        self.complete_by(env!("CARGO_BIN_EXE_trimaran"), "walk");
        let report = self.report_in_order();
        for frame in report["frames"].as_array().unwrap().iter().step_by(AUDIT_EVERY) {
            assert_eq!(frame["cut_mismatch_pixels"], 0, "{frame}");
        }
        report
    }

    /// Adds what the report in the folder `out` lacks, by this program.
    pub(crate) fn complete_by(&self, program: &str, out: &str) {
        if self.bench.path(out).join("unchecked.json").exists() {
            printed(&self.bench.command_of(program, &["report", out]).output().unwrap());
        }
    }

    fn report_in_order(&self) -> Value {
        let report = self.bench.report("walk");
        for (number, frame) in report["frames"].as_array().unwrap().iter().enumerate() {
            assert_eq!(frame["frame"], number, "{}", report["run"]["notes"]);
            assert!(matches!(frame["cut_mismatch_pixels"].as_u64(), None | Some(0)), "{frame}");
        }
        report
    }
}

/// Whether one of the report's notes has all of these words.
pub(crate) fn notes(report: &Value, words: &[&str]) -> bool {
    let notes = report["run"]["notes"].as_array().unwrap();
    notes.iter().any(|note| words.iter().all(|word| note.as_str().unwrap().contains(word)))
}

/// The machines that culled a walk's frames, each once, in the order of their names.
pub(crate) fn culled_by(report: &Value) -> Vec<&str> {
    let frames = report["frames"].as_array().unwrap();
    let mut machines: Vec<_> = frames.iter().map(|frame| frame["culled_by"].as_str().unwrap()).collect();
    machines.sort_unstable();
    machines.dedup();
    machines
}

impl Process {
    /// Asks it to stop, as `systemctl restart` does.
    pub(crate) fn interrupt(&self) {
        self.signal("TERM");
    }
}
