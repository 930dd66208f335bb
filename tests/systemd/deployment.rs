//! Three services on one machine, installed as docs/operations.md says.

use std::fs;
use std::path::Path;

use crate::machine::Machine;
use crate::program::Bench;

/// The services, and where each shows what its links carry.
pub(crate) const DISPLAY: (&str, u16) = ("trimaran-display", 9464);
pub(crate) const FIRST: (&str, u16) = ("trimaran-culler@first", 9465);
pub(crate) const SECOND: (&str, u16) = ("trimaran-culler@second", 9466);

/// Where the display's report lies.
const REPORT: &str = "/var/lib/trimaran/walk";
/// Where the page's commands are run: a checkout with a scene, keys and configurations.
const CHECKOUT: &str = "/run/checkout";
/// What the page's three hosts are called in its command lines.
const HOSTS: [&str; 3] = ["one", "two", "show"];

/// How the roles reach each other.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Over {
    Quic,
    Unix,
}

/// A scene and keys, and the pictures of a walk in one process.
pub(crate) struct Walk {
    bench: Bench,
    frames: usize,
}

impl Walk {
    pub(crate) fn in_one_process(frames: usize) -> Self {
        let bench = Bench::with_plant(300);
        let count = frames.to_string();
        let size = ["--size", "64x64", "--audit-every", "0", "--frames", &count];
        bench.done(&[&["run", "plant.scene", "--out", "walk"], &size[..]].concat());
        for host in HOSTS {
            bench.done(&["keys", "new", host]);
        }
        Self { bench, frames }
    }

    /// Puts what the page's commands need into the machine, and runs all of them there.
    pub(crate) fn install(&self, machine: &Machine, over: Over) {
        let checkout = machine.path(CHECKOUT);
        fs::create_dir_all(checkout.join("target/release")).unwrap();
        fs::copy(env!("CARGO_BIN_EXE_trimaran"), checkout.join("target/release/trimaran")).unwrap();
        copy_files(
            &Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/systemd"),
            &checkout.join("deploy/systemd"),
        );
        copy_files(&self.bench.path(""), &checkout);
        for role in ["display", "first", "second"] {
            fs::write(checkout.join(format!("{role}.toml")), self.configuration(role, over)).unwrap();
        }
        // What is gone without a word is missed soon.
        let environment = "TRIMARAN_LOG=info\nTRIMARAN_LINK_IDLE_TIMEOUT_S=4\n";
        fs::write(machine.path("/etc/default/trimaran"), environment).unwrap();
        for command in commands_of_the_page() {
            machine.run(&format!("cd {CHECKOUT}; {command}"));
        }
    }

    fn configuration(&self, role: &str, over: Over) -> String {
        let [show, pair] = match over {
            Over::Quic => ["quic://127.0.0.1:7400", "quic://127.0.0.1:7401"],
            Over::Unix => ["unix:/run/trimaran/display.sock", "unix:/run/trimaran/pair.sock"],
        };
        let frames = self.frames;
        match role {
            "display" => format!(
                "scene = 'plant.scene'\nlisten = '{show}'\nout = '{REPORT}'\nmetrics = '127.0.0.1:{}'\n\
                 keys = '/run/credentials/trimaran-display.service/keys'\npeers = {{ first = 'one.pub', second = 'two.pub' }}\n\
                 session = {{ frames = {frames}, width = 64, height = 64, audit_every = 0 }}\n",
                DISPLAY.1
            ),
            index => {
                let (other, metrics) = if index == "first" { ("two", FIRST.1) } else { ("one", SECOND.1) };
                format!(
                    "scene = 'plant.scene'\nindex = '{index}'\ndisplay = '{show}'\npair = '{pair}'\n\
                     keys = '/run/credentials/trimaran-culler@{index}.service/keys'\n\
                     peers = {{ display = 'show.pub', other = '{other}.pub' }}\nmetrics = '127.0.0.1:{metrics}'\n"
                )
            }
        }
    }

    /// Waits until the walk has ended, and compares its pictures. Gives the report.
    pub(crate) fn is_shown(&self, machine: &Machine) -> serde_json::Value {
        let state = machine.wait_for("the end of the walk", || {
            let state = machine.run("systemctl show -P ActiveState trimaran-display");
            ["inactive", "failed"].contains(&&*state).then_some(state)
        });
        assert_eq!(state, "inactive");
        let shown = machine.path(REPORT);
        let report = fs::read(shown.join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        assert_eq!(report["frames"].as_array().unwrap().len(), self.frames, "{}", report["run"]["notes"]);
        for number in 0..self.frames {
            let name = format!("frames/{number:05}.png");
            let [shown, expected] =
                [&shown, &self.bench.path("walk")].map(|folder| fs::read(folder.join(&name)).unwrap());
            assert!(shown == expected, "{name} is another picture");
        }
        fs::remove_dir_all(shown).unwrap();
        report
    }
}

fn copy_files(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        if entry.file_type().unwrap().is_file() {
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
}

/// The command lines of the section about services, whichever host they are for.
fn commands_of_the_page() -> Vec<String> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/operations.md");
    let page = fs::read_to_string(page).unwrap();
    let (_, after) = page.split_once("\n## Services\n").unwrap();
    let (section, _) = after.split_once("\n## ").unwrap();
    let commands = section.lines().filter_map(|line| {
        let (host, command) = line.split_once("$ ")?;
        HOSTS.contains(&host.trim()).then(|| command.to_owned())
    });
    commands.collect()
}
