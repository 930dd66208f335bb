//! Hosts, and the links between them.

use std::collections::VecDeque;
use std::net::IpAddr;

use crate::host::HostId;
use crate::link::LinkModel;

/// A host, or a switch or router that only passes packets on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeId(pub(crate) usize);

/// Hosts and links. Packets take the path with the fewest links, and of equal ones the one joined first.
/// Switches store and forward.
#[derive(Debug, Clone, Default)]
pub struct Topology {
    /// The node of each host.
    pub(crate) hosts: Vec<NodeId>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) pipes: Vec<Way>,
}

/// A host or a switch.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) name: String,
    pub(crate) host: Option<HostId>,
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

    /// Two hosts of these names and a link between them; `there` leads from the first to the second.
    #[must_use]
    pub fn pair(hosts: [&str; 2], there: &LinkModel, back: &LinkModel) -> Self {
        let mut topology = Self::new();
        let [a, b] = hosts.map(|name| topology.host(name)).map(|host| topology.node(host));
        topology.join(a, b, there.clone(), back.clone());
        topology
    }

    /// Hosts of these names at a switch called `switch`, each with a link of its own. The hosts' ids are in
    /// the order of the names.
    #[must_use]
    pub fn star(hosts: &[&str], up: &LinkModel, down: &LinkModel) -> Self {
        let mut topology = Self::new();
        let switch = topology.switch("switch");
        for name in hosts {
            let host = topology.host(name);
            topology.join(topology.node(host), switch, up.clone(), down.clone());
        }
        topology
    }

    /// Adds a host. Its addresses are `10.0.0.1` and `fd00::1` for the first, and so on; its name resolves
    /// to them.
    pub fn host(&mut self, name: &str) -> HostId {
        let host = HostId(self.hosts.len());
        let node = self.add(name, Some(host));
        self.hosts.push(node);
        host
    }

    /// Adds a switch or router. Its name is for [`Topology::link_names`] and [`Topology::find_node`].
    pub fn switch(&mut self, name: &str) -> NodeId {
        self.add(name, None)
    }

    fn add(&mut self, name: &str, host: Option<HostId>) -> NodeId {
        self.nodes.push(Node { name: name.to_owned(), host });
        NodeId(self.nodes.len() - 1)
    }

    /// The node of a host. A host of another topology gives the first one.
    #[must_use]
    pub fn node(&self, host: HostId) -> NodeId {
        self.hosts.get(host.0).copied().unwrap_or(NodeId(0))
    }

    /// Joins two hosts or switches: `there` leads from `a` to `b`, `back` from `b` to `a`.
    pub fn join(&mut self, a: NodeId, b: NodeId, there: LinkModel, back: LinkModel) {
        self.pipes.push(Way { from: a, to: b, model: there });
        self.pipes.push(Way { from: b, to: a, model: back });
    }

    /// The host with this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<HostId> {
        self.nodes.iter().filter(|node| node.name == name).find_map(|node| node.host)
    }

    /// The host or switch with this name, and of several the first.
    #[must_use]
    pub fn find_node(&self, name: &str) -> Option<NodeId> {
        self.nodes.iter().position(|node| node.name == name).map(NodeId)
    }

    /// The name of each direction of each link, such as `first to switch`, in the order in which the links
    /// were joined.
    pub fn link_names(&self) -> impl Iterator<Item = String> {
        let name = |node: NodeId| self.nodes.get(node.0).map_or("", |node| &node.name);
        self.pipes.iter().map(move |way| format!("{} to {}", name(way.from), name(way.to)))
    }

    /// The host that has an address.
    #[must_use]
    pub fn at(&self, address: IpAddr) -> Option<HostId> {
        (0..self.hosts.len()).map(HostId).find(|host| host.v4() == address || host.v6() == address)
    }

    /// All hosts, in the order in which they were added.
    pub fn hosts(&self) -> impl Iterator<Item = HostId> {
        (0..self.hosts.len()).map(HostId)
    }

    pub(crate) fn host_names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().filter(|node| node.host.is_some()).map(|node| &*node.name)
    }

    /// For each node, the pipe that leads on to `host`.
    pub(crate) fn routes_to(&self, host: HostId) -> Vec<Option<usize>> {
        let mut next = vec![None; self.nodes.len()];
        let target = self.node(host);
        let mut frontier = VecDeque::from([target]);
        while let Some(reached) = frontier.pop_front() {
            for (index, way) in self.pipes.iter().enumerate() {
                // Hosts do not forward.
                let forwards =
                    reached == target || self.nodes.get(reached.0).is_some_and(|node| node.host.is_none());
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
        let [left, right] = ["left", "right"].map(|name| topology.switch(name));
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
