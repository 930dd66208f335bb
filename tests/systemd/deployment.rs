//! Services on one machine, installed as docs/operations.md describes.

use std::fs::{self, File, Permissions};
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use crate::common::program::Bench;
use crate::machine::Machine;
use crate::package::package;

/// The services, and the port of each one's metrics.
pub(crate) const DISPLAY: (&str, u16) = ("trimaran-display", 9464);
pub(crate) const ONE: (&str, u16) = ("trimaran-culler@one", 9465);
pub(crate) const TWO: (&str, u16) = ("trimaran-culler@two", 9466);

/// The folder of the display's report.
pub(crate) const REPORT: &str = "/var/lib/trimaran/walk";
/// The display's folder for the page's commands, with the package and a scene at first.
pub(crate) const CHECKOUT: &str = "/run/home/show";
/// The names of the page's three hosts in its command lines, and the one for browsers.
pub(crate) const HOSTS: [&str; 3] = ["one", "two", "show"];
const PAGES_HOST: &str = "pages";
/// In place of scp: puts the files into the folder for the commands of the host that is named last.
const SCP: &str = r#"#!/bin/sh -eu
for to; do :; done
to=${to#root@}
mkdir -p "/run/home/${to%:}"
for file; do
    case $file in -r | root@*) ;; *) cp -r "$file" "/run/home/${to%:}/" ;; esac
