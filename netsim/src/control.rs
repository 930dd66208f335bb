//! Faults and changes of a network while it is in use.

use std::fmt;
use std::sync::Arc;

use thiserror::Error;

use crate::host::HostId;
use crate::link::LinkModel;
use crate::topology::NodeId;
use crate::world::World;

/// Crashes, partitions and changes of links, from [`Simulation::control`](crate::Simulation::control). Clones
/// control the same network, so programs in it can hold one.
///
/// Everything takes effect at once, at the time of the simulation. So a seed still decides the run, and
/// [`LinkTally`](crate::link::LinkTally) still accounts for every packet.
#[derive(Clone)]
pub struct Control {
    pub(crate) world: Arc<World>,
}

/// Why a link cannot be changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SetLinkError {
    /// No link leads from one to the other.
    #[error(
        "no link leads from the first node to the second: name neighbours, such as a host and its switch"
    )]
    NoLink,
    /// The framing is another one.
    #[error("the framing of a link cannot change: keep that of the topology")]
    Framing,
}

impl fmt::Debug for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control").finish_non_exhaustive()
    }
}

impl Control {
    /// Takes a host down as a power failure does: it says nothing to anyone.
    ///
    /// - Its tasks, those of [`Net::spawn`](trimaran_net::Net::spawn), are dropped. A task that crashes its
    ///   own host ends when it next waits.
    /// - Its sockets are gone. Programs outside of its tasks that still hold some get
    ///   [`NotConnected`](std::io::ErrorKind::NotConnected), also where they already wait.
    /// - No FIN and no reset leaves it. Peers of its TCP connections retransmit and probe until their own
    ///   timeouts end the connection with [`TimedOut`](std::io::ErrorKind::TimedOut).
    /// - Packets in its queues are dropped. Packets on its links go on, also those to others.
    /// - Packets that arrive while it is down are dropped (`dropped.down`).
    /// - Until [`Control::restart`], binding, listening and connecting fail with
    ///   [`NetworkDown`](std::io::ErrorKind::NetworkDown), and spawned tasks are dropped.
    ///
    /// A host that is down stays down.
    pub fn crash(&self, host: HostId) {
        self.world.crash(host);
    }

    /// Brings a host up that has crashed. It has no sockets and no tasks: start its programs again, with
    /// [`Simulation::net`](crate::Simulation::net) or a [`SimNet`](crate::SimNet) from before.
    ///
    /// It answers segments of connections from before with a reset. A host that is up stays as it is.
    pub fn restart(&self, host: HostId) {
        self.world.core().fabric.bring_up(host);
    }

    /// Cuts two hosts off from each other, in both directions and on all paths. Others still reach both.
    ///
    /// A packet between them is dropped (`dropped.partitioned`) where it enters a link or comes out of one.
    /// That includes packets in flight. Sockets and connections stay, and learn of it by their timeouts.
    pub fn partition(&self, a: HostId, b: HostId) {
        self.world.core().fabric.partition(a, b);
    }

    /// Ends the partition of two hosts. Packets that are in flight by then arrive, and TCP goes on with its
    /// next retransmission.
    pub fn heal(&self, a: HostId, b: HostId) {
        self.world.core().fabric.heal(a, b);
    }

    /// Changes the direction of a link that leads from one node to its neighbour, and of several the first.
    /// [`Topology::node`](crate::Topology::node) and [`find_node`](crate::Topology::find_node) give nodes.
    ///
    /// - Packets on the line or in flight keep their times. Packets in the queue stay there, also beyond new
    ///   limits, and are sent at the new rate.
    /// - `phases` count from the start of the simulation.
    /// - TCP connections keep the segment size of their beginning, so a smaller MTU drops their full
    ///   segments.
    ///
    /// # Errors
    /// If there is no such link, or the model has another framing.
    pub fn set_link(&self, from: NodeId, to: NodeId, model: LinkModel) -> Result<(), SetLinkError> {
        let mut core = self.world.core();
        let link = core.fabric.link(from, to).ok_or(SetLinkError::NoLink)?;
        if link.model().framing != model.framing {
            return Err(SetLinkError::Framing);
        }
        link.set_model(model);
        Ok(())
    }
}
