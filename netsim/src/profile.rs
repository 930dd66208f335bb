//! Networks by name or from a file.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use thiserror::Error;

use crate::host::HostId;
use crate::link::LinkModel;
use crate::topology::Topology;

mod schedule;
mod written;

pub use schedule::ScheduleFault;
use written::WrittenLink;

/// The networks that come with this crate.
const BUILT_IN: [(&str, &str); 8] = [
    ("fast-ethernet", include_str!("../profiles/fast-ethernet.toml")),
    ("gigabit", include_str!("../profiles/gigabit.toml")),
    ("10g", include_str!("../profiles/10g.toml")),
    ("wifi", include_str!("../profiles/wifi.toml")),
    ("lte", include_str!("../profiles/lte.toml")),
    ("wan-20ms", include_str!("../profiles/wan-20ms.toml")),
    ("wan-80ms", include_str!("../profiles/wan-80ms.toml")),
    ("satellite", include_str!("../profiles/satellite.toml")),
];

/// A network for a display and its cullers: all at one switch, or the display at another site than the
/// cullers.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Its name.
    pub name: String,
    /// A description.
    pub about: String,
    /// The sources of its numbers.
    pub sources: Vec<String>,
    /// From each machine to its switch, and back.
    pub up: LinkModel,
    /// From the switch to each machine.
    pub down: LinkModel,
    /// Between the sites, if there are two: from the cullers' to the display's, and back.
    pub wan: Option<(LinkModel, LinkModel)>,
}

/// Why a profile cannot be loaded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// Neither a name nor a file.
    #[error("no network is called {name:?}: take a file ending in .toml, or one of {}", Profile::names().collect::<Vec<_>>().join(", "))]
    Unknown {
        /// The name asked for.
        name: String,
    },
    /// The file cannot be read.
    #[error("cannot read the network {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// The file is not a profile.
    #[error("the network {profile} cannot be used: {cause}")]
    Parse {
        /// The profile.
        profile: String,
        /// The error and its place.
        cause: Box<toml::de::Error>,
    },
    /// A value is invalid.
    #[error("the network {profile} cannot be used: the key `{key}` {problem}")]
    Value {
        /// The profile.
        profile: String,
        /// The key.
        key: String,
        /// The problem.
        problem: &'static str,
    },
    /// A file of phases cannot be used.
    #[error("the network {profile} cannot be used: the key `{key}` names {}, which {fault}", .path.display())]
    Schedule {
        /// The network.
        profile: String,
        /// The key.
        key: String,
        /// The file.
        path: PathBuf,
        /// The problem.
        fault: ScheduleFault,
    },
}

/// The machines of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Machines {
    /// The cullers.
    pub cullers: Vec<HostId>,
    /// The display.
    pub display: HostId,
}

/// A profile as written in TOML.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    about: String,
    sources: Vec<String>,
    up: WrittenLink,
    down: Option<WrittenLink>,
    wan: Option<WrittenLink>,
    wan_back: Option<WrittenLink>,
}

impl Profile {
    /// The names of the networks that come with this crate.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// The network of that name, or the one in the file `name`, which ends in `.toml`.
    ///
    /// # Errors
    /// If there is none, or a value is invalid; the error names the key.
    pub fn find(name: &str) -> Result<Self, ProfileError> {
        if let Some((_, text)) = BUILT_IN.iter().find(|(known, _)| *known == name) {
            return Self::parse(name, text);
        }
        let path = Path::new(name);
        if path.extension().is_none_or(|extension| extension != "toml") {
            return Err(ProfileError::Unknown { name: name.to_owned() });
        }
        let text =
            fs::read_to_string(path).map_err(|cause| ProfileError::Read { path: path.to_owned(), cause })?;
        Self::read(name, &text, Some(path.parent().unwrap_or(Path::new(""))))
    }

    /// Reads a profile in TOML. It must not name other files, because it has no folder.
    ///
    /// # Errors
    /// If a value is invalid; the error names the key.
    pub fn parse(name: &str, text: &str) -> Result<Self, ProfileError> {
        Self::read(name, text, None)
    }

    fn read(name: &str, text: &str, folder: Option<&Path>) -> Result<Self, ProfileError> {
        let written: Written = toml::from_str(text)
            .map_err(|cause| ProfileError::Parse { profile: name.to_owned(), cause: Box::new(cause) })?;
        let link = |key, link: WrittenLink| link.read(name, key, folder);
        let alone = written.wan_back.is_some() && written.wan.is_none();
        if alone {
            let (profile, key) = (name.to_owned(), "wan_back".to_owned());
            return Err(ProfileError::Value {
                profile,
                key,
                problem: "is the way back of `wan`, which is missing",
            });
        }
        let up = link("up", written.up)?;
        let down = written.down.map_or_else(|| Ok(up.clone()), |down| link("down", down))?;
        let wan = match written.wan {
            Some(out) => {
                let out = link("wan", out)?;
                let back = written.wan_back.map_or_else(|| Ok(out.clone()), |back| link("wan_back", back))?;
                Some((out, back))
            }
            None => None,
        };
        Ok(Self { name: name.to_owned(), about: written.about, sources: written.sources, up, down, wan })
    }

