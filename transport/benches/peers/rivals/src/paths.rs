//! The networks, which are those of the example `lossy_path`, and the wifi of the simulator's profiles.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use trimaran_net::Net;
use trimaran_netsim::link::{GilbertElliott, LinkModel, Loss, Probability};
use trimaran_netsim::{HostId, Profile, Simulation, Topology};

const ONE_WAY: Duration = Duration::from_millis(5);

/// A network between a sender and a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Path {
    /// 5 ms one way, nothing lost.
    None,
    /// A hundredth of the packets is lost, independently.
    Random,
    /// A burst each 300 packets, of four on average, of which three are lost.
    Bursts,
    /// The profile `wifi`: 2 ms, jitter with a heavy tail, 1 % lost on each of two links of 100 Mbit/s.
    Wifi,
}

impl Path {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Random => "1 %, random",
            Self::Bursts => "1 %, bursts of 4",
            Self::Wifi => "wifi",
        }
    }

    /// The network and its hosts `sender` and `receiver`.
    fn topology(self) -> Result<(Topology, [HostId; 2])> {
        let loss = match self {
            Self::Wifi => {
                let mut sites = Profile::find("wifi")?.sites();
                let hosts = [sites.near("sender"), sites.far("receiver")];
                return Ok((sites.topology, hosts));
            }
            Self::None => Loss::None,
            Self::Random => Loss::Independent(Probability::new(0.01)?),
            Self::Bursts => Loss::GilbertElliott(GilbertElliott {
                to_bad: Probability::new(0.003)?,
                to_good: Probability::new(0.25)?,
                lost_in_bad: Probability::new(0.75)?,
                lost_in_good: Probability::default(),
            }),
        };
        let mut link = LinkModel::clean(None, ONE_WAY);
        link.conditions.loss = loss;
        let mut topology = Topology::new();
        let hosts = [topology.host("sender"), topology.host("receiver")];
        topology.join(topology.node(hosts[0]), topology.node(hosts[1]), link.clone(), link);
        Ok((topology, hosts))
    }

    /// The network in virtual time.
    pub(crate) fn lay(self, seed: u64) -> Result<Laid> {
        let (topology, hosts) = self.topology()?;
        let simulation = Simulation::new(&topology, seed);
        let nets = hosts.map(|host| Arc::new(simulation.net(host)) as Arc<dyn Net>);
        Ok(Laid { simulation, hosts, nets })
    }
}

/// A network in virtual time, with sender and receiver.
pub(crate) struct Laid {
    pub(crate) simulation: Simulation,
    hosts: [HostId; 2],
    pub(crate) nets: [Arc<dyn Net>; 2],
}

impl Laid {
    /// The bytes of all IP packets, counted once, where they leave their host.
    pub(crate) fn bytes(&self) -> u64 {
        let [a, b] = self.hosts;
        let sent = |from, to| self.simulation.sent_by_class(from, to).into_values();
        sent(a, b).chain(sent(b, a)).map(|tally| tally.bytes() - tally.link_layer).sum()
    }
}
