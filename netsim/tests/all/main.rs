//! Networks in virtual time, compared with arithmetic and with kernels.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod tcp;
mod time;

use trimaran_netsim::link::LinkModel;
use trimaran_netsim::{HostId, Simulation, Topology};

/// A simulation of two hosts, `here` and `there`; `way` leads from the first to the second.
fn two_hosts(way: &LinkModel, back: &LinkModel, seed: u64) -> (Simulation, [HostId; 2]) {
    let mut topology = Topology::new();
    let hosts = [topology.host("here"), topology.host("there")];
    topology.join(topology.node(hosts[0]), topology.node(hosts[1]), way.clone(), back.clone());
    (Simulation::new(&topology, seed), hosts)
}
