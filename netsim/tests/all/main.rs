//! Networks in virtual time, compared with arithmetic and with kernels.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod faults;
mod tcp;
mod time;
mod tokio_names;

use trimaran_netsim::link::LinkModel;
use trimaran_netsim::{HostId, Simulation, Topology};

/// A simulation of two hosts, `here` and `there`; `way` leads from the first to the second.
fn two_hosts(way: &LinkModel, back: &LinkModel, seed: u64) -> (Simulation, [HostId; 2]) {
    let topology = Topology::pair(["here", "there"], way, back);
    let hosts = ["here", "there"].map(|name| topology.find(name).unwrap());
    (Simulation::new(&topology, seed), hosts)
}
