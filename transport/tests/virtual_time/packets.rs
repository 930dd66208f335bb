//! How many packets the points of a frame take, by transport and batch size, counted one by one.

use std::sync::Arc;
use std::time::Duration;

use trimaran_transport::conformance::{Overhead, Pairs, points, receive, send_frame, start};
use trimaran_transport::{BatchSize, LinkConfig, Net, sleep_until};

use crate::hosts::{Link, Machines, acquainted, gigabit};

/// As many as the ids in the paper's model of bandwidth.
const POINTS: u32 = 4000;

/// Packets in both directions for one frame of [`POINTS`] points over `transport` in batches of `batch`. With
/// `at_once` all points are found together, otherwise each batch alone.
fn packets(transport: &'static str, batch: u32, at_once: bool) -> u64 {
    let overhead = Overhead { header_bytes: 4, handshake: 1, coded: true };
    let (simulation, machines) = Machines::joined([&gigabit(); 2], 1, transport, overhead, acquainted());
    let net = machines.net();
    let mut config = LinkConfig::default();
    config.batching.size = BatchSize::new(batch).unwrap();
    let offered = || simulation.links().iter().map(|link| link.offered.packets).sum::<u64>();
    simulation
        .run(async {
            let (mut arm, mut panel) = machines.pair(config).await;
            // Earlier frames open the window, and discover the size of datagrams.
            for frame in 0..10 {
                send(&mut arm, frame, &points(POINTS)).await;
                receive(&mut panel.frames_rx).await.unwrap();
                pause(&net).await;
            }
            let before = offered();
            if at_once {
                send(&mut arm, 10, &points(POINTS)).await;
            } else {
                arm.frames_tx.begin(start(10)).await.unwrap();
                for found in points(POINTS).chunks(batch as usize) {
                    arm.frames_tx.push(found).await.unwrap();
                    sleep_until(&*net, net.now().after(Duration::from_micros(12))).await;
                }
                arm.frames_tx.finish().await.unwrap();
            }
            assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(POINTS));
            // Late acknowledgements.
            pause(&net).await;
            offered() - before
        })
        .unwrap()
}

async fn send(arm: &mut Link, frame: u32, found: &[u32]) {
    send_frame(&mut arm.frames_tx, frame, found).await.unwrap();
}

async fn pause(net: &Arc<dyn Net>) {
    sleep_until(&**net, net.now().after(Duration::from_millis(100))).await;
}

/// Batches found at once share packets: about as many as the bytes need, and acknowledgements.
#[test]
fn batches_that_are_found_at_once_share_packets() {
    for (transport, most) in [("tcp", 30), ("quic", 30), ("udp", 30)] {
        let counts = [1, 10, 100, 1000].map(|batch| packets(transport, batch, true));
        println!("{transport}: {counts:?}");
        for (batch, count) in [1, 10, 100, 1000].into_iter().zip(counts) {
            // A message's header is 4 bytes, as much as a point; our own datagrams have none.
            let most = if batch == 1 && transport != "udp" { 2 * most } else { most };
            assert!(count <= most, "{count} packets over {transport} in batches of {batch}");
        }
    }
}

/// A batch that is found alone does not wait for others.
#[test]
fn a_batch_that_is_found_alone_is_a_packet() {
    for transport in ["tcp", "quic", "udp"] {
        let count = packets(transport, 100, false);
        println!("{transport}: {count}");
        assert!(count >= 40, "{count} packets over {transport}");
    }
}
