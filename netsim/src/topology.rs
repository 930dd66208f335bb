//! Machines, and the links between them.

use std::collections::VecDeque;
use std::net::IpAddr;

use crate::host::HostId;
use crate::link::LinkModel;

/// A machine, or a switch or router that only passes packets on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeId(pub(crate) usize);

/// Machines and links. Packets take the path with the fewest links, and of equal ones the one joined first.
/// Switches store and forward.
#[derive(Debug, Clone, Default)]
pub struct Topology {
    pub(crate) hosts: Vec<Host>,
    /// The host at each node.
    pub(crate) nodes: Vec<Option<HostId>>,
    pub(crate) pipes: Vec<Way>,
}

/// A machine with sockets.
#[derive(Debug, Clone)]
pub(crate) struct Host {
    pub(crate) name: String,
    pub(crate) node: NodeId,
}

/// One direction of a link.
#[derive(Debug, Clone)]
pub(crate) struct Way {
    pub(crate) from: NodeId,
    pub(crate) to: NodeId,
    pub(crate) model: LinkModel,
}

impl Topology {
    /// An empty topology.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Machines of these names at one switch, each with a link of its own; the machines' ids are in the order
    /// of the names.
    #[must_use]
    pub fn star(hosts: &[&str], up: &LinkModel, down: &LinkModel) -> Self {
        let mut topology = Self::new();
        let switch = topology.switch();
        for name in hosts {
            let host = topology.host(name);
            topology.join(topology.node(host), switch, up.clone(), down.clone());
        }
        topology
    }

    /// Adds a machine. Its addresses are `10.0.0.1` and `fd00::1` for the first, and so on; its name resolves
    /// to them.
    pub fn host(&mut self, name: &str) -> HostId {
        let (node, host) = (NodeId(self.nodes.len()), HostId(self.hosts.len()));
        self.nodes.push(Some(host));
        self.hosts.push(Host { name: name.to_owned(), node });
        host
    }

    /// Adds a switch or router.
    pub fn switch(&mut self) -> NodeId {
        self.nodes.push(None);
        NodeId(self.nodes.len() - 1)
    }

    /// The node of a machine. A machine of another topology gives the first one.
    #[must_use]
    pub fn node(&self, host: HostId) -> NodeId {
        self.hosts.get(host.0).map_or(NodeId(0), |host| host.node)
    }

    /// Joins two machines or switches: `there` leads from `a` to `b`, `back` from `b` to `a`.
    pub fn join(&mut self, a: NodeId, b: NodeId, there: LinkModel, back: LinkModel) {
        self.pipes.push(Way { from: a, to: b, model: there });
        self.pipes.push(Way { from: b, to: a, model: back });
    }

    /// The machine with this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<HostId> {
        self.hosts.iter().position(|host| host.name == name).map(HostId)
    }

    /// The name of each direction of each link, such as `first to switch`, in the order in which the links
    /// were joined.
    pub fn link_names(&self) -> impl Iterator<Item = String> {
        self.pipes.iter().map(|way| format!("{} to {}", self.node_name(way.from), self.node_name(way.to)))
    }

    /// A machine's name. A switch is called `switch`, with its number behind that if there are several.
    fn node_name(&self, node: NodeId) -> String {
        let host = self.nodes.get(node.0).copied().flatten().and_then(|host| self.hosts.get(host.0));
        if let Some(host) = host {
            return host.name.clone();
        }
        let switches = |nodes: &[Option<HostId>]| nodes.iter().filter(|host| host.is_none()).count();
        match switches(&self.nodes) {
            0 | 1 => "switch".to_owned(),
            _ => format!("switch {}", self.nodes.get(..=node.0).map_or(0, switches)),
        }
    }

    /// The machine that has an address.
    #[must_use]
    pub fn at(&self, address: IpAddr) -> Option<HostId> {
        (0..self.hosts.len()).map(HostId).find(|host| host.v4() == address || host.v6() == address)
    }

    /// All machines, in the order in which they were added.
    pub fn machines(&self) -> impl Iterator<Item = HostId> {
        (0..self.hosts.len()).map(HostId)
    }

    /// For each node, the pipe that leads on to `host`.
    pub(crate) fn routes_to(&self, host: HostId) -> Vec<Option<usize>> {
        let mut next = vec![None; self.nodes.len()];
        let target = self.node(host);
        let mut frontier = VecDeque::from([target]);
        while let Some(reached) = frontier.pop_front() {
            for (index, way) in self.pipes.iter().enumerate() {
                // Machines do not forward.
                let forwards = reached == target || self.nodes.get(reached.0).is_some_and(Option::is_none);
                if way.to == reached
                    && way.from != target
                    && forwards
                    && let Some(entry @ None) = next.get_mut(way.from.0)
                {
                    *entry = Some(index);
                    frontier.push_back(way.from);
                }
            }
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn wire() -> LinkModel {
        LinkModel::clean(None, Duration::ZERO)
    }

    #[test]
    fn packets_take_the_shortest_way_over_switches_and_never_through_a_host() {
        let mut topology = Topology::new();
        let [a, b, c] = ["a", "b", "c"].map(|name| topology.host(name));
        let [left, right] = [topology.switch(), topology.switch()];
        topology.join(topology.node(a), left, wire(), wire()); // 0, 1
        topology.join(topology.node(b), left, wire(), wire()); // 2, 3
        topology.join(left, right, wire(), wire()); // 4, 5
        topology.join(topology.node(c), right, wire(), wire()); // 6, 7
        topology.join(topology.node(b), topology.node(c), wire(), wire()); // 8, 9
        // Nodes: a, b, c, left, right.
        assert_eq!(topology.routes_to(c), [Some(0), Some(8), None, Some(4), Some(7)]);
        assert_eq!(topology.routes_to(a), [None, Some(2), Some(6), Some(1), Some(5)]);
    }
}
