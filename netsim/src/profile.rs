//! Networks by name or from a file.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use thiserror::Error;

use crate::host::HostId;
use crate::link::LinkModel;
use crate::topology::{NodeId, Topology};

mod schedule;
mod whole;
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

/// The properties of a network for any hosts: all at one switch, or at two sites with a switch each. A
/// network with hosts of its own is a [`Topology`], and comes from [`Topology::read`].
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Its name.
    pub name: String,
    /// A description.
    pub about: String,
    /// The sources of its numbers.
    pub sources: Vec<String>,
    /// From each host to its switch.
    pub up: LinkModel,
    /// From the switch to each host.
    pub down: LinkModel,
    /// Between the sites, if there are two: from the near one to the far one, and back.
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

    /// The least one-way delay from a host of the near site to one of the far site: without sending times,
    /// queues and jitter, before any phase begins.
    #[must_use]
    pub fn one_way_delay(&self) -> Duration {
        let wan = self.wan.as_ref().map_or(Duration::ZERO, |(out, _)| out.conditions.delay);
        self.up.conditions.delay + wan + self.down.conditions.delay
    }

    /// The network without hosts: a switch for each site.
    #[must_use]
    pub fn sites(&self) -> Sites {
        let mut topology = Topology::new();
        let [near, far] = match &self.wan {
            Some((out, back)) => {
                let sites = ["switch 1", "switch 2"].map(|name| topology.switch(name));
                topology.join(sites[0], sites[1], out.clone(), back.clone());
                sites
            }
            None => [topology.switch("switch"); 2],
        };
        Sites { topology, near, far, up: self.up.clone(), down: self.down.clone() }
    }
}

/// A network of one or two sites, to which hosts are added by name.
#[derive(Debug, Clone)]
pub struct Sites {
    /// The network with the hosts so far.
    pub topology: Topology,
    near: NodeId,
    far: NodeId,
    up: LinkModel,
    down: LinkModel,
}

impl Sites {
    /// Adds a host at the near site.
    pub fn near(&mut self, name: &str) -> HostId {
        self.host(name, self.near)
    }

    /// Adds a host at the far site, or at the only one.
    pub fn far(&mut self, name: &str) -> HostId {
        self.host(name, self.far)
    }

    fn host(&mut self, name: &str, switch: NodeId) -> HostId {
        let host = self.topology.host(name);
        self.topology.join(self.topology.node(host), switch, self.up.clone(), self.down.clone());
        host
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
            let mut sites = profile.sites();
            let hosts = [sites.near("a"), sites.near("b"), sites.far("c")];
            assert!(sites.topology.hosts().eq(hosts));
            let first: Vec<_> = sites.topology.link_names().step_by(2).collect();
            match profile.wan {
                None => assert_eq!(first, ["a to switch", "b to switch", "c to switch"]),
                Some(_) => {
                    let links = ["switch 1 to switch 2", "a to switch 1", "b to switch 1", "c to switch 2"];
                    assert_eq!(first, links, "{name}");
                }
            }
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
