//! Whole networks in TOML: hosts and switches by name, and the links between them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde::Deserialize;

use super::ProfileError;
use super::written::WrittenLink;
use crate::topology::Topology;

/// A network as written in TOML.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenNetwork {
    hosts: Vec<String>,
    #[serde(default)]
    switches: Vec<String>,
    #[serde(default)]
    links: Vec<WrittenJoint>,
}

/// A link as written in TOML, with both its directions.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenJoint {
    between: [String; 2],
    there: WrittenLink,
    back: Option<WrittenLink>,
}

impl Topology {
    /// Reads a network with its hosts from a TOML file. Files of phases lie beside it.
    ///
    /// ```toml
    /// hosts = ["client", "server"]
    /// switches = ["core"]
    ///
    /// [[links]]
    /// between = ["client", "core"]
    /// there = { rate = "5 Mbit/s", delay = "20ms", loss = { independent = 0.01 } }
    /// back = { rate = "20 Mbit/s", delay = "20ms" } # without it the way back is as the way there
    ///
    /// [[links]]
    /// between = ["server", "core"]
    /// there = { rate = "1 Gbit/s", delay = "1ms" }
    /// ```
    ///
    /// The keys of `there` and `back` are those of the links of a [`Profile`](super::Profile).
    ///
    /// # Errors
    /// If the file cannot be read, or a value is invalid; the error names the key.
    pub fn read(path: &Path) -> Result<Self, ProfileError> {
        let text =
            fs::read_to_string(path).map_err(|cause| ProfileError::Read { path: path.to_owned(), cause })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        topology(&path.to_string_lossy(), &text, Some(folder))
    }

    /// Reads a network as [`Topology::read`] does, from a text. It must not name other files, because it has
    /// no folder. Errors call it by `name`.
    ///
    /// # Errors
    /// If a value is invalid; the error names the key.
    pub fn parse(name: &str, text: &str) -> Result<Self, ProfileError> {
        topology(name, text, None)
    }
}

fn topology(name: &str, text: &str, folder: Option<&Path>) -> Result<Topology, ProfileError> {
    let WrittenNetwork { hosts, switches, links } = toml::from_str(text)
        .map_err(|cause| ProfileError::Parse { profile: name.to_owned(), cause: Box::new(cause) })?;
    let wrong =
        |key: &str, problem| ProfileError::Value { profile: name.to_owned(), key: key.to_owned(), problem };
    let mut known = BTreeSet::new();
    for (key, names) in [("hosts", &hosts), ("switches", &switches)] {
        if !names.iter().all(|name| known.insert(name)) {
            return Err(wrong(key, "has a name that is taken"));
        }
    }
    let mut topology = Topology::new();
    hosts.iter().for_each(|name| _ = topology.host(name));
    switches.iter().for_each(|name| _ = topology.switch(name));
    for (index, WrittenJoint { between, there, back }) in links.into_iter().enumerate() {
        let key = |part: &str| format!("links.{index}.{part}");
        let [Some(a), Some(b)] = between.map(|name| topology.find_node(&name)) else {
            return Err(wrong(&key("between"), "names neither a host nor a switch"));
        };
        if a == b {
            return Err(wrong(&key("between"), "joins a node to itself"));
        }
        let there = there.read(name, &key("there"), folder)?;
        let back = back.map_or_else(|| Ok(there.clone()), |back| back.read(name, &key("back"), folder))?;
        topology.join(a, b, there, back);
    }
    Ok(topology)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const TEXT: &str = "hosts = [\"client\", \"server\"]\nswitches = [\"core\"]\n[[links]]\n\
        between = [\"client\", \"core\"]\nthere = { delay = \"3ms\" }\nback = { delay = \"4ms\" }\n\
        [[links]]\nbetween = [\"core\", \"server\"]\nthere = { delay = \"1ms\" }\n";

    #[test]
    fn hosts_have_the_names_and_links_of_the_file() {
        let topology = Topology::parse("net.toml", TEXT).unwrap();
        assert_eq!(topology.find("server"), topology.hosts().nth(1));
        assert_eq!(topology.find("core"), None, "a switch is no host");
        let links: Vec<_> = topology.link_names().collect();
        assert_eq!(links, ["client to core", "core to client", "core to server", "server to core"]);
        let delays: Vec<_> = topology.pipes.iter().map(|way| way.model.conditions.delay).collect();
        assert_eq!(delays, [3, 4, 1, 1].map(Duration::from_millis));
    }

    #[test]
    fn what_is_wrong_is_named_by_its_key() {
        for (from, to, expected) in [
            ("\"server\"]\ns", "\"client\"]\ns", "the key `hosts` has a name that is taken"),
            ("[\"core\"]", "[\"client\"]", "the key `switches` has a name that is taken"),
            ("[\"client\", \"core\"]", "[\"client\", \"cor\"]", "`links.0.between` names neither"),
            ("[\"core\", \"server\"]", "[\"core\", \"core\"]", "`links.1.between` joins a node to itself"),
            ("delay = \"4ms\"", "mtu = 1", "`links.0.back.mtu` is below 576 bytes"),
            ("there = { delay = \"1ms\" }", "", "missing field `there`"),
        ] {
            let text = TEXT.replacen(from, to, 1);
            let error = Topology::parse("net.toml", &text).unwrap_err().to_string();
            assert!(error.contains("net.toml") && error.contains(expected), "{to}: {error}");
        }
    }
}
