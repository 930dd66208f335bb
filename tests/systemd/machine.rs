//! A machine of its own for services: `machine.sh`, and actions in it.

use std::env;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{self, Child, ChildStdin, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

/// The timeout of waits.
const GUARD: Duration = Duration::from_secs(120);

/// A running systemd. It ends, with all that it has started, on drop or with this process, however that ends.
pub(crate) struct Machine {
    supervisor: Child,
    /// Open until it must end.
    input: Option<ChildStdin>,
    group: PathBuf,
    /// Process 1, by this machine's number.
    init: u32,
}

impl Machine {
    /// Boots one with a name unique to the test. `None`, which skips the test, if that is impossible and
    /// `TRIMARAN_REQUIRE_SYSTEMD` is not set.
    pub(crate) fn boot(name: &str) -> Option<Self> {
        let groups = match groups() {
            Ok(groups) => groups,
            Err(missing) => {
                assert_ne!(env::var("TRIMARAN_REQUIRE_SYSTEMD").as_deref(), Ok("1"), "{missing}");
                println!("skipped: {missing}");
                return None;
            }
        };
        let group = groups.join(format!("trimaran-{name}-{}", process::id()));
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/systemd/machine.sh");
        // In a process group of its own, Ctrl-C does not end it before it has tidied up.
        let mut supervisor =
            Command::new(script).arg(&group).stdin(Stdio::piped()).process_group(0).spawn().unwrap();
        let input = supervisor.stdin.take();
        let mut machine = Self { supervisor, input, group, init: 0 };
        let scope = machine.group.join("init.scope/cgroup.procs");
        machine.init = machine.wait_for("process 1", || {
            let processes = fs::read_to_string(&scope).ok()?;
            processes.lines().next()?.parse().ok()
        });
        machine.wait_for("the boot", || {
            let state = machine.shell("systemctl is-system-running").output().unwrap().stdout;
            (state.trim_ascii() == b"running").then_some(())
        });
        Some(machine)
    }

    /// The number of its process 1 on this machine.
    pub(crate) const fn init(&self) -> u32 {
        self.init
    }

    /// A file or folder of the machine, by its path on this machine.
    pub(crate) fn path(&self, absolute: &str) -> PathBuf {
        PathBuf::from(format!("/proc/{}/root{absolute}", self.init))
    }

    /// Runs a command line in it, which must succeed, and returns its output.
    pub(crate) fn run(&self, line: &str) -> String {
        let Output { status, stdout, stderr } = self.shell(line).output().unwrap();
        let [said, complaint] = [stdout, stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(status.success(), "{line}: {status}: {said}{complaint}");
        said.trim_end().to_owned()
    }

    /// A shell in a folder of the machine's own.
    fn shell(&self, line: &str) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.init.to_string(), "--all", "--wdns=/run", "env", "-i"]);
        command.arg("PATH=/usr/sbin:/usr/bin:/sbin:/bin").args(["sh", "-euc", line]);
        command.stdin(Stdio::null());
        command
    }

    /// The number of a service's main process; 0 if there is none.
    pub(crate) fn main_process(&self, service: &str) -> String {
        self.run(&format!("systemctl show -P MainPID {service}"))
    }

    /// Waits until a service has another main process than `before`.
    pub(crate) fn wait_for_another_process(&self, service: &str, before: &str) {
        self.wait_for("the next process", || {
            (!["0", before].contains(&&*self.main_process(service))).then_some(())
        });
    }

    /// The answer to an HTTP request at a port of the machine's loopback, if there is one.
    pub(crate) fn get(&self, port: u16, path: &str) -> Option<String> {
        let namespace = fs::File::open(format!("/proc/{}/ns/net", self.init)).unwrap();
        let ask = || {
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
            stream.set_read_timeout(Some(GUARD)).unwrap();
            write!(stream, "GET {path} HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\n\r\n").ok()?;
            let mut answer = String::new();
            stream.read_to_string(&mut answer).ok()?;
            Some(answer.split_once("\r\n\r\n")?.1.to_owned())
        };
        // Sockets made there stay there; the thread does not come back.
        thread::scope(|scope| scope.spawn(ask).join().unwrap())
    }

    /// Repeats a request until there is an answer.
    pub(crate) fn wait_for<T>(&self, what: &str, mut answer: impl FnMut() -> Option<T>) -> T {
        let start = Instant::now();
        loop {
            if let Some(answer) = answer() {
                return answer;
            }
            assert!(start.elapsed() < GUARD, "{what} did not come about in {GUARD:?}");
            thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        if thread::panicking() && self.init != 0 {
            let journal = self.shell("journalctl --no-pager --output short-monotonic --lines 200").output();
            let said = journal.map(|journal| String::from_utf8_lossy(&journal.stdout).into_owned());
            eprintln!("the machine's journal: {}", said.unwrap_or_else(|error| error.to_string()));
        }
        drop(self.input.take());
        let _ = self.supervisor.wait();
    }
}

/// The folder for cgroups of version 2, or why there can be no machine.
fn groups() -> Result<PathBuf, String> {
    if !rustix::process::geteuid().is_root() {
        return Err("a machine for services takes root".to_owned());
    }
    for program in ["/lib/systemd/systemd", "/usr/bin/unshare", "/usr/bin/nsenter", "/usr/bin/apt-get"] {
        if !Path::new(program).exists() {
            return Err(format!("there is no {program}; ./x setup installs it"));
        }
    }
    let text = |path| fs::read_to_string(path).map_err(|e| format!("{path}: {e}"));
    if !text("/proc/filesystems")?.contains("\toverlay\n") {
        return Err("this kernel has no overlayfs".to_owned());
    }
    let unshared = Command::new("unshare").args(["--mount", "--pid", "--fork", "true"]).output();
    if !unshared.is_ok_and(|output| output.status.success()) {
        return Err("namespaces are not permitted here".to_owned());
    }
    let mounts = text("/proc/self/mounts")?;
    let group = mounts.lines().find_map(|line| {
        let mut fields = line.split(' ');
        let (place, kind) = (fields.nth(1)?, fields.next()?);
        (kind == "cgroup2").then(|| PathBuf::from(place))
    });
    group.ok_or_else(|| "no cgroups of version 2 are mounted here".to_owned())
}