done
"#;

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
        Self::longer(0)
    }

    /// The same with this many frames more, which take time to find a path for.
    pub(crate) fn longer(frames: usize) -> Self {
        Self::of(20_000 + frames, 256, 200)
    }

    fn of(frames: usize, size: u32, audit_every: usize) -> Self {
        Self { bench: Bench::with_plant(300), frames, size, audit_every }
    }

    /// Puts the files for the page's commands into the machine, and runs all of them there.
    pub(crate) fn install(&self, machine: &Machine, over: Over) {
        self.prepare(&[machine]);
        run_commands_of_the_page(&HOSTS.map(|host| (host, machine)), |made| {
            // All on one machine, the roles take configurations of their own.
            for (host, role) in [("one", "one"), ("two", "two"), ("show", "display")] {
                let file = made.join(host).join(format!("{role}.toml"));
                fs::write(file, self.configuration(role, over)).unwrap();
            }
        });
    }

    /// The same on a machine for each of [`HOSTS`]. `more` is added to each role's configuration.
    pub(crate) fn install_on(&self, machines: [&Machine; 3], more: impl Fn(&str) -> String) {
        self.prepare(&machines);
        let hosts = [0, 1, 2].map(|index| (HOSTS[index], machines[index]));
        run_commands_of_the_page(&hosts, |made| {
            for (host, role) in [("one", "one"), ("two", "two"), ("show", "display")] {
                let mut file =
                    File::options().append(true).open(made.join(host).join(format!("{role}.toml"))).unwrap();
                writeln!(file, "{}", more(role)).unwrap();
                if role == "display" {
                    writeln!(file, "{}", self.session()).unwrap();
                }
            }
        });
    }

    /// Puts the files for the page's commands into the machines, of which the last is the display's.
    fn prepare(&self, machines: &[&Machine]) {
        for machine in machines {
            // A role that vanishes without a close is missed soon.
            let of_all = "/etc/systemd/system/trimaran-.service.d";
            machine.run(&format!("mkdir {of_all}"));
            let section = "[Service]\nEnvironment=TRIMARAN_LINK_IDLE_TIMEOUT_S=4\n";
            fs::write(machine.path(&format!("{of_all}/soon.conf")), section).unwrap();
            let scp = machine.path("/usr/bin/scp");
            fs::write(&scp, SCP).unwrap();
            fs::set_permissions(scp, Permissions::from_mode(0o755)).unwrap();
        }
        put_checkout(machines.last().unwrap(), HOSTS[2], &self.bench);
    }

    /// The walk's keys in the display's configuration.
    fn session(&self) -> String {
        let Self { frames, size, audit_every, .. } = self;
        format!(
            "session = {{ frames = {frames}, width = {size}, height = {size}, audit_every = {audit_every} }}"
        )
    }

    fn configuration(&self, role: &str, over: Over) -> String {
        let [one, two] = match over {
            Over::Quic => ["quic://127.0.0.1:7400", "quic://127.0.0.1:7401"],
            Over::Unix => ["unix:/run/trimaran/one.sock", "unix:/run/trimaran/two.sock"],
        };
        match role {
            "display" => format!(
                "scene = 'plant.scene'\ncullers = ['{one}', '{two}']\nout = '{REPORT}'\nmetrics = '127.0.0.1:{}'\n\
                 keys = '/run/credentials/trimaran-display.service/keys'\npeers.cullers = ['one.pub', 'two.pub']\n\
                 {}\n",
                DISPLAY.1,
                self.session(),
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

    pub(crate) fn report(machine: &Machine) -> serde_json::Value {
        let report = fs::read(machine.path(REPORT).join("report.json")).unwrap();
        serde_json::from_slice(&report).unwrap()
    }
}

/// Installs the service for browsers, and returns its token.
pub(crate) fn install_pages(machine: &Machine) -> String {
    put_checkout(machine, PAGES_HOST, &Bench::with_plant(100));
    run_commands_of_the_page(&[(PAGES_HOST, machine)], |_| ());
    let variables = fs::read_to_string(machine.path("/etc/trimaran/plant.env")).unwrap();
    let token = variables.lines().find_map(|line| line.strip_prefix("TRIMARAN_TOKEN="));
    token.unwrap_or_else(|| panic!("{variables}")).to_owned()
}

/// The folder for the page's commands of a host, with the package and the scene of `bench`.
fn put_checkout(machine: &Machine, host: &str, bench: &Bench) {
    let checkout = machine.path(&home(host));
    fs::create_dir_all(&checkout).unwrap();
    for file in [package().to_owned(), bench.path("plant.scene")] {
        fs::copy(&file, checkout.join(file.file_name().unwrap())).unwrap();
    }
}

fn home(host: &str) -> String {
    format!("/run/home/{host}")
}

/// Runs the commands for these hosts in the section about services, each in its host's folder. Once a
/// command has made the folder `deployment`, `edit` changes it.
fn run_commands_of_the_page(hosts: &[(&str, &Machine)], edit: impl Fn(&Path)) {
    for (host, command) in commands_of_the_page("Services") {
        let Some((_, machine)) = hosts.iter().find(|(name, _)| *name == host) else { continue };
        machine.run(&format!("cd {}; {command}", home(&host)));
        if command.starts_with("trimaran deployment ") {
            edit(&machine.path(&home(&host)).join("deployment"));
        }
        if command.starts_with("scp ") {
            deliver(machine, hosts);
        }
    }
}

/// Moves what a machine has sent to others.
fn deliver(from: &Machine, hosts: &[(&str, &Machine)]) {
    for (host, to) in hosts.iter().filter(|(_, to)| to.init() != from.init()) {
        let sent = from.path(&home(host));
        if sent.exists() {
            fs::create_dir_all(to.path("/run/home")).unwrap();
            let copied = Command::new("cp").arg("-r").arg(&sent).arg(to.path("/run/home/")).status();
            assert!(copied.unwrap().success(), "{host}");
            fs::remove_dir_all(sent).unwrap();
        }
    }
}

/// The command lines of a section of the page, each with its host.
pub(crate) fn commands_of_the_page(section: &str) -> Vec<(String, String)> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/operations.md");
    let page = fs::read_to_string(page).unwrap();
    let (_, after) = page.split_once(&format!("\n## {section}\n")).unwrap();
    let (section, _) = after.split_once("\n## ").unwrap();
    let commands = section.lines().filter_map(|line| {
        let (host, command) = line.split_once("$ ")?;
        Some((host.trim().to_owned(), command.to_owned()))
    });
    commands.collect()
}
