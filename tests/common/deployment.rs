//! Three roles of a deployment, each a process with a configuration of its own.
#![allow(dead_code, reason = "each test file uses its part of this")]

use std::{
    io::{Read, Write},
    net::TcpStream,
    thread,
    time::Duration,
};

use crate::program::{Bench, Process};

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
    bench: Bench,
    /// Where the first machine, the second and the display run.
    places: [Place; 3],
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
        let bench = Bench::with_plant(300);
        for name in ["display", "first", "second"] {
            bench.done(&["keys", "new", name, "--out", "."]);
        }
        bench.write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\nlisten = '{display}'\nout = 'walk'\nkeys = 'display.key'\nmetrics = '127.0.0.1:0'\n\
                 peers.first = 'first.pub'\npeers.second = 'second.pub'\n\
                 [session]\nframes = {FRAMES}\nwidth = 64\nheight = 64\naudit_every = 200\n"
            ),
        );
        for (index, other) in [("first", "second"), ("second", "first")] {
            bench.write(
                &format!("{index}.toml"),
                format!(
                    "scene = 'plant.scene'\nindex = '{index}'\ndisplay = '{display}'\npair = '{pair}'\nkeys = '{index}.key'\n\
                     peers.display = 'display.pub'\npeers.other = '{other}.pub'\n"
                ),
            );
        }
        Self { bench, places }
    }

    pub(crate) fn start(&self, name: &str, more: &[&str]) -> Process {
        let kind = if name == "display" { "display" } else { "culler" };
        let place = ["first", "second", "display"].iter().position(|role| *role == name).unwrap();
        let program = env!("CARGO_BIN_EXE_trimaran");
        let mut command = match &self.places[place].namespace {
            Some(namespace) => self.bench.command_of("ip", &["netns", "exec", namespace, program]),
            None => self.bench.command(&[]),
        };
        command.args(["role", kind, "--config", &format!("{name}.toml")]);
        // What is gone without a word is missed soon.
        command.env("TRIMARAN_LOG", "info").env("TRIMARAN_LINK_IDLE_TIMEOUT_S", "4");
        Process::start(command.args(more))
    }

    pub(crate) fn report(&self) -> serde_json::Value {
        self.bench.report("walk")
    }
}

impl Process {
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
}
