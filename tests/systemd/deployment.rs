//! Services on one machine, installed as docs/operations.md describes.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::program::Bench;
use crate::machine::Machine;
use crate::package::package;

/// The services, and the port of each one's metrics.
pub(crate) const DISPLAY: (&str, u16) = ("trimaran-display", 9464);
pub(crate) const ONE: (&str, u16) = ("trimaran-culler@one", 9465);
pub(crate) const TWO: (&str, u16) = ("trimaran-culler@two", 9466);

/// The folder of the display's report.
const REPORT: &str = "/var/lib/trimaran/walk";
/// The folder for the page's commands: the package, a scene, keys and configurations.
pub(crate) const CHECKOUT: &str = "/run/checkout";
/// The names of the page's three hosts in its command lines, and the one for browsers.
const HOSTS: [&str; 3] = ["one", "two", "show"];
const PAGES_HOST: &str = "pages";

/// The service for browsers, and its port.
pub(crate) const PAGES: (&str, u16) = ("trimaran-serve@plant", 7480);

/// The roles' transport.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Over {
    Quic,
    Unix,
}

/// A scene and keys, and the walk of the services.
pub(crate) struct Walk {
    bench: Bench,
    frames: usize,
    /// The side of a picture, pixels.
    size: u32,
    audit_every: usize,
}

impl Walk {
    /// A walk of this many frames, with the pictures of a single process.
    pub(crate) fn in_one_process(frames: usize) -> Self {
        let walk = Self::of(frames, 64, 0);
        let count = frames.to_string();
        let size = ["--size", "64x64", "--audit-every", "0", "--frames", &count];
        walk.bench.done(&[&["run", "plant.scene", "--out", "walk"], &size[..]].concat());
        walk
    }

    /// A walk to be stopped once it has shown enough.
    pub(crate) fn endless() -> Self {
        Self::of(20_000, 256, 200)
    }

    fn of(frames: usize, size: u32, audit_every: usize) -> Self {
        let bench = Bench::with_plant(300);
        for host in HOSTS {
            bench.done(&["keys", "new", host]);
        }
        Self { bench, frames, size, audit_every }
    }

    /// Puts the files for the page's commands into the machine, and runs all of them there.
    pub(crate) fn install(&self, machine: &Machine, over: Over) {
        let checkout = put_checkout(machine, &self.bench);
        for role in ["display", "one", "two"] {
            fs::write(checkout.join(format!("{role}.toml")), self.configuration(role, over)).unwrap();
        }
        // A role that vanishes without a close is missed soon.
        let of_all = "/etc/systemd/system/trimaran-.service.d";
        machine.run(&format!("mkdir {of_all}"));
        let section = "[Service]\nEnvironment=TRIMARAN_LINK_IDLE_TIMEOUT_S=4\n";
        fs::write(machine.path(&format!("{of_all}/soon.conf")), section).unwrap();
        run_commands_of_the_page(machine, &HOSTS);
    }

    fn configuration(&self, role: &str, over: Over) -> String {
        let [one, two] = match over {
            Over::Quic => ["quic://127.0.0.1:7400", "quic://127.0.0.1:7401"],
            Over::Unix => ["unix:/run/trimaran/one.sock", "unix:/run/trimaran/two.sock"],
        };
        let Self { frames, size, audit_every, .. } = self;
        match role {
            "display" => format!(
                "scene = 'plant.scene'\ncullers = ['{one}', '{two}']\nout = '{REPORT}'\nmetrics = '127.0.0.1:{}'\n\
                 keys = '/run/credentials/trimaran-display.service/keys'\npeers.cullers = ['one.pub', 'two.pub']\n\
                 session = {{ frames = {frames}, width = {size}, height = {size}, audit_every = {audit_every} }}\n",
                DISPLAY.1
            ),
            name => {
                let (listen, metrics) = if name == "one" { (one, ONE.1) } else { (two, TWO.1) };
                format!(
                    "scene = 'plant.scene'\nlisten = '{listen}'\nmetrics = '127.0.0.1:{metrics}'\n\
                     keys = '/run/credentials/trimaran-culler@{name}.service/keys'\npeers.displays = ['show.pub']\n"
                )
            }
        }
    }

