//! The hosts of a session on a network of the simulator.

use trimaran_netsim::{HostId, Profile, Topology};

/// The hosts of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionHosts {
    /// The cullers: `culler-1` and so on, at the near site.
    pub cullers: Vec<HostId>,
    /// The display: `display`, at the far site.
    pub display: HostId,
}

impl SessionHosts {
    /// So many cullers and a display on `network`.
    #[must_use]
    pub fn on(network: &Profile, cullers: usize) -> (Topology, Self) {
        let mut sites = network.sites();
        let cullers = (1..=cullers).map(|culler| sites.near(&format!("culler-{culler}"))).collect();
        let display = sites.far("display");
        (sites.topology, Self { cullers, display })
    }
}
