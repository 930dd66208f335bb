//! The same seed gives the same run, even with random encryption.

use std::time::Duration;

use trimaran_netsim::Simulation;
use trimaran_netsim::link::{LinkModel, LinkTally, Loss, Probability, Rate};
use trimaran_transport::LinkConfig;
use trimaran_transport::conformance::{Pairs, points, pose, receive, send_frame};

use super::Machines;

/// Sends 50 frames of 4,000 points over a link that loses a hundredth of all packets. Returns the hash of the
/// trace, the end time, and the number of lost packets.
fn session((simulation, machines): (Simulation, Machines)) -> (u64, u64, u64) {
    simulation
        .run(async {
            let (mut arm, mut panel) = machines.pair(LinkConfig::default()).await;
            for frame in 0..50 {
                panel.latest_tx.publish(pose(frame)).unwrap();
                send_frame(&mut arm.frames_tx, frame, &points(4000)).await.unwrap();
                assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(4000));
            }
        })
        .unwrap();
    let links = simulation.links();
    assert!(links.iter().all(LinkTally::is_balanced));
    let lost = links.iter().map(|link| link.dropped.lost.packets).sum();
    (simulation.trace_hash(), simulation.now().as_nanos(), lost)
}

/// Two runs of a seed have the same packets at the same nanoseconds, and another seed has others.
pub(crate) fn a_seed_decides_the_run(machines: impl Fn(&LinkModel, u64) -> (Simulation, Machines)) {
    let mut link = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(2));
    link.conditions.loss = Loss::Independent(Probability::new(0.01).unwrap());
    let first = session(machines(&link, 7));
    assert!(first.2 > 5, "nothing was lost: {first:?}");
    assert_eq!(session(machines(&link, 7)), first);
    assert_ne!(session(machines(&link, 8)).0, first.0);
}
