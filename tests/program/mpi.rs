//! `examples/mpi/walk.sh` under a real mpirun, all on this machine.
//!
//! Without Open MPI the test says that it is skipped, and fails if `TRIMARAN_REQUIRE_MPI` is 1.

use std::{
    env, fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use crate::common::deployment::{culled_by, notes};
use crate::common::ports::unused_port;
use crate::common::program::{Bench, Process, signal};

/// A walk by the clock, of 8 s on any machine.
const LONG: [&str; 5] = ["--live=25", "--frames=200", "--width=64", "--height=64", "--audit-every=0"];
/// How long mpirun waits before it passes a signal on, and then before it kills, seconds.
const GRACE_S: &str = "4";

struct Walks {
    bench: Bench,
    port: String,
}

impl Walks {
    fn here() -> Option<Self> {
        let found = Command::new("mpirun").arg("--version").stdout(Stdio::null()).status();
        if !found.is_ok_and(|status| status.success()) {
            assert_ne!(env::var("TRIMARAN_REQUIRE_MPI").as_deref(), Ok("1"), "there is no mpirun");
            println!("skipped: there is no mpirun: install openmpi-bin");
            return None;
        }
        Some(Self { bench: Bench::with_plant(60), port: unused_port().to_string() })
    }

    /// Starts a display and two cullers.
    fn start(&self, flags: &[&str]) -> Process {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/mpi/walk.sh");
        let hosts = ["plant.scene", "walk", "localhost", "localhost,localhost"];
        let mut command = self.bench.command_of(script.to_str().unwrap(), &[&hosts[..], flags].concat());
        let program = Path::new(env!("CARGO_BIN_EXE_trimaran")).parent().unwrap();
        let path = format!("{}:{}", program.display(), env::var("PATH").unwrap());
        command.env("PATH", path).env("PORT", &self.port).env("GRACE_S", GRACE_S);
        // As root, and with more processes than cores.
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
        command.env("OMPI_MCA_rmaps_base_oversubscribe", "1");
        Process::start(&mut command)
    }

    fn shown(&self) -> usize {
        let journal = fs::read_to_string(self.bench.path("walk/unfinished/walk.jsonl"));
        journal.unwrap_or_default().matches("\n{\"frame\":").count()
    }

    /// Starts a walk, and waits until it has shown some frames.
    fn walking(&self, flags: &[&str]) -> Process {
        let walk = self.start(flags);
        let before = self.shown();
        while self.shown() < before + 10 {
            thread::sleep(Duration::from_millis(20));
        }
        walk
    }

    /// The cullers of these walks: no others know their port.
    fn cullers(&self) -> Vec<String> {
        let all = fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().path());
        let is_ours = |process: &Path| {
            let command = fs::read_to_string(process.join("cmdline")).unwrap_or_default();
            let mut words = command.split('\0');
            words.next() == Some("trimaran") && words.nth(1) == Some("culler") && command.contains(&self.port)
        };
        let ours = all.filter(|process| is_ours(process));
        ours.map(|process| process.file_name().unwrap().to_string_lossy().into_owned()).collect()
    }
}

#[test]
fn mpirun_ends_with_the_walk_goes_on_without_a_culler_and_leaves_a_report() {
    let Some(walks) = Walks::here() else { return };
    walks.start(&["--frames=20", "--width=64", "--height=64"]).ends(0);
    let report = walks.bench.report("walk");
    assert_eq!(culled_by(&report), ["culler 1", "culler 2"]);
    assert_eq!(walks.cullers(), Vec::<String>::new(), "they have ended as well");

    // Half as long, since nothing has to wait.
    let walk = walks.walking(&["--live=50", "--frames=200", "--width=64", "--height=64", "--audit-every=0"]);
    signal("KILL", &walks.cullers()[0]);
    walk.ends(0);
    let report = walks.bench.report("walk");
    assert_eq!(report["summary"]["ended"]["how"], "finished");
    assert!(notes(&report, &["was lost before"]), "{}", report["run"]["notes"]);

    let walk = walks.walking(&LONG);
    walk.signal("TERM");
    let (code, said) = walk.ended();
    assert_ne!(code, Some(0), "{said}");
    assert_eq!(walks.bench.report("walk")["summary"]["ended"]["how"], "interrupted", "{said}");

    // Started again, it goes on.
    walks.start(&LONG).ends(0);
    let report = walks.bench.report("walk");
    assert_eq!(report["summary"]["ended"]["how"], "finished");
    assert!(notes(&report, &["the display stopped before frame"]), "{}", report["run"]["notes"]);
}
