//! A display and two cullers as services on three machines of one network.

use std::fs;
use std::thread;

use serde_json::Value;

use crate::deployment::{DISPLAY, HOSTS, ONE, TWO, Walk};
use crate::machine::Machine;
use crate::network::Network;

/// The port of every role's metrics.
const METRICS: u16 = 9464;

/// Three machines. Of a service its name counts; each serves its metrics at the same port.
pub(crate) struct Trio {
    pub(crate) one: Machine,
    pub(crate) two: Machine,
    pub(crate) show: Machine,
    pub(crate) network: Network,
}

impl Trio {
    /// Boots the machines, and installs the services there by the page's commands. The walk has begun then.
    /// `more` is added to the configuration of each role: `display`, `one` and `two`.
    pub(crate) fn install(name: &str, walk: &Walk, more: impl Fn(&str) -> String) -> Option<Self> {
        let boot = |host: &'static str| move || Machine::boot(&format!("{name}-{host}"));
        let [one, two, show] = thread::scope(|scope| {
            HOSTS.map(|host| scope.spawn(boot(host))).map(|machine| machine.join().unwrap())
        });
        let (one, two, show) = (one?, two?, show?);
        let addresses = ["10.77.0.1", "10.77.0.2", "10.77.0.3"];
        let network = Network::join(
            name,
            &[
                (HOSTS[0], addresses[0], &one),
                (HOSTS[1], addresses[1], &two),
                (HOSTS[2], addresses[2], &show),
            ],
        );
        walk.install_on([&one, &two, &show], more);
        let trio = Self { one, two, show, network };
        trio.has_cullers(&["culler 1", "culler 2"]);
        trio.walks_on();
        Some(trio)
    }

    /// The machine of a service.
    pub(crate) fn machine(&self, service: &str) -> &Machine {
        match service {
            service if service == ONE.0 => &self.one,
            service if service == TWO.0 => &self.two,
            service if service == DISPLAY.0 => &self.show,
            _ => panic!("{service}"),
        }
    }

    /// The links of a service, if it answers.
    pub(crate) fn links(&self, service: &str) -> Option<Vec<Value>> {
        serde_json::from_str(&self.machine(service).get(METRICS, "/links")?).ok()
    }

    /// The page of a service's metrics.
    pub(crate) fn metrics(&self, service: &str) -> String {
        self.machine(service).wait_for("the metrics", || self.machine(service).get(METRICS, "/metrics"))
    }

    /// Waits until the display has links to these cullers, and to no others.
    pub(crate) fn has_cullers(&self, names: &[&str]) {
        self.show.wait_for(&format!("links to {names:?}"), || {
            let links = self.links(DISPLAY.0)?;
            let mut peers: Vec<_> = links.iter().map(|link| link["peer"].as_str().unwrap()).collect();
            peers.sort_unstable();
            (peers == names).then_some(())
        });
    }

    /// Waits until the display has shown 20 more frames.
    pub(crate) fn walks_on(&self) {
        let shown = || value(&self.metrics(DISPLAY.0), "trimaran_frames_total{stage=\"rvg\"}");
        let before = shown();
        self.show.wait_for("more frames", || (shown() >= before + 20.0).then_some(()));
    }
}

/// The value of a series in a page of metrics, 0 if it is not there yet.
pub(crate) fn value(page: &str, series: &str) -> f64 {
    let line = page.lines().find_map(|line| line.strip_prefix(series)?.strip_prefix(' '));
    line.map_or(0.0, |line| line.parse().unwrap())
}

/// The lines of a service in the journal that are warnings or worse.
pub(crate) fn faults(machine: &Machine, unit: &str) -> Vec<String> {
    let of = "--no-pager --output cat --priority warning _COMM=trimaran --unit";
    machine.run(&format!("journalctl {of} {unit}")).lines().map(str::to_owned).collect()
}

/// A mounted disk of its own for a folder of the service user, as long as the machine runs.
pub(crate) fn small_disk(machine: &Machine, folder: &str, size: &str) {
    machine.run(&format!(
        "mkdir -p {folder}; mount -t tmpfs -o size={size},mode=750 disk {folder}
         chown trimaran:trimaran {folder}"
    ));
}

/// Fills the disk of a folder.
pub(crate) fn fill(machine: &Machine, folder: &str) {
    machine.run(&format!("! cat /dev/zero 2>/dev/null >{folder}/filler"));
    assert!(fs::metadata(machine.path(&format!("{folder}/filler"))).unwrap().len() > 0);
}