    /// Waits until the walk has ended, and compares its pictures.
    pub(crate) fn is_shown(&self, machine: &Machine) {
        let state = machine.wait_for("the end of the walk", || {
            let state = machine.run("systemctl show -P ActiveState trimaran-display");
            ["inactive", "failed"].contains(&&*state).then_some(state)
        });
        assert_eq!(state, "inactive");
        let (shown, report) = (machine.path(REPORT), Self::report(machine));
        assert_eq!(report["frames"].as_array().unwrap().len(), self.frames, "{}", report["run"]["notes"]);
        for number in 0..self.frames {
            let name = format!("frames/{number:05}.png");
            let [shown, expected] =
                [&shown, &self.bench.path("walk")].map(|folder| fs::read(folder.join(&name)).unwrap());
            assert!(shown == expected, "{name} is another picture");
        }
        fs::remove_dir_all(shown).unwrap();
    }

    /// Stops the display. The report has every frame until then once and in order, and the checked ones are
    /// exact.
    pub(crate) fn is_stopped(&self, machine: &Machine) -> serde_json::Value {
        machine.run("systemctl stop trimaran-display");
        let mut report = Self::report(machine);
        assert_eq!(report["summary"]["ended"]["how"], "interrupted");
        if machine.path(&format!("{REPORT}/unchecked.json")).exists() {
            // The remaining checks are done now.
            machine.run(&format!("trimaran report {REPORT}"));
            report = Self::report(machine);
        }
        for (number, frame) in report["frames"].as_array().unwrap().iter().enumerate() {
            assert_eq!(frame["frame"], number, "{}", report["run"]["notes"]);
            if number % self.audit_every == 0 {
                assert_eq!(frame["cut_mismatch_pixels"], 0, "{frame}");
            }
        }
        fs::remove_dir_all(machine.path(REPORT)).unwrap();
        report
    }

    fn report(machine: &Machine) -> serde_json::Value {
        let report = fs::read(machine.path(REPORT).join("report.json")).unwrap();
        serde_json::from_slice(&report).unwrap()
    }
}

/// Installs the service for browsers, and returns its token.
pub(crate) fn install_pages(machine: &Machine) -> String {
    put_checkout(machine, &Bench::with_plant(100));
    run_commands_of_the_page(machine, &[PAGES_HOST]);
    let variables = fs::read_to_string(machine.path("/etc/trimaran/plant.env")).unwrap();
    let token = variables.lines().find_map(|line| line.strip_prefix("TRIMARAN_TOKEN="));
    token.unwrap_or_else(|| panic!("{variables}")).to_owned()
}

/// The files for the page's commands, with those of `bench`.
fn put_checkout(machine: &Machine, bench: &Bench) -> PathBuf {
    let checkout = machine.path(CHECKOUT);
    fs::create_dir_all(&checkout).unwrap();
    let package = package();
    fs::copy(package, checkout.join(package.file_name().unwrap())).unwrap();
    for entry in fs::read_dir(bench.path("")).unwrap().map(Result::unwrap) {
        if entry.file_type().unwrap().is_file() {
            fs::copy(entry.path(), checkout.join(entry.file_name())).unwrap();
        }
    }
    checkout
}

fn run_commands_of_the_page(machine: &Machine, hosts: &[&str]) {
    for command in commands_of_the_page(hosts) {
        machine.run(&format!("cd {CHECKOUT}; {command}"));
    }
}

/// The command lines for these hosts in the section about services.
fn commands_of_the_page(hosts: &[&str]) -> Vec<String> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/operations.md");
    let page = fs::read_to_string(page).unwrap();
    let (_, after) = page.split_once("\n## Services\n").unwrap();
    let (section, _) = after.split_once("\n## ").unwrap();
    let commands = section.lines().filter_map(|line| {
        let (host, command) = line.split_once("$ ")?;
        hosts.contains(&host.trim()).then(|| command.to_owned())
    });
    commands.collect()
}
