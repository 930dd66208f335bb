//! The project's own connection over datagrams in virtual time: the conformance suite, and the same run each
//! time.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../../transport/tests/common/mod.rs"]
mod common;
#[path = "virtual_time/priorities.rs"]
mod priorities;
#[path = "virtual_time/mod.rs"]
#[macro_use]
mod virtual_time;

use std::sync::Arc;
use std::time::Duration;

use common::conformance::Pairs;
use common::{camera, identity, ids, receive, start};
use trimaran_netsim::link::{Conditions, LinkModel, LinkTally, Loss, Phase, Probability, Rate};
use trimaran_netsim::{SimNet, Simulation, Topology};
use trimaran_proto::{DrawableId, FrameEvent, FrameOutcome, IdCoding, Role};
use trimaran_transport::udp::{Repair, Trust, UdpOptions};
use trimaran_transport::{
    Endpoint, Link, LinkConfig, Listener, Net, Options, RecvError, UdpMode, connect, sleep_until,
};

/// Two machines of a simulation.
struct Udp {
    here: SimNet,
    there: SimNet,
    options: UdpOptions,
}

impl Pairs for Udp {
    const HEADER: u64 = 0;
    const HANDSHAKE: u64 = 1;

    async fn pair(&self, link: LinkConfig) -> (Link, Link) {
        self.join(link, link).await
    }

    fn net(&self) -> Arc<dyn Net> {
        Arc::new(self.here.clone())
    }
}

impl Udp {
    async fn join(&self, ours: LinkConfig, theirs: LinkConfig) -> (Link, Link) {
        let options = |link| Options { link, udp: self.options.clone(), ..Options::default() };
        let (ours, theirs) = (options(ours), options(theirs));
        let (here, there) = (self.net(), Arc::new(self.there.clone()) as Arc<dyn Net>);
        let endpoint = "udp://0.0.0.0:0".parse().unwrap();
        let mut listener = Listener::bind(&here, &endpoint, identity(Role::SwitchA), &ours).await.unwrap();
        let Endpoint::Udp(at) = listener.local_endpoint() else { panic!("not UDP") };
        let endpoint = format!("udp://here:{}", at.at.port).parse().unwrap();
        let soon = here.now().after(Duration::from_secs(60));
        let (there, here) = tokio::join!(
            connect(&there, &endpoint, identity(Role::Display), &theirs, soon),
            listener.accept(soon),
        );
        (here.unwrap(), there.unwrap())
    }
}

fn machines(link: &LinkModel, seed: u64) -> (Simulation, Udp) {
    let mut topology = Topology::new();
    let (here, there) = (topology.host("here"), topology.host("there"));
    topology.join(topology.node(here), topology.node(there), link.clone(), link.clone());
    let simulation = Simulation::new(&topology, seed);
    let options = UdpOptions { trust: Trust::SharedKey([9; 32].into()), ..UdpOptions::default() };
    let pairs = Udp { here: simulation.net(here), there: simulation.net(there), options };
    (simulation, pairs)
}

conformance_in_virtual_time!(|| {
    machines(&LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(5)), 1)
});

#[test]
fn an_older_frame_is_complete_first() {
    let (simulation, pairs) = machines(&priorities::narrow(), 1);
    simulation.run(priorities::an_older_frame_is_complete_first(&pairs)).unwrap();
}

#[test]
fn a_camera_goes_before_a_frame() {
    let (simulation, pairs) = machines(&priorities::narrow(), 1);
    simulation.run(priorities::a_camera_goes_before_a_frame(&pairs)).unwrap();
}

