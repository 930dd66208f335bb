//! Two links that send as fast as they may over one bottleneck.

use std::cell::Cell;
use std::time::Duration;

use trimaran_netsim::link::{LinkModel, QueueModel, Rate};
use trimaran_netsim::{Simulation, Topology};
use trimaran_transport::conformance::{Overhead, Pairs, points, receive, send_frame};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Instant, LinkConfig, Options, sleep_until};

use crate::hosts::{Machines, acquainted, gigabit};

/// How long both send before anything counts, and how long it counts then.
const BEFORE: Duration = Duration::from_secs(6);
const COUNTED: Duration = Duration::from_secs(12);
/// The second one begins so much later.
const LATER: Duration = Duration::from_secs(2);

/// The result of sharing.
#[derive(Debug)]
struct Shared {
    /// Of what both received, the part of the first link.
    first: f64,
    /// Of the bottleneck's rate, the part that both received.
    used: f64,
    /// Of the packets at the bottleneck, the part that it dropped.
    dropped: f64,
}

const MEGABITS: u64 = 20;

/// Links of these schemes share 20 Mbit/s, 5 ms one way, with a queue for so many packets.
fn share(schemes: [&'static str; 2], packets: u32, seed: u64) -> Shared {
    let mut way = LinkModel::clean(Rate::new(MEGABITS * 1_000_000), Duration::from_millis(5));
    let back = way.clone();
    way.queue = QueueModel { packets, ..QueueModel::default() };
    let mut topology = Topology::new();
    let hosts = [topology.host("here"), topology.host("there")];
    // A queue at a sender's own host holds it back. The bottleneck is behind that.
    let router = topology.switch("router");
    topology.join(topology.node(hosts[0]), router, gigabit(), gigabit());
    topology.join(router, topology.node(hosts[1]), way, back);
    let simulation = Simulation::new(&topology, seed);
    let machines = schemes.map(|scheme| Machines {
        scheme,
        overhead: Overhead { header_bytes: 0, handshake: 0, coded: false },
        nets: hosts.map(|host| simulation.net(host)),
        options: options(scheme),
    });
    let received = [Cell::new(0), Cell::new(0)];
    let start = Instant::from_nanos(0);
    let end = start.after(BEFORE + COUNTED);
    let all = points(5_000);
    let flow = async |which: usize| {
        let net = machines[which].net();
        sleep_until(&*net, start.after(LATER * which as u32)).await;
        let (mut arm, mut panel) = machines[which].pair(LinkConfig::default()).await;
        let sends = async {
            for frame in 0.. {
                send_frame(&mut arm.frames_tx, frame, &all).await.unwrap();
            }
        };
        let reads = async {
            loop {
                let bytes = 4 * receive(&mut panel.frames_rx).await.unwrap().points.len() as u64;
                if net.now() > start.after(BEFORE) {
                    received[which].set(received[which].get() + bytes);
                }
            }
        };
        tokio::select! {
            () = sends => {}
            () = reads => {}
            () = sleep_until(&*net, end) => {}
        }
    };
    simulation.run(async { tokio::join!(flow(0), flow(1)) }).unwrap();
    let bottleneck = simulation.links()[2];
    let [first, second] = received.map(|bytes| bytes.get() as f64);
    Shared {
        first: first / (first + second),
        used: (first + second) * 8.0 / COUNTED.as_secs_f64() / (MEGABITS as f64 * 1e6),
        dropped: bottleneck.dropped.queue.packets as f64 / bottleneck.offered.packets as f64,
    }
}

fn options(scheme: &str) -> [Options; 2] {
    match scheme {
        "udp" => {
            let udp = UdpOptions::default().with_trust(Trust::SharedKey([9; 32].into()));
            [Options::default().with_udp(udp.clone()), Options::default().with_udp(udp)]
        }
        _ => acquainted(),
    }
}

/// A queue of ten packets is full within 6 ms, which hardly shows in the round trips.
const SHALLOW: u32 = 10;

fn both_get_on(schemes: [&'static str; 2], packets: u32) {
    let shared = share(schemes, packets, 1);
    assert!((0.25..0.75).contains(&shared.first), "{shared:?}");
    assert!(shared.used > 0.75, "{shared:?}");
    assert!(shared.dropped < 0.025, "{shared:?}");
}

#[test]
fn two_quic_links_share_a_bottleneck_and_do_not_flood_a_shallow_queue() {
    both_get_on(["quic", "quic"], SHALLOW);
    both_get_on(["quic", "quic"], 60);
}

#[test]
fn two_udp_links_share_a_bottleneck_and_do_not_flood_a_shallow_queue() {
    both_get_on(["udp", "udp"], SHALLOW);
    both_get_on(["udp", "udp"], 60);
}

#[test]
fn a_quic_link_and_a_udp_link_leave_room_to_tcp() {
    both_get_on(["quic", "tcp"], SHALLOW);
    both_get_on(["udp", "tcp"], SHALLOW);
}
