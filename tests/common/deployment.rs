//! Three roles of a deployment, each a process with a configuration of its own.
#![allow(dead_code, reason = "each test file uses its part of this")]

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::PathBuf,
    process::{Child, ChildStderr, Command, Stdio},
    thread,
    time::Duration,
};

use tempfile::TempDir;

/// How many frames the sessions have.
pub(crate) const FRAMES: usize = 1000;

/// Where a role runs.
#[derive(Clone)]
pub(crate) struct Place {
    /// Where others reach it.
    pub(crate) address: String,
    /// Its network namespace, if it has one of its own.
    pub(crate) namespace: Option<String>,
}

/// A folder with a scene, keys and a configuration a role.
pub(crate) struct Deployment {
    dir: TempDir,
    /// Where the first machine, the second and the display run.
    places: [Place; 3],
}

/// A running role and what it says.
pub(crate) struct Role {
    child: Child,
    stderr: BufReader<ChildStderr>,
    said: String,
}

impl Deployment {
    /// All on this machine.
    pub(crate) fn here(transport: &str, ports: [u16; 2]) -> Self {
        let place = Place { address: "127.0.0.1".to_owned(), namespace: None };
        Self::at(transport, ports, [place.clone(), place.clone(), place])
    }

    /// The display listens at the first of these ports, the first culler at the second.
    pub(crate) fn at(transport: &str, ports: [u16; 2], places: [Place; 3]) -> Self {
        let [first, _, display] = places.each_ref().map(|place| &place.address);
        let display = format!("{transport}://{display}:{}", ports[0]);
        let pair = format!("{transport}://{first}:{}", ports[1]);
        let deployment = Self { dir: tempfile::tempdir().unwrap(), places };
        deployment.run(&["generate", "plant", "--objects", "300", "-o", "plant.scene"]);
        for name in ["display", "first", "second"] {
            deployment.run(&["keys", "new", name, "--out", "."]);
        }
        let write = |name: &str, text: String| fs::write(deployment.dir.path().join(name), text).unwrap();
        write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\nlisten = '{display}'\nout = 'walk'\nkeys = 'display.key'\nmetrics = '127.0.0.1:0'\n\
                 peers.first = 'first.pub'\npeers.second = 'second.pub'\n\
                 [session]\nframes = {FRAMES}\nwidth = 64\nheight = 64\naudit_every = 200\n"
            ),
        );
        for (index, other) in [("first", "second"), ("second", "first")] {
            write(
                &format!("{index}.toml"),
                format!(
                    "scene = 'plant.scene'\nindex = '{index}'\ndisplay = '{display}'\npair = '{pair}'\nkeys = '{index}.key'\n\
                     peers.display = 'display.pub'\npeers.other = '{other}.pub'\n"
                ),
            );
        }
        deployment
    }

    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trimaran"));
        command.args(args).current_dir(self.dir.path());
        command
    }

    pub(crate) fn run(&self, args: &[&str]) {
        assert!(self.command(args).output().unwrap().status.success(), "{args:?}");
    }

    pub(crate) fn start(&self, name: &str, more: &[&str]) -> Role {
        let kind = if name == "display" { "display" } else { "culler" };
        let place = ["first", "second", "display"].iter().position(|role| *role == name).unwrap();
        let mut command = match &self.places[place].namespace {
            Some(namespace) => {
                let mut command = Command::new("ip");
                command.args(["netns", "exec", namespace, env!("CARGO_BIN_EXE_trimaran")]);
                command.current_dir(self.dir.path());
                command
            }
            None => self.command(&[]),
        };
        command.args(["role", kind, "--config", &format!("{name}.toml")]);
        // What is gone without a word is missed soon.
        command.env("TRIMARAN_LOG", "info").env("TRIMARAN_LINK_IDLE_TIMEOUT_S", "4");
        let mut child = command.args(more).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Role { child, stderr, said: String::new() }
    }

    pub(crate) fn report(&self) -> serde_json::Value {
        let path: PathBuf = self.dir.path().join("walk/report.json");
        serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
    }
}

impl Role {
    /// Reads what it says up to a line that holds `words`.
    pub(crate) fn says(&mut self, words: &str) -> String {
        loop {
            let mut line = String::new();
            assert!(self.stderr.read_line(&mut line).unwrap() > 0, "{words:?} is not in: {}", self.said);
            self.said.push_str(&line);
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Waits until this display has received so many frames from one of its machines.
    pub(crate) fn shows(&mut self, frames: u64) {
        let line = self.says("metrics on http://");
        let address = line.split("http://").nth(1).unwrap().split('/').next().unwrap().to_owned();
        loop {
            let mut stream = TcpStream::connect(&address).unwrap();
            stream.write_all(b"GET /links HTTP/1.0\r\n\r\n").unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            let links: serde_json::Value =
                serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
            if links[0]["received"]["frames"].as_u64().is_some_and(|received| received >= frames) {
                return;
            }
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Asks it to stop, as `systemctl restart` does.
    pub(crate) fn interrupt(&self) {
        self.signal("TERM");
    }

    pub(crate) fn signal(&self, name: &str) {
        let kill = format!("kill -{name} {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    }

    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    pub(crate) fn ends(mut self, code: i32) -> String {
        self.stderr.read_to_string(&mut self.said).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(code), "{}", self.said);
        self.said
    }
}