/// Over a way that loses many packets and leaves time to send them again once: whole or with gaps, but never
/// what was not sent.
#[test]
fn with_deadlines_a_lost_frame_spoils_no_later_one() {
    let mut way = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(3));
    way.conditions.loss = Loss::Independent(Probability::new(0.15).unwrap());
    let (simulation, mut pairs) = machines(&way, 1);
    let deadline = Duration::from_millis(14);
    pairs.options =
        UdpOptions { mode: UdpMode::Deadline, deadline, repair: Repair::Off, ..pairs.options.clone() };
    let visible = |frame: u32| -> Vec<DrawableId> {
        (0..4000).filter(|id| !(id + 3 * frame).is_multiple_of(100)).map(|id| DrawableId(500 * id)).collect()
    };
    let talk = async {
        let link = LinkConfig { coding: IdCoding::Changes, ..LinkConfig::default() };
        let (mut a, mut display) = pairs.pair(link).await;
        let (mut whole, mut gaps, mut bytes) = (0, 0, u64::MAX);
        for frame in 0..500 {
            // Until what has arrived of the last frame is known.
            sleep_until(&*pairs.net(), pairs.net().now().after(deadline)).await;
            let before = a.stats.read();
            a.frames_tx.begin(start(frame)).await.unwrap();
            a.frames_tx.push(&visible(frame)).await.unwrap();
            a.frames_tx.finish().await.unwrap();
            bytes = bytes.min((a.stats.read() - before).sent.ids.bytes);
            let (mut ids, sent) = (Vec::new(), visible(frame));
            loop {
                match display.frames_rx.recv().await.unwrap() {
                    FrameEvent::Ids(batch) => ids.extend(batch.iter()),
                    FrameEvent::End(FrameOutcome::Complete(_)) => {
                        assert_eq!(ids, sent);
                        whole += 1;
                        break;
                    }
                    FrameEvent::End(FrameOutcome::Incomplete { .. }) => {
                        assert!(ids.iter().all(|id| sent.binary_search(id).is_ok()), "frame {frame}");
                        gaps += 1;
                        break;
                    }
                    FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
                }
            }
        }
        (whole, gaps, bytes)
    };
    let (whole, gaps, bytes) = simulation.run(talk).unwrap();
    // Some came as changes.
    assert!(whole >= 20 && gaps >= 20 && bytes < 2000, "{whole} whole, {gaps} with gaps, {bytes} bytes");
}

/// A network that is cut one way only is no fault of the peer: it may come again.
#[test]
fn a_peer_that_hears_nothing_any_more_is_lost_though_it_can_be_heard() {
    let way = LinkModel::clean(None, Duration::from_millis(1));
    let (mut topology, cut) = (Topology::new(), Duration::from_secs(1));
    let conditions = Conditions { loss: Loss::Independent(Probability::one()), ..way.conditions };
    let until_then = LinkModel { phases: vec![Phase { at: cut, conditions }], ..way.clone() };
    let (here, there) = (topology.host("here"), topology.host("there"));
    topology.join(topology.node(here), topology.node(there), until_then, way);
    let simulation = Simulation::new(&topology, 1);
    let options = UdpOptions { trust: Trust::SharedKey([9; 32].into()), ..UdpOptions::default() };
    let pairs = Udp { here: simulation.net(here), there: simulation.net(there), options };
    let talk = async {
        let net = pairs.net();
        // The other side is more patient, and does not close the connection first.
        let patient = LinkConfig { lease: Duration::from_secs(100), ..LinkConfig::default() };
        let (mut here, mut there) = pairs.join(LinkConfig::default(), patient).await;
        sleep_until(&*net, net.now().after(cut)).await;
        here.latest_tx.publish(camera(0)).unwrap();
        let mut frame = 0;
        let goes_on = async {
            loop {
                frame += 1;
                if there.latest_tx.publish(camera(frame)).is_err() {
                    std::future::pending::<()>().await;
                }
                sleep_until(&*net, net.now().after(Duration::from_millis(100))).await;
            }
        };
        tokio::select! {
            end = here.frames_rx.recv() => end.unwrap_err(),
            () = goes_on => unreachable!("it never ends"),
        }
    };
    let end = simulation.run(talk).unwrap();
    assert!(matches!(end, RecvError::Lost { .. }), "{end:?}");
    assert!(format!("{end:?}").contains("Deaf"), "{end:?}");
}

/// Sends 50 frames of 4000 ids over a link that loses a hundredth of all packets. Gives the hash of the
/// trace, when it was done, and how many packets were lost.
fn lossy_session(seed: u64) -> (u64, u64, u64) {
    let mut link = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(2));
    link.conditions.loss = Loss::Independent(Probability::new(0.01).unwrap());
    let (simulation, pairs) = machines(&link, seed);
    simulation
        .run(async {
            let (mut a, mut display) = pairs.pair(LinkConfig::default()).await;
            for frame in 0..50 {
                display.latest_tx.publish(camera(frame)).unwrap();
                a.frames_tx.begin(start(frame)).await.unwrap();
                a.frames_tx.push(&ids(4000)).await.unwrap();
                a.frames_tx.finish().await.unwrap();
                assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(4000));
            }
        })
        .unwrap();
    let links = simulation.links();
    assert!(links.iter().all(LinkTally::is_balanced));
    let lost = links.iter().map(|link| link.dropped.lost.packets).sum();
    (simulation.trace_hash(), simulation.now().as_nanos(), lost)
}

#[test]
fn the_same_seed_gives_the_same_packets_at_the_same_nanoseconds() {
    let first = lossy_session(7);
    assert!(first.2 > 5, "nothing was lost: {first:?}");
    assert_eq!(lossy_session(7), first);
    assert_ne!(lossy_session(8).0, first.0);
}