    /// The least one-way delay from a culler to the display: without sending times, queues and jitter, before
    /// any phase begins.
    #[must_use]
    pub fn way_to_display(&self) -> Duration {
        let wan = self.wan.as_ref().map_or(Duration::ZERO, |(out, _)| out.conditions.delay);
        self.up.conditions.delay + wan + self.down.conditions.delay
    }

    /// A topology of so many cullers and a display: `culler-1` and so on, and `display`.
    #[must_use]
    pub fn topology(&self, cullers: usize) -> (Topology, Machines) {
        let mut topology = Topology::new();
        let cullers: Vec<_> =
            (1..=cullers).map(|culler| topology.host(&format!("culler-{culler}"))).collect();
        let display = topology.host("display");
        let here = topology.switch();
        let there = match &self.wan {
            Some((out, back)) => {
                let there = topology.switch();
                topology.join(here, there, out.clone(), back.clone());
                there
            }
            None => here,
        };
        let places = cullers.iter().map(|culler| (*culler, here)).chain([(display, there)]);
        for (host, switch) in places {
            topology.join(topology.node(host), switch, self.up.clone(), self.down.clone());
        }
        (topology, Machines { cullers, display })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Loss, Probability, Rate};

    #[test]
    fn every_network_that_comes_along_can_be_used() {
        for name in Profile::names() {
            let profile = Profile::find(name).unwrap();
            assert!(!profile.about.is_empty() && !profile.sources.is_empty(), "{name}");
            let (topology, machines) = profile.topology(2);
            assert_eq!(topology.find("display").map(|host| host.v4()), Some(machines.display.v4()));
        }
        let wifi = Profile::find("wifi").unwrap();
        assert_eq!(wifi.up.conditions.loss, Loss::Independent(Probability::new(0.01).unwrap()));
        assert_eq!(wifi.up, wifi.down, "as up where nothing else is said");
        let lte = Profile::find("lte").unwrap();
        let (out, back) = lte.wan.unwrap();
        let rate = |link: &LinkModel| link.conditions.rate.unwrap().bits_per_second();
        assert_eq!((rate(&out), rate(&back)), (30_000_000, 10_000_000));
    }

    fn error(text: &str) -> String {
        Profile::parse("mine.toml", text).unwrap_err().to_string()
    }

    #[test]
    fn what_is_wrong_is_named_by_its_key() {
        let with = |link: &str| error(&format!("about = \"a\"\nsources = []\n[up]\n{link}\n"));
        for (link, expected) in [
            ("rate = \"fast\"", "rate = \"fast\""),
            ("delay = \"soon\"", "delay = \"soon\""),
            ("loss = { independent = 1.5 }", "1.5 is no probability"),
            ("speed = 3", "unknown field `speed`"),
            ("phases = [3]", "expected a table of a phase's keys"),
            ("mtu = 100", "`up.mtu` is below 576 bytes"),
            ("queue = { packets = 0 }", "`up.queue.packets` is 0"),
            ("queue = { bytes = 1000 }", "`up.queue.bytes` has no room"),
            ("phases_from = \"drive.csv\"", "`up.phases_from` needs a network that is a file itself"),
            ("phases = [{ at = \"2s\" }, { at = \"1s\" }]", "`up.phases` are not in the order"),
            ("phases = [{ at = \"2s\" }]\nrepeat = \"2s\"", "`up.repeat` is not after the last phase"),
        ] {
            let error = with(link);
            assert!(error.contains("mine.toml") && error.contains(expected), "{link}: {error}");
        }
        assert!(
            error("about = \"a\"\nsources = []\n[up]\n[wan_back]\n").contains("`wan_back` is the way back")
        );
        assert!(error("about = \"a\"\n[up]\n").contains("missing field `sources`"));
        let unknown = Profile::find("token-ring").unwrap_err().to_string();
        assert!(unknown.contains("token-ring") && unknown.contains("fast-ethernet, gigabit"), "{unknown}");
    }

    #[test]
    fn a_phase_says_only_what_changes() {
        let profile = Profile::parse(
            "p",
            "about = \"a\"\nsources = []\n[up]\nrate = \"9 Mbit/s\"\ndelay = \"3ms\"\nrepeat = \"20s\"\n\
             phases = [{ at = \"10s\", rate = \"1 Mbit/s\" }]\n",
        )
        .unwrap();
        let [phase] = profile.up.phases[..] else { panic!("{:?}", profile.up) };
        assert_eq!(phase.at, Duration::from_secs(10));
        assert_eq!(phase.conditions.rate, Rate::new(1_000_000));
        assert_eq!(phase.conditions.delay, Duration::from_millis(3));
        assert_eq!(profile.up.repeat, Some(Duration::from_secs(20)));
    }
}
